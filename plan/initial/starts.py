"""Where searches may begin: the line, ways of trees and round obstacles, bent lines.

Ways that keep rules stand in `rule_ways`, how long a motion takes at its limits in `limit_times`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from itertools import count

import numpy as np

from ident.arrays import Array, Float
from plan.initial.trees import Seed, Trees, endless, iterate_seeds
from plan.initial.vias import from_vias, straight, time_stamps
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Nodes and reach beyond the ends [rad] of the trees that look for any way at all, the quick look
# first: trees that may go anywhere come back by ways that are twice as long as need be.
QUICK = ((400, 0.7), (1500, 1.5), (3000, np.pi), (1500, 1.5))
# The patient ones are for where no other found any.
PATIENT = (20000, np.pi)
# Nodes of the trees that look for further ways, and how far they reach, the second time where the
# first finds none.
FURTHER = 2000
REACHES = (1.5, np.pi)
# Bent lines: standard deviation of the middle's offset [rad]; where something is in the way, of so
# many that are drawn the one that collides least.
BEND = 0.6
DRAWN = 6
# Via points of a bent line, at the least, where the task lets them grow in number.
LEAST_BENT = 3
# Sections by which a way of trees is followed closely, fewest first, and factors by which it is
# then slowed down.
CLOSELY = (20, 40, 80)
SLOWER = 1.5 ** np.arange(9)


def iterate_ways(
    problem: PlanningProblem,
    rng: np.random.Generator,
    solved: Callable[[], bool],
    left: Callable[[], float] = endless,
) -> Iterator[PlanningProblem]:
    """Initial trajectories without end, so that the one who asks decides when it is enough.

    Half of the further ones are bent lines: in cluttered tasks the best motion began more often at
    one of them than at a way of trees or through a point of the midplane.

    Args:
        problem: The task, started from the straight line.
        rng: Source of randomness.
        solved: Whether a plan is known; if not after a way of trees, it is followed closely, and if
            not after the line either, trees look farther.
        left: Processor time that is left, at which trees end [s].

    Yields:
        The task from one initial trajectory after the other, each with its label.
    """
    trees = Trees.of(problem, rng, left)
    blocked = False
    if len(problem.scene.pairs) > 0:
        blocked = not trees.edge_is_free(problem.start, problem.goal)
    if blocked:
        yield from _ways_of_trees(problem, trees, QUICK[:1], "trees", solved)
    yield problem
    if blocked and not solved():
        yield from _ways_of_trees(problem, trees, QUICK[1:], "farther trees", solved)
    seeds: Iterator[Seed] = iter(())
    if blocked:
        seeds = iterate_seeds(problem, trees, FURTHER)
    for number in count(1):
        yield _least_colliding_bend(problem, rng, f"bent {number}", DRAWN if blocked else 1)
        if number % 2 == 1:
            further = _further_way(problem, trees) if blocked else None
            if further is not None:
                yield from_vias(problem, further, f"trees {(number + 1) // 2}", problem.via_count)
            continue
        seed = next(seeds, None)
        if seed is not None and not seed.reason and len(seed.vias):
            yield from_vias(problem, seed.vias, seed.label, problem.via_count)


def _ways_of_trees(
    problem: PlanningProblem,
    trees: Trees,
    looks: Sequence[tuple[int, float]],
    label: str,
    solved: Callable[[], bool],
) -> Iterator[PlanningProblem]:
    """The task from the way that trees find; then the same followed closely, if nothing is solved.

    Args:
        problem: The task.
        trees: Look for the way.
        looks: Nodes and reach of each look [rad].
        label: Of the trajectory.
        solved: Whether a plan is known.
    """
    way = any_way(problem, trees, looks)
    if way is None:
        return
    yield from_vias(problem, way, label, problem.via_count)
    if not solved():
        yield follow_closely(problem, way)


def _further_way(problem: PlanningProblem, trees: Trees) -> Float[Array, "V n"] | None:
    """Via points of another way of trees, which look farther where they find none near the ends."""
    for reach in REACHES:
        way = trees.vias(problem.start, problem.goal, FURTHER, reach)
        if way is not None:
            return way
    return None


def _least_colliding_bend(
    problem: PlanningProblem, rng: np.random.Generator, label: str, drawn: int
) -> PlanningProblem:
    """Of so many bent lines that are drawn the one that collides least."""
    bends = [_bent(problem, rng, label) for _ in range(drawn)]
    if drawn == 1:
        return bends[0]
    return min(bends, key=lambda bent: float(bent.initial_evaluation.collision[0]))


def follow_closely(problem: PlanningProblem, way: Float[Array, "V n"]) -> PlanningProblem:
    """The task from a trajectory that is bent round the way's corners, and nowhere else far off it.

    A spline through a few via points leaves the edges between them, and in a narrow place gradients
    alone don't find back. Where time is free, it takes as long as it must for the limits to hold.
    """
    splines = _near_way(problem, way)
    factors = SLOWER if problem.objective == "time" else (1.0,)
    for factor in factors:
        slowed = Splines(splines.points, splines.durations * factor)
        slower = problem.with_initial(slowed, label="trees, closely")
        evaluation = slower.initial_evaluation
        if not evaluation.speed[0] + evaluation.torque[0] > 0.0:
            break
    return slower


def _near_way(problem: PlanningProblem, way: Float[Array, "V n"]) -> Splines:
    """The spline of fewest sections that keeps clear on a way; else the one that keeps clearest."""
    points = problem.with_ends(way)
    total = float(problem.durations.sum())
    durations = time_stamps(points, problem.limits.speed, total)
    stamps = np.concatenate([[0.0], np.cumsum(durations)])
    clearest = None
    best = -np.inf
    for sections in CLOSELY:
        even = np.linspace(0.0, total, sections + 1)
        columns = [np.interp(even, stamps, column) for column in points.T]
        knots = np.stack(columns, axis=1)
        splines = Splines(knots[None], np.full((1, sections), total / sections))
        gaps, _ = problem.scene.sweep(splines, problem.margins)
        gap = float(gaps[0])
        if clearest is None or gap > best:
            clearest = splines
            best = gap
        if gap >= 0.0:
            break
    assert clearest is not None
    return clearest


def any_way(
    problem: PlanningProblem, trees: Trees, looks: Sequence[tuple[int, float]] = QUICK
) -> Float[Array, "V n"] | None:
    """Via points of the first way for which there is time; else of the quickest one.

    Args:
        problem: The task.
        trees: For its scene and limits.
        looks: Sizes of the searches in turn: nodes and reach, as `Trees.vias` takes them.

    Returns:
        None if there is no way at all.
    """
    best = None
    quickest = np.inf
    for nodes, reach in looks:
        way = trees.vias(problem.start, problem.goal, nodes, reach)
        if way is None:
            continue
        distances = np.abs(np.diff(problem.with_ends(way), axis=0))
        need = float(np.max(distances / problem.limits.speed, axis=1).sum())
        if problem.objective == "time" or need < problem.durations.sum():
            return way
        if need < quickest:
            best = way
            quickest = need
    if best is None and looks != QUICK[:1]:
        return trees.vias(problem.start, problem.goal, *PATIENT)
    return best


def _bent(problem: PlanningProblem, rng: np.random.Generator, label: str) -> PlanningProblem:
    """The straight line bent by a random amount, most in its middle."""
    vias = problem.via_count
    if problem.grows:
        vias = max(vias, LEAST_BENT)
    shares = np.arange(1, vias + 1) / (vias + 1)
    bend: Array = rng.normal(size=problem.n) * BEND
    height = np.sin(np.pi * shares)[:, None]
    points = straight(problem.start, problem.goal, vias) + height * bend
    inside = np.clip(points, problem.limits.lower, problem.limits.upper)
    return from_vias(problem, inside, label, vias)
