"""Energy where the duration is free beside a sweep by hand, and cycles beside plans made one by one.

    python tests/bench/bench_plan_energy.py [--durations N] [--cycles M] [--sweep K] [--seconds S] [--first SEED]

N tasks (3) of three and six joints, none, one or twelve boxes, a standby power of 0, 20 or 100 W by
turns, may take four times as long as need be. Each is planned with its duration free; by hand, K
durations (13) from the shortest to the longest are planned one by one, and as many again about the
best of them. Told is the cost (energy and standby) above the cheapest of the sweep.

M cycles (3) go from home to a grip, a release and home, with 1 to 3 kg and a box on the arm between;
their whole duration is two to three times the shortest. The same motions are planned one by one, too:
each taking the same multiple of its shortest duration, and all taking equally long. Told is by how
much less energy the cycle takes. Each search has S processor seconds (4).
"""

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import tomli_w

from ident.arrays import Array
from ident.errors import InputError
from plan.command_options import SolveOptions
from plan.geometry.scene import Scene
from plan.problem.problem import PlanningProblem
from plan.problem.task_file import Task, load_task
from plan.solving.cycle import solve_cycle, split_cycle
from plan.solving.free_duration import lasting, solve_free_duration
from plan.solving.obstruction import shortest_duration
from plan.solving.solve import solve
from tests.bench.bench_plan_optimum import arm_of, draw, torque_of

# Joints, boxes and standby powers [W] of the tasks whose duration is free, by turns.
JOINTS, BOXES, STANDBY = (3, 6), (0, 1, 12), (20.0, 0.0, 100.0)
# The longest duration, and the first of the sweep, as multiples of the shortest.
LONGEST, SHORTEST = 4.0, 1.02
# How far about the best duration the second part of a sweep goes, as a factor.
ABOUT = 1.15
# Places from which a cycle's stops are drawn [deg], and dwells there [s].
STOPS_DEG = np.array([[-90.0, -40.0, -130.0], [90.0, 50.0, -40.0]])
DWELLS = (0.3, 0.2)


def sweep(task: PlanningProblem, durations: Array, options: SolveOptions) -> dict[float, float]:
    """Cost of the motions of fixed durations, standby counted; those that are not solved are left out."""
    costs = {}
    fixed = replace(task, longest=None, standby=0.0)
    for duration in durations:
        result = solve(lasting(fixed, float(duration)), options)
        if result.solved:
            costs[float(duration)] = result.cost + task.standby * float(duration)
    return costs


def compare_durations(number: int, count: int, options: SolveOptions) -> float | None:
    """Cost of a free duration above the sweep's cheapest, as a share; None where there is no plan."""
    joints = JOINTS[number % len(JOINTS)]
    boxes = BOXES[number % len(BOXES)]
    arm = arm_of(joints)
    rng = np.random.default_rng([2034, number])
    task = draw(arm, torque_of(arm, None), "energy", boxes, rng)
    shortest = shortest_duration(task)
    longest = LONGEST * shortest
    task = replace(task, longest=longest, standby=STANDBY[number % len(STANDBY)])
    result = solve_free_duration(task, options)
    costs = sweep(task, np.geomspace(SHORTEST * shortest, longest, count), options)
    name = f"{joints} joints, {boxes} boxes, {task.standby:g} W, {number}"
    if not result.solved or not costs:
        print(f"| {name} | {result.status}: {result.reason} | | | |", flush=True)
        return None
    best = min(costs, key=lambda duration: costs[duration])
    near = np.geomspace(best / ABOUT, min(best * ABOUT, longest), count)
    costs |= sweep(task, near, options)
    best = min(costs, key=lambda duration: costs[duration])
    above = result.cost / costs[best] - 1.0
    free = float(result.splines.total[0])
    print(
        f"| {name} | {result.cost:.3f} J in {free:.3f} s | {costs[best]:.3f} J in {best:.3f} s "
        f"| {above:+.2%} | {result.cpu_seconds:.1f} |",
        flush=True,
    )
    return above


def draw_cycle(number: int, folder: Path) -> Task:
    """A cycle of three motions whose ends are free of the arm itself."""
    rng = np.random.default_rng([2035, number])
    arm = arm_of(3)
    free = Scene.build(arm)
    while True:
        stops = rng.uniform(*STOPS_DEG, (3, 3))
        apart = np.abs(np.diff(stops, axis=0)).max(axis=1)
        if free.separation(np.radians(stops)).min() > 0.05 and apart.min() > 30.0:
            break
    home, pick, place = stops.tolist()
    size = rng.uniform(0.04, 0.08, 3).tolist()
    part = {"name": "part", "size_m": size, "xyz_m": [0.0, 0.0, 0.08], "touches": ["link_6"]}
    scene = {
        "robot": "tm5-900",
        "task": {"start_deg": home, "goal_deg": home, "duration_s": 20.0},
        "payload": {"mass_kg": float(rng.uniform(1.0, 3.0)), "com_m": [0.0, 0.0, 0.08]},
        "attached": [part],
        "leg": [
            {"deg": pick, "dwell_s": DWELLS[0], "does": "grip"},
            {"deg": place, "dwell_s": DWELLS[1], "does": "release"},
        ],
    }
    path = folder / "cycle.toml"
    path.write_text(tomli_w.dumps(scene))
    task = load_task(path)
    needs = [shortest_duration(problem) for problem in split_cycle(task, None, SolveOptions())]
    whole = rng.uniform(2.0, 3.0) * sum(needs) + sum(DWELLS)
    return replace(task, duration=float(whole))


def compare_cycle(number: int, folder: Path, options: SolveOptions) -> float | None:
    """Energy of plans made one by one above that of the cycle, as a share; None where there is no plan."""
    try:
        task = draw_cycle(number, folder)
        problems = split_cycle(task, None, options)
    except InputError as error:
        print(f"| cycle {number} | refused: {error} | | | | |", flush=True)
        return None
    whole = replace(options, seconds=options.seconds * len(problems))
    began = time.process_time()
    cycle = solve_cycle(task, problems, whole)
    spent = time.process_time() - began
    if not cycle.solved:
        print(f"| cycle {number} | {cycle.status}: {cycle.reason} | | | | |", flush=True)
        return None
    moving = task.duration - cycle.dwelling
    needs = np.array([shortest_duration(problem) for problem in problems])
    shares = {"multiple": needs / needs.sum(), "equal": np.full(len(needs), 1.0 / len(needs))}
    sums = {}
    for name, share in shares.items():
        fixed = [replace(problem, longest=None) for problem in problems]
        plans = [solve(lasting(p, float(t)), options) for p, t in zip(fixed, moving * share, strict=True)]
        sums[name] = sum(plan.cost for plan in plans)
    torque = max(leg.slowed_torque_share for leg in cycle.legs)
    less = [1.0 - cycle.energy / value for value in sums.values()]
    print(
        f"| cycle {number} | {cycle.energy:.3f} J in {cycle.duration:.3f} s | {sums['multiple']:.3f} J, {less[0]:+.1%} "
        f"| {sums['equal']:.3f} J, {less[1]:+.1%} | {torque:.1%} | {spent:.1f} |",
        flush=True,
    )
    return less[0]


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--durations", type=int, default=3)
    parser.add_argument("--cycles", type=int, default=3)
    parser.add_argument("--sweep", type=int, default=13)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--first", type=int, default=0)
    asked = parser.parse_args()
    options = SolveOptions(seconds=asked.seconds, gap=False)
    numbers = range(asked.first, asked.first + asked.durations)
    if numbers:
        print("| task | free | by hand | above | CPU [s] |\n|---|---|---|---|---|")
        above = [compare_durations(k, asked.sweep, options) for k in numbers]
        known = [value for value in above if value is not None]
        if known:
            print(f"above the sweep's cheapest: {np.median(known):+.2%} median, {max(known):+.2%} worst")
    numbers = range(asked.first, asked.first + asked.cycles)
    if numbers:
        print("| task | as one | same multiple each | equally long each | torque at any pace | CPU [s] |")
        print("|---|---|---|---|---|---|")
        with tempfile.TemporaryDirectory() as place:
            less = [compare_cycle(k, Path(place), options) for k in numbers]
        known = [value for value in less if value is not None]
        if known:
            print(f"less than one by one: {np.median(known):+.1%} median, {min(known):+.1%} least")


if __name__ == "__main__":
    main()
