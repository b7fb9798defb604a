"""First plans and how good they are, beside RoboPlan, OMPL and, without obstacles, ruckig: time, one thread.

    python tests/bench/bench_plan_first.py [TASKS] [--boxes 0,12] [--seconds S] [--first SEED]
                                           [--roboplan PYTHON]

Six joints of the TM5-900, least time within the same limits of speed (the arm's) and acceleration
(5 rad/s²) for all: RoboPlan knows no torques, so none is limited here. PYTHON is the interpreter of an
environment in which `roboplan` 0.7 is installed (RRT-Connect, shortcuts, TOPP-RA, seed after seed for
as many processor seconds); left out, it is not asked. Ruckig's motion touches whatever is in its way
and is there without boxes alone: nothing that starts and ends at rest is quicker. Told are processor
seconds to the first plan, with those of the scene, durations after S seconds (4), and how many of
RoboPlan's motions touch something by the exact distances of the scene; ours keep 5 mm.
"""

import argparse
import json
import os
import subprocess
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import toppra
from ruckig import InputParameter, Ruckig, Trajectory

from plan.command_options import SolveOptions
from plan.geometry.scene import Scene
from plan.problem.problem import PlanningProblem
from plan.solving.solve import solve
from tests.bench.bench_plan_optimum import arm_of, draw, torque_of
from tests.bench.peers.ompl_toppra import OmplToppra, is_installed

RUNNER = Path(__file__).parent / "peers" / "run_roboplan.py"
# Limits of all planners: acceleration [rad/s²]; a torque that never binds [N m].
ACCELERATION, TORQUE = 5.0, 1e5
# Motions of RoboPlan are looked at in so many places.
PLACES = 400


def draw_task(boxes: int, number: int) -> PlanningProblem:
    """A task whose straight line is blocked where there are boxes."""
    arm = arm_of(6)
    rng = np.random.default_rng([2036, boxes, number])
    return limit_acceleration(draw(arm, torque_of(arm, None), "time", boxes, rng))


def limit_acceleration(task: PlanningProblem) -> PlanningProblem:
    """The task with its arm's speed and `ACCELERATION` as limits, and none of torque."""
    arm = task.scene.arm
    limits = replace(
        task.limits,
        speed=arm.velocity_limit,
        acceleration=np.full(arm.n, ACCELERATION),
        torque=np.full(arm.n, TORQUE),
    )
    return replace(task, limits=limits)


def quickest(task: PlanningProblem) -> float:
    """Duration of ruckig's motion from rest to rest, whatever is in its way [s]."""
    asked = InputParameter(task.n)
    asked.current_position = task.start.tolist()
    asked.target_position = task.goal.tolist()
    asked.max_velocity = task.limits.speed.tolist()
    asked.max_acceleration = [ACCELERATION] * task.n
    asked.max_jerk = [float("inf")] * task.n
    motion = Trajectory(task.n)
    Ruckig(task.n).calculate(asked, motion)
    return float(motion.duration)


def written(tasks: list[PlanningProblem]) -> dict[str, Any]:
    """The tasks for RoboPlan."""
    arm = tasks[0].scene.arm
    rows = []
    for task in tasks:
        boxes = []
        for box in task.scene.obstacles:
            row = {"name": box.name, "turn": box.rotation.tolist(), "place": box.centre.tolist()}
            boxes.append({**row, "size": (2.0 * box.half).tolist()})
        rows.append({"start": task.start.tolist(), "goal": task.goal.tolist(), "boxes": boxes})
    head = {"urdf": str(arm.source), "robot": arm.name, "joints": list(arm.joint_names)}
    left_out = [list(pair.links) for pair in tasks[0].scene.unchecked]
    return {**head, "acceleration": ACCELERATION, "left_out": left_out, "tasks": rows}


def ask_roboplan(python: str, tasks: list[PlanningProblem], seconds: float) -> list[dict[str, Any]]:
    """What RoboPlan found for each task."""
    with tempfile.TemporaryDirectory() as place:
        given = Path(place) / "tasks.json"
        out = Path(place) / "found.json"
        given.write_text(json.dumps(written(tasks)))
        bare = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        subprocess.run([python, str(RUNNER), str(given), str(seconds), str(out)], check=True, env=bare)
        return json.loads(out.read_text())


def ask_ompl(task: PlanningProblem) -> list[float]:
    """Processor seconds of OMPL's first path timed by TOPP-RA, and its duration [s]; nan without OMPL.

    The path is a cubic spline through what is left of OMPL's corners.
    """
    if not is_installed():
        return [np.nan, np.nan]
    toppra.setup_logging("ERROR")
    began = time.process_time()
    corners = OmplToppra().find_path(task, np.random.default_rng(0))
    if corners is None:
        return [np.inf, np.inf]
    lengths = np.abs(np.diff(corners, axis=0)).max(axis=1)
    path = toppra.SplineInterpolator(np.concatenate([[0.0], np.cumsum(lengths)]), corners)
    speed = np.stack([-task.limits.speed, task.limits.speed], axis=1)
    acceleration = np.full((task.n, 2), [-ACCELERATION, ACCELERATION])
    constraints = [
        toppra.constraint.JointVelocityConstraint(speed),
        toppra.constraint.JointAccelerationConstraint(acceleration),
    ]
    motion = toppra.algorithm.TOPPRA(constraints, path).compute_trajectory(0.0, 0.0)
    spent = time.process_time() - began
    return [spent, np.inf if motion is None else float(motion.duration)]


def touches(task: PlanningProblem, positions: list[list[float]]) -> bool:
    """Whether a motion comes nearer than nothing to anything."""
    q = np.array(positions)
    some = q[np.unique(np.linspace(0, len(q) - 1, PLACES).astype(int))]
    return bool(task.scene.separation(some).min() < 0.0)


def compare(boxes: int, options: argparse.Namespace) -> None:
    """The table of the tasks with so many boxes."""
    numbers = range(options.first, options.first + options.tasks)
    tasks = [draw_task(boxes, number) for number in numbers]
    theirs: list[dict[str, Any]] = [{"found": []}] * len(tasks)
    if options.roboplan is not None:
        theirs = ask_roboplan(options.roboplan, tasks, options.seconds)
    table = []
    for number, task, other in zip(numbers, tasks, theirs, strict=True):
        began = time.process_time()
        Scene.build(task.scene.arm, task.scene.obstacles)
        built = time.process_time() - began
        result = solve(task, SolveOptions(seconds=options.seconds, gap=False))
        first = next((row for row in result.history if np.isfinite(row[2])), None)
        if first is None or not result.solved:
            print(f"| {boxes} boxes, {number} | no plan: {result.reason} |")
            continue
        best = other["found"][-1] if other["found"] else None
        duration = best["duration"] if best else np.inf
        row = [first[1] + built, first[2], result.cost, np.inf, np.inf, duration, np.nan]
        row += ask_ompl(task)
        if best:
            row[3] = other["found"][0]["seconds"]
            row[4] = other["found"][0]["duration"]
        if boxes == 0:
            row[6] = quickest(task)
        hit = best is not None and touches(task, best["positions"])
        table.append([*row, float(hit)])
        shown = " | ".join(f"{value:.3f}" for value in row)
        print(f"| {boxes} boxes, {number} | {shown} | {'touches' if hit else ''} |", flush=True)
    summarise(boxes, np.array(table))


def summarise(boxes: int, table: np.ndarray) -> None:
    """Medians, and the worst."""
    if not len(table):
        return
    first, _, ours, their_first, _, theirs, least, ompl_first, ompl, hits = table.T
    print(f"{boxes} boxes: first plan {np.median(first):.2f} s median, {first.max():.2f} s worst", end="")
    there = np.isfinite(theirs)
    if there.any():
        shorter = 1.0 - ours[there] / theirs[there]
        print(f"; RoboPlan's {np.median(their_first[there]):.2f} s, {their_first[there].max():.2f} s", end="")
        print(f", ours shorter by {np.median(shorter):.1%} median, {shorter.min():.1%} least", end="")
        print(f"; {int(hits.sum())} of {there.sum()} of RoboPlan's touch something", end="")
    if np.isfinite(least).any():
        longer = ours / least - 1.0
        print(f"; longer than ruckig's by {np.median(longer):.2%} median, {longer.max():.2%} worst", end="")
    reached = np.isfinite(ompl)
    if reached.any():
        shorter = 1.0 - ours[reached] / ompl[reached]
        print(f"; OMPL's with TOPP-RA {np.median(ompl_first[reached]):.2f} s median", end="")
        print(f", ours shorter by {np.median(shorter):.1%} median, {shorter.min():.1%} least", end="")
    print(flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=10)
    parser.add_argument("--boxes", default="0,12")
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--roboplan", default=None)
    options = parser.parse_args()
    warm = draw_task(1, 10**6)
    solve(warm, SolveOptions(evaluations=300, seconds=60.0, gap=False))  # loops are compiled before
    heads = ["task", "first [s]", "its duration [s]", "ours [s]", "RoboPlan's first [s]", "its duration [s]"]
    heads += ["RoboPlan's [s]", "ruckig's [s]", "OMPL's first [s]", "its duration [s]", ""]
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for boxes in map(int, options.boxes.split(",")):
        compare(boxes, options)


if __name__ == "__main__":
    main()
