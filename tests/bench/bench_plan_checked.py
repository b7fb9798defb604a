"""Random tasks on three arms, every plan looked at by a checker that shares no code with `plan`.

    python tests/bench/bench_plan_checked.py [TASKS] [--seconds S] [--evaluations E[,E]] [--rows FILE]
                                             [--model FOLDER] [--first SEED]

TM5-900 (all six joints, with the given model and its net, else with losses drawn), Panda and UR5, by turns; up to three
boxes, a tool at the tip in every third task, 5 or 20 mm of clearance, on the TM5-900 a folded wrist in every second;
energy or time, at most E evaluations a task, the numbers by turns (40). Few of them give early plans, which is
what a checker is to catch as well as good ones: not how low a plan ends is looked at, but whether one that is said to
keep everything does. Ends after TASKS, or S seconds of processor time. Limits, clearance, ends, energy by Simpson's
rule, dynamics, net and shapes (the URDF's meshes, by Coal) are computed anew. FILE gets a line a task as it is done.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
import tomllib
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import tomli_w

from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.robot.arm import ArmModel
from plan.api.planning import solve
from plan.geometry.scene import Scene
from tests.plan.checker import Model, World, faults

ROBOTS = ("tm5-900", "ur5", "panda")
# The frame of each arm's tip, for the checker, and wrists of the TM5-900 whose links are 2 mm apart [rad].
TIPS = {"tm5-900": "flange", "ur5": "tool0", "panda": "panda_hand_tcp"}
FOLDED = np.radians([[-144.0, -1.9, 140.5, -63.9], [54.6, 85.5, -91.9, 90.1], [7.5, 127.2, 80.7, 17.1]])
# Tasks after which the count so far is told: a long run that is ended early has then said something.
TOLD_EVERY = 20


def prepared(robot: str, folder: Path, given: str | None) -> Path:
    """A model of the arm: the given one, or one with losses of a usual size for each joint's rating."""
    if given is not None and robot == "tm5-900":
        return Path(given)
    arm = ArmModel.load(robot)
    arm = arm.locked(arm.joint_names[7:], [0.0] * (arm.n - 7)) if arm.n > 7 else arm
    rated = arm.effort_limit
    loss = LossParameters(0.004 * rated, 0.04 * rated, 0.05 * rated, 0.01 * rated, np.full(arm.n, 0.01))
    heavier = arm.with_inertial_parameters(1.05 * arm.inertial_parameters)
    return HybridModel(arm, arm, heavier, loss, inertia="base").save(folder / robot)


def draw(arm: ArmModel, free: Scene, rng: np.random.Generator) -> dict:  # type: ignore[type-arg]
    """A scene: ends that are free of the arm itself, boxes that leave them free."""
    folded = arm.name.startswith("tm5") and rng.integers(2)
    low, high = 0.8 * np.maximum(arm.lower, -2.5), 0.8 * np.minimum(arm.upper, 2.5)
    while True:
        ends = rng.uniform(low, high, (2, arm.n))
        ends[1] = np.clip(ends[1], ends[0] - 1.5, ends[0] + 1.5)
        if folded:
            ends[:, 2:] = FOLDED[rng.integers(len(FOLDED))]
        if free.separation(ends).min() > 0.001:  # links of a Panda's hand are never farther apart than some millimetres
            break
    tips = [arm.forward_kinematics(q) for q in ends]
    objects = []
    for k in range(rng.integers(0, 4)):
        for _ in range(50):
            angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(0.3, 0.9)
            xyz = np.array([away * np.cos(angle), away * np.sin(angle), rng.uniform(0.1, 1.0)])
            if min(np.linalg.norm(pose[:3, 3] - xyz) for tip in tips for pose in tip.values()) > 0.35:
                break
        size, rpy = rng.uniform(0.06, 0.2, 3), rng.uniform(-np.pi, np.pi, 3)
        objects.append({"name": f"box {k}", "size_m": size.tolist(), "xyz_m": xyz.tolist(), "rpy_rad": rpy.tolist()})
    need = float(np.max(np.abs(ends[1] - ends[0]) / np.minimum(arm.velocity_limit, np.pi)))
    task = {"start_deg": np.degrees(ends[0]).tolist(), "goal_deg": np.degrees(ends[1]).tolist()}
    task = {**task, "duration_s": need * rng.uniform(2.0, 4.0), "clearance_m": float(rng.choice([0.005, 0.02]))}
    tool = {"name": "tool", "size_m": [0.03, 0.03, 0.12], "xyz_m": [0.0, 0.0, 0.07]}
    return {"task": task, "obstacle": objects, "attached": [tool] if rng.integers(3) == 0 else []}


@dataclass(frozen=True)
class Bench:
    """One arm: its model's folder, the arm, the arm alone as the planner sees it, and the checker's own model."""

    model: Path
    arm: ArmModel
    free: Scene
    checked: Model


@dataclass(frozen=True)
class Row:
    """What became of a task: its status, what the checker found broken, processor seconds of planning and checking."""

    task: int
    robot: str
    objective: str
    evaluations: int
    status: str
    broken: tuple[str, ...] = ()
    planned: float = 0.0
    checked: float = 0.0


def one_task(number: int, robot: str, bench: Bench, evaluations: int, folder: Path) -> Row:
    """Draws a task, plans it, and has the plan looked at."""
    rng = np.random.default_rng([2027, number])
    scene, objective = {"robot": robot, **draw(bench.arm, bench.free, rng)}, ("energy", "time")[int(rng.integers(2))]
    path = folder / "scene.toml"
    path.write_text(tomli_w.dumps(scene))
    row, began = Row(number, robot, objective, evaluations, "refused"), time.process_time()
    try:
        result = solve(path, bench.model, objective=objective, evaluations=evaluations, gap=False, seed=number)
    except InputError:  # the task is at fault: an end inside a box
        return row
    except Exception as error:  # ours is
        return replace(row, status="crashed", broken=(repr(error),))
    row = replace(row, status=result.status, planned=time.process_time() - began)
    if not result.solved:
        return row
    assert result.certificate is not None
    whole = tomllib.loads(path.read_text())
    whole["task"]["objective"] = objective
    source = ArmModel.load(robot).source
    assert source is not None
    packages = [str(Path(pin.__file__).parents[4] / "share"), str(source.parents[3])]
    limits = {
        "lower": bench.arm.lower,
        "upper": bench.arm.upper,
        "speed": bench.arm.velocity_limit,
        "torque": bench.arm.effort_limit,
        "clearance": whole["task"]["clearance_m"],
    }
    world = World(source, packages, whole, tip=TIPS[robot])
    found = faults(result.to_dict(), whole, bench.checked, world, limits)
    return replace(row, broken=tuple(found), checked=time.process_time() - began - row.planned)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=1e9)
    parser.add_argument("--evaluations", default="40")
    parser.add_argument("--rows", type=Path, default=None)
    parser.add_argument("--model", default=None)
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    budgets = [int(count) for count in options.evaluations.split(",")]
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as name:
        folder, benches = Path(name), {}
        for robot in ROBOTS:
            model = prepared(robot, folder, options.model)
            arm = HybridModel.load(model).robot
            benches[robot] = Bench(model, arm, Scene.build(arm), Model(model))
        for k in range(options.tasks):
            if time.process_time() > options.seconds:
                break
            robot, evaluations = ROBOTS[k % len(ROBOTS)], budgets[k // len(ROBOTS) % len(budgets)]
            rows.append(one_task(options.first + k, robot, benches[robot], evaluations, folder))
            if rows[-1].broken:
                print(rows[-1], flush=True)
            if options.rows is not None:
                with options.rows.open("a") as stream:
                    stream.write(json.dumps(asdict(rows[-1])) + "\n")
            if len(rows) % TOLD_EVERY == 0:
                tell(rows)
    tell(rows)
    for robot in ROBOTS:
        own = [row for row in rows if row.robot == robot]
        print(robot, dict(Counter(row.status for row in own)), f"{sum(row.planned for row in own):.0f} s of planning")
    print(f"{time.process_time():.0f} s of processor time in all")


def tell(rows: list[Row]) -> None:
    """How many so far, and how many broken."""
    broken = sum(bool(row.broken) for row in rows)
    print(f"{len(rows)} tasks: {dict(Counter(row.status for row in rows))}, broken: {broken}", flush=True)


if __name__ == "__main__":
    main()
