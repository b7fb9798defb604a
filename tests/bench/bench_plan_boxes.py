"""What a trajectory costs among a hundred boxes, beside the same trajectories with that box alone that is in the way.

    python tests/bench/bench_plan_boxes.py [TASKS] [--joints 3,6,7] [--first SEED]

For each arm TASKS tasks among 100 boxes are drawn as in `bench_plan_optimum.py`. The one box is the one into which the
straight line leads deepest: a box that no motion comes near would cost nothing, and tell nothing. "Evaluated": motions
bent at random, a batch of them (cost, limits, clearance). "Stepped": what the default method looks at, costs and
derivatives by turns, in its first steps from the straight line. Processor time, everything compiled before; the least
of three runs counts.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from plan.geometry.boxes import Box
from plan.geometry.scene import Scene
from plan.planners import Budget, Ledger
from plan.planners.descent import descend
from plan.planners.sequential import begin_course, bounds
from plan.problem.problem import PlanningProblem
from plan.solving.solve import solve
from tests.bench.bench_plan_optimum import arm_of, draw, torque_of

# Motions of a batch, how far their via points are bent [rad]; steps; runs.
BOXES, BATCH, BENT, STEPS, TURNS = 100, 60, 0.1, 20, 3


def in_the_way(task: PlanningProblem) -> Box:
    """The obstacle into which the straight line leads deepest."""
    scene, line = task.scene, task.start + np.linspace(0.0, 1.0, 100)[:, None] * (task.goal - task.start)
    gaps = np.where(scene.pairs[:, 0] >= len(scene.boxes) - len(scene.obstacles), scene.gaps(line).min(axis=0), np.inf)
    return scene.boxes[scene.pairs[np.argmin(gaps), 0]]


def evaluated(task: PlanningProblem) -> float:
    """Seconds an evaluation of motions bent at random."""
    rng = np.random.default_rng(0)
    x = task.initial + BENT * rng.normal(size=(BATCH, task.dimension))
    return _timed(lambda: task.evaluate(x)) / BATCH


def stepped(task: PlanningProblem) -> float:
    """Seconds a look or a derivative of the default method."""
    course, looks = begin_course(task), []

    def run() -> None:
        ledger = Ledger(Budget(10**6, 60.0))
        descend(course, ledger, *bounds(course.local), STEPS, 0.3, 1e-4)
        looks.append(ledger.evaluations)

    return _timed(run) / max(looks[0], 1)


def _timed(work: Callable[[], object]) -> float:
    spent = []
    for _ in range(TURNS):
        started = time.process_time()
        work()
        spent.append(time.process_time() - started)
    return min(spent)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="?", type=int, default=4)
    parser.add_argument("--joints", default="3,6,7")
    parser.add_argument("--first", type=int, default=0)
    options = parser.parse_args()
    warm = draw(arm_of(3), torque_of(arm_of(3), None), "energy", 1, np.random.default_rng(0))
    solve(warm, "sqp", 0, Budget(100, 60.0), gap=False)
    print("| task | evaluated, 1 box [ms] | 100 | ratio | stepped, 1 box [ms] | 100 | ratio |\n" + "|---" * 7 + "|")
    ratios = []
    for joints in map(int, options.joints.split(",")):
        arm = arm_of(joints)
        for i in range(options.first, options.first + options.tasks):
            many = draw(arm, torque_of(arm, None), "energy", BOXES, np.random.default_rng([joints, BOXES, i]))
            one = replace(many, scene=Scene.build(arm, [in_the_way(many)]))
            figures = [[1e3 * work(task) for task in (one, many)] for work in (evaluated, stepped)]
            ratios.append([few[1] / few[0] for few in figures])
            cells = " | ".join(f"{a:.2f} | {b:.2f} | {b / a:.2f}" for a, b in figures)
            print(f"| {joints} joints, {i} | {cells} |", flush=True)
    for name, row in zip(("evaluated", "stepped"), np.transpose(ratios), strict=True):
        print(f"{name}: 100 boxes cost {np.median(row):.2f} times as much as one (median), {row.max():.2f} at worst")


if __name__ == "__main__":
    main()
