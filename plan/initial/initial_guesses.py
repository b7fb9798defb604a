"""Where searches may begin, the quickest first: the line, a way of trees, ways round the obstacles, bent lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from plan.initial.rrt import TreeOptions, connect, edge_is_free, endless, prune
from plan.initial.rrt_starts import iterate_seeds
from plan.initial.starts import from_vias, straight, time_stamps
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Nodes and reach beyond the ends [rad] of the trees that look for any way at all, the quick look first: trees that may
# go anywhere come back by ways that are twice as long as need be. The patient ones are for where no other found any.
QUICK, PATIENT = ((400, 0.7), (1500, 1.5), (3000, np.pi), (1500, 1.5)), (20000, np.pi)
# Nodes of the trees that look for further ways, and how far they reach, the second time where the first finds none.
FURTHER, REACHES = 2000, (1.5, np.pi)
# Bent lines: standard deviation of the middle's offset [rad]; where something is in the way, of so many that are drawn
# the one that collides least.
BEND, DRAWN = 0.6, 6
# Sections by which a way of trees is followed closely, fewest first, and factors by which it is then slowed down.
CLOSELY, SLOWER = (20, 40, 80), 1.5 ** np.arange(9)


def iterate_ways(
    problem: PlanningProblem, rng: np.random.Generator, solved: Callable[[], bool], left: Callable[[], float] = endless
) -> Iterator[PlanningProblem]:
    """Initial trajectories without end, so that the one who asks decides when it is enough.

    Args:
        problem: The task, started from the straight line.
        rng: Source of randomness.
        solved: Whether a plan is known; if not after a way of trees, it is followed closely, and if not after the line
            either, trees look farther.
        left: Processor time that is left, at which trees end [s].

    Yields:
        The task from one initial trajectory after the other, each with its label.
    """
    options = TreeOptions(margins=problem.margins)
    blocked = len(problem.scene.pairs) > 0 and not edge_is_free(problem.scene, problem.start, problem.goal, options)
    if blocked:
        yield from _ways_of_trees(problem, _any_way(problem, rng, QUICK[:1], left), "trees", solved)
    yield problem
    if blocked and not solved():
        yield from _ways_of_trees(problem, _any_way(problem, rng, QUICK[1:], left), "farther trees", solved)
    number = 0
    seeds = iterate_seeds(problem, rng, replace(options, nodes=FURTHER, left=left)) if blocked else iter(())
    while True:
        number += 1
        seed = next(seeds, None)
        if seed is not None and not seed.reason and len(seed.vias):
            yield from_vias(problem, seed.vias, seed.label, problem.via_count)
        if blocked:
            drawn = (drawn_way(problem, rng, FURTHER, reach, left=left) for reach in REACHES)
            way = next((one for one in drawn if one is not None), None)
            if way is not None:
                yield from_vias(problem, way, f"trees {number}", problem.via_count)
        bends = [_bent(problem, rng, f"bent {number}") for _ in range(DRAWN if blocked else 1)]
        yield min(bends, key=lambda bent: float(bent.initial_evaluation.collision[0])) if blocked else bends[0]


def _ways_of_trees(
    problem: PlanningProblem, way: Float[Array, "V n"] | None, label: str, solved: Callable[[], bool]
) -> Iterator[PlanningProblem]:
    """The task from a way of trees, and closely along it where that brings no plan; nothing without a way."""
    if way is not None:
        yield from_vias(problem, way, label, problem.via_count)
        if not solved():
            yield follow_closely(problem, way)


def follow_closely(problem: PlanningProblem, way: Float[Array, "V n"]) -> PlanningProblem:
    """The task from a trajectory that is bent round the way's corners, and nowhere else far from it.

    A spline through a few via points leaves the edges between them, and in a narrow place gradients alone don't find
    back. Where time is free, it takes as long as it must for the limits to hold.
    """
    points = np.concatenate([[problem.start], way, [problem.goal]])
    total = float(problem.durations.sum())
    stamps = np.concatenate([[0.0], np.cumsum(time_stamps(points, problem.limits.speed, total))])
    found = []
    for count in CLOSELY:
        even = np.linspace(0.0, total, count + 1)
        near = np.stack([np.interp(even, stamps, column) for column in points.T], axis=1)
        splines = Splines(near[None], np.full((1, count), total / count))
        found.append((-float(problem.scene.sweep(splines, problem.margins)[0][0]), splines))
        if -found[-1][0] >= 0.0:
            break
    splines = min(found, key=lambda pair: pair[0])[1]
    for factor in SLOWER if problem.objective == "time" else (1.0,):
        slower = problem.with_initial(Splines(splines.points, splines.durations * factor), label="trees, closely")
        if not slower.initial_evaluation.speed[0] + slower.initial_evaluation.torque[0] > 0.0:
            break
    return slower


def _any_way(
    problem: PlanningProblem,
    rng: np.random.Generator,
    looks: Sequence[tuple[int, float]] = QUICK,
    left: Callable[[], float] = endless,
) -> Float[Array, "V n"] | None:
    """Via points of the first way for which there is time; else of the quickest one found, None if there is none."""
    best, quickest = None, np.inf
    for nodes, reach in looks:
        found = drawn_way(problem, rng, nodes, reach, left=left)
        if found is None:
            continue
        points = np.concatenate([[problem.start], found, [problem.goal]])
        need = float(np.max(np.abs(np.diff(points, axis=0)) / problem.limits.speed, axis=1).sum())
        if problem.objective == "time" or need < problem.durations.sum():
            return found
        best, quickest = (found, need) if need < quickest else (best, quickest)
    return drawn_way(problem, rng, *PATIENT, left=left) if best is None and looks != QUICK[:1] else best


def drawn_way(
    problem: PlanningProblem,
    rng: np.random.Generator,
    nodes: int,
    reach: float,
    ends: tuple[Float[Array, " n"], Float[Array, " n"]] | None = None,
    left: Callable[[], float] = endless,
) -> Float[Array, "V n"] | None:
    """Via points of a way of trees between start and goal, or other ends; None where so many nodes find none."""
    options = TreeOptions(margins=problem.margins, nodes=nodes, left=left)
    ends = (problem.start, problem.goal) if ends is None else ends
    low = np.maximum(problem.limits.lower, np.min(ends, axis=0) - reach)
    high = np.minimum(problem.limits.upper, np.max(ends, axis=0) + reach)
    path = connect(problem.scene, *ends, low, high, options, rng)
    if not path.found:
        return None
    return prune(problem.scene, path.points, options)[1:-1]


def _bent(problem: PlanningProblem, rng: np.random.Generator, label: str) -> PlanningProblem:
    """The straight line bent by a random amount, most in its middle."""
    count = max(problem.via_count, 3) if problem.grows else problem.via_count
    shares = np.arange(1, count + 1) / (count + 1)
    bend: Array = rng.normal(size=problem.n) * BEND
    vias = straight(problem.start, problem.goal, count) + np.sin(np.pi * shares)[:, None] * bend
    return from_vias(problem, np.clip(vias, problem.limits.lower, problem.limits.upper), label, count)
