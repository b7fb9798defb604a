"""Where searches may begin, the quickest first: the line, a way of trees, ways round the obstacles, bent lines."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from plan.initial.detours import iterate_seeds
from plan.initial.rrt import TreeOptions, connect, edge_is_free, prune
from plan.initial.starts import from_vias, straight
from plan.problem.problem import PlanningProblem

# Nodes and reach beyond the ends [rad] of the trees that look for any way at all, the quick look first.
QUICK = ((400, 0.7), (3000, np.pi), (12000, np.pi))
# Nodes of the trees that look for further ways.
FURTHER = 2000
# Bent lines: standard deviation of the middle's offset [rad].
BEND = 0.6


def iterate_ways(problem: PlanningProblem, rng: np.random.Generator) -> Iterator[PlanningProblem]:
    """Initial trajectories without end, so that the one who asks decides when it is enough.

    Args:
        problem: The task, started from the straight line.
        rng: Source of randomness.

    Yields:
        The task from one initial trajectory after the other, each with its label.
    """
    options = TreeOptions(margin=problem.margin)
    blocked = len(problem.scene.pairs) > 0 and not edge_is_free(problem.scene, problem.start, problem.goal, options)
    if blocked:
        way = _any_way(problem, rng)
        if way is not None:
            yield from_vias(problem, way, "trees", problem.via_count)
    yield problem
    number = 0
    seeds = iterate_seeds(problem, rng, replace(options, nodes=FURTHER)) if blocked else iter(())
    while True:
        number += 1
        for seed in seeds:
            if not seed.reason and len(seed.vias):
                yield from_vias(problem, seed.vias, seed.label, problem.via_count)
                break
        if blocked:
            way = _drawn_way(problem, rng, FURTHER)
            if way is not None:
                yield from_vias(problem, way, f"trees {number}", problem.via_count)
        yield _bent(problem, rng, f"bent {number}")


def _any_way(problem: PlanningProblem, rng: np.random.Generator) -> Float[Array, "V n"] | None:
    """Via points of the first way found; None if there is none."""
    for nodes, reach in QUICK:
        found = _drawn_way(problem, rng, nodes, reach)
        if found is not None:
            return found
    return None


def _drawn_way(
    problem: PlanningProblem, rng: np.random.Generator, nodes: int, reach: float = np.pi
) -> Float[Array, "V n"] | None:
    options = TreeOptions(margin=problem.margin, nodes=nodes)
    ends = np.stack([problem.start, problem.goal])
    low = np.maximum(problem.limits.lower, ends.min(axis=0) - reach)
    high = np.minimum(problem.limits.upper, ends.max(axis=0) + reach)
    path = connect(problem.scene, problem.start, problem.goal, low, high, options, rng)
    if not path.found:
        return None
    return prune(problem.scene, path.points, options)[1:-1]


def _bent(problem: PlanningProblem, rng: np.random.Generator, label: str) -> PlanningProblem:
    """The straight line bent by a random amount, most in its middle."""
    count = max(problem.via_count, 3)
    shares = np.arange(1, count + 1) / (count + 1)
    bend: Array = rng.normal(size=problem.n) * BEND
    vias = straight(problem.start, problem.goal, count) + np.sin(np.pi * shares)[:, None] * bend
    return from_vias(problem, np.clip(vias, problem.limits.lower, problem.limits.upper), label, count)
