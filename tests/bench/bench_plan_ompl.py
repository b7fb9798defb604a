"""The trees against OMPL's RRTConnect: the same walls, the same verdicts, nodes and path lengths side by side.

    pip install ompl==2.0.1 && python tests/bench/bench_plan_ompl.py [TASKS]

OMPL is no dependency of armgap; this cross-check alone uses it. OMPL's paths are checked by Coal, ours too.
"""

from __future__ import annotations

import sys
import time
from itertools import pairwise

import numpy as np
from ompl import base, geometric

from ident.robot.arm import ArmModel
from plan.geometry.boxes import Box
from plan.geometry.scene import Scene
from plan.initial.rrt import TreeOptions, connect, prune

RESOLUTION = 0.04
SECONDS = 5.0


def random_scene(arm: ArmModel, rng: np.random.Generator) -> tuple[Scene, np.ndarray]:
    """Three to six boxes, and two free ends whose straight line is blocked."""
    while True:
        places = rng.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 0.9], (rng.integers(3, 7), 3))
        boxes = [Box(f"box {k}", 0, np.eye(3), p, rng.uniform(0.05, 0.15, 3)) for k, p in enumerate(places)]
        scene = Scene.build(arm, boxes)
        ends = rng.uniform(np.radians([-150, -90, -130]), np.radians([150, 90, 130]), (2, 3))
        line = ends[0] + np.linspace(0, 1, 60)[:, None] * (ends[1] - ends[0])
        if scene.separation(ends).min() > 0.01 and scene.separation(line).min() < -0.02:
            return scene, ends


def by_ompl(scene: Scene, ends: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray | None:
    """Positions of OMPL's path, or None."""
    space = base.RealVectorStateSpace(3)
    bounds = base.RealVectorBounds(3)
    for j in range(3):
        bounds.setLow(j, float(low[j]))
        bounds.setHigh(j, float(high[j]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    setup.setStateValidityChecker(lambda s: bool(scene.separation(np.array([[s[0], s[1], s[2]]]))[0] > 0.0))
    setup.getSpaceInformation().setStateValidityCheckingResolution(RESOLUTION / space.getMaximumExtent())
    states = []
    for end in ends:
        state = space.allocState()
        for j in range(3):
            state[j] = float(end[j])
        states.append(state)
    setup.setStartAndGoalStates(states[0], states[1])
    planner = geometric.RRTConnect(setup.getSpaceInformation())
    planner.setRange(0.35)
    setup.setPlanner(planner)
    setup.solve(SECONDS)
    if not setup.haveExactSolutionPath():
        return None
    return np.array([[s[0], s[1], s[2]] for s in setup.getSolutionPath().getStates()])


def length(points: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def collides(scene: Scene, points: np.ndarray) -> bool:
    """By Coal, at half the trees' resolution; touches of less than 3 mm between their samples are let pass."""
    dense = [a + np.linspace(0, 1, 60)[:, None] * (b - a) for a, b in pairwise(points)]
    return min(scene.proximity.clearance(q) for q in np.concatenate(dense)) < -3e-3


def main(count: int) -> None:
    arm = ArmModel.load("tm5-900").locked(["joint_4", "joint_5", "joint_6"], [0.0, 0.0, 0.0])
    rng = np.random.default_rng(5)
    agree, faults, rows = 0, np.zeros(2, dtype=int), []
    for i in range(count):
        scene, ends = random_scene(arm, rng)
        low, high = np.maximum(arm.lower, ends.min(axis=0) - np.pi), np.minimum(arm.upper, ends.max(axis=0) + np.pi)
        started = time.perf_counter()
        ours = connect(scene, *ends, low, high, TreeOptions(resolution=RESOLUTION), np.random.default_rng(i))
        middle = time.perf_counter()
        theirs = by_ompl(scene, ends, low, high)
        ended = time.perf_counter()
        agree += ours.found == (theirs is not None)
        if ours.found and theirs is not None:
            options = TreeOptions(resolution=RESOLUTION)
            lengths = length(prune(scene, ours.points, options)), length(prune(scene, theirs, options))
            faults += [collides(scene, ours.points), collides(scene, theirs)]
            rows.append((middle - started, ended - middle, length(ours.points), length(theirs), *lengths))
    table = np.median(np.array(rows), axis=0)
    hit = f"paths that touch between their samples: ours {faults[0]}, OMPL {faults[1]}"
    print(f"{count} tasks; same verdict in {agree}; both found a way in {len(rows)}; {hit}")
    print(f"median time: ours {1000 * table[0]:.1f} ms, OMPL {1000 * table[1]:.1f} ms (its checks go through Python)")
    plain, cut = f"ours {table[2]:.2f}, OMPL {table[3]:.2f}", f"{table[4]:.2f} and {table[5]:.2f}"
    print(f"median length [rad]: {plain}; after pruning {cut}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 50)
