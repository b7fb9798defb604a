"""Every trajectory of a grid, the paper's 11⁶.

Costs first, which are cheap, then limits in the order of cost.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from plan.dynamics.power import energy
from plan.planners.base import Ledger, Planner
from plan.problem.cost import plan_cost
from plan.problem.problem import PlanningProblem

# Trajectories whose cost, and whose limits, are computed at once.
COSTS = 4096
CHECKED = 512
# Pieces of that size that each thread works through before the budget is looked at.
ROUND = 8
LARGEST = 20_000_000  # grid that is taken on


@dataclass(frozen=True)
class BruteForce(Planner):
    """The grid's optimum.

    Via i may lie anywhere from (i − 1)/V to i/V of the way from start to goal, joint by joint, as
    in the paper (its 11⁶ is levels^(joints · vias); every printed value lies on that grid), and a
    duration from a third of the initial one to three times that. The costs of all grid points are
    computed first; then the limits and the clearance are checked in the order of cost until one
    point keeps all.
    """

    levels: int = 11  # values of each variable
    name: ClassVar[str] = "brute"

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Goes through the grid of the first problem.

        Raises:
            InputError: The grid is too large.
        """
        problem = problems[0]
        points = self.levels**problem.dimension
        if points > LARGEST:
            raise InputError(
                "--method brute",
                f"the grid has {self.levels}^{problem.dimension} points",
                "use fewer via points or free variables, or another method",
            )
        axes = grid_axes(problem, self.levels)
        ledger.expected = points
        costs = _costs_of_grid(problem, axes, points, ledger)
        order = np.argsort(costs)
        for i in range(0, len(order), CHECKED):
            rows = order[i : i + CHECKED]
            best = ledger.best
            if not np.isfinite(costs[rows[0]]) or (
                best is not None and best.feasible and costs[rows[0]] > best.cost
            ):
                return
            ledger.count(-len(rows))  # they were counted with their costs
            ledger.evaluate(problem, grid_points(axes, rows))


def _costs_of_grid(
    problem: PlanningProblem, axes: Float[Array, "d L"], points: int, ledger: Ledger
) -> Array:
    """Cost of every grid point, on all cores; infinite where the budget ended before."""
    costs = np.full(points, np.inf)
    workers = count_cores()

    def fill(rows: Array) -> None:
        """Enters the costs of some grid points."""
        splines = problem.decode(grid_points(axes, rows))
        costs[rows] = plan_cost(
            problem.objective,
            splines.total,
            lambda: energy(problem.model, splines, problem.metric),
        )

    with ThreadPoolExecutor(workers) as pool:
        for first in range(0, points, COSTS * ROUND * workers):
            last = min(first + COSTS * ROUND * workers, points, first + ledger.remaining)
            list(pool.map(fill, _pieces(first, last)))
            ledger.count(last - first)
            if ledger.remaining == 0 and last < points:
                ledger.notes.append("the budget ended the search")
                break
    return costs


def count_cores() -> int:
    """Cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _pieces(first: int, last: int) -> Iterator[Array]:
    """Numbers of grid points, as many at once as are reckoned together."""
    for begin in range(first, last, COSTS):
        yield np.arange(begin, min(begin + COSTS, last))


def grid_axes(problem: PlanningProblem, levels: int) -> Float[Array, "d L"]:
    """Values of every decision variable on the grid, `levels` each, lowest first."""
    vias = problem.via_count
    ends = np.array(
        [problem.start + (problem.goal - problem.start) * k / max(vias, 1) for k in range(vias + 1)]
    )
    low = problem.encode(ends[:-1], problem.durations / 3)
    high = problem.encode(ends[1:], problem.durations * 3)
    return np.linspace(low, high, levels, axis=1)


def grid_points(axes: Float[Array, "d L"], rows: Array) -> Float[Array, "B d"]:
    """Decision vectors of grid points.

    Args:
        axes: What `grid_axes` gave.
        rows: Numbers (B,) of the points, 0 to L**d - 1, the last variable changing fastest.
    """
    dimension, levels = axes.shape
    places = np.stack(np.unravel_index(rows, (levels,) * dimension), axis=1)
    return np.asarray(axes[np.arange(dimension), places])
