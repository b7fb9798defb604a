"""Every trajectory of a grid: the paper's 11⁶, exact, by a loop that shares what trajectories have in common.

The states of a joint depend on its own via angles alone, so each joint has levels^V courses. And for given courses
of joints 2 and 3 the torque is a short polynomial in the first joint's speed and acceleration, whose coefficients
take a few Newton-Euler passes. That leaves about a hundred operations for each of the 1.8 million trajectories.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from plan.dynamics.power import ChainTorque, section_nodes
from plan.errors import MethodError
from plan.paper.brute_loop import BruteLoop, Courses
from plan.planners.base import Ledger, Planner
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

CHUNK = 512


@dataclass(frozen=True)
class BruteForce(Planner):
    """The grid's optimum.

    Via i may lie anywhere from (i − 1)/V to i/V of the way from start to goal, joint by joint, as in the paper
    (its 11⁶ is levels^(joints · vias); every printed value lies on that grid). The energies of all grid points are
    computed first; then the limits and the clearance are checked in the order of energy until one point keeps all.

    Attributes:
        levels: Values of each variable.
        most: Largest grid that is taken on.
    """

    levels: int = 11
    most: int = 20_000_000
    name: ClassVar[str] = "brute"
    threads: ClassVar[int] = 2

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Goes through the grid of the first problem.

        Raises:
            MethodError: The grid is too large, or durations are free beside the via points.
        """
        problem = problems[0]
        points = self.levels**problem.dimension
        if points > self.most:
            raise MethodError(
                "--method brute",
                f"the grid has {self.levels}^{problem.dimension} points",
                "use fewer via points or free variables, or another method",
            )
        model = problem.model
        factored = isinstance(model, ChainTorque) and problem.n == 3 and problem.objective == "energy"
        if factored and problem.free == "vias":
            self._factored(problem, ledger)
        else:
            self._plain(problem, ledger)

    def _factored(self, problem: PlanningProblem, ledger: Ledger) -> None:
        assert isinstance(problem.model, ChainTorque)
        courses = make_courses(problem, self.levels)
        loop = BruteLoop(problem.model, courses, problem.metric)
        count = len(courses.vias[0])
        energy = np.full((count, count, count), np.inf)
        for i in range(count):
            energy[i] = loop.block(i)
            ledger.count(count * count)
            if ledger.remaining == 0 and i + 1 < count:
                ledger.notes.append("the budget ended the search")
                break
            if ledger.progress is not None:
                ledger.progress(ledger.evaluations, count**3, float(energy[i].min()))
        self._check_best(problem, courses, energy, loop.exact, ledger)

    def _check_best(
        self, problem: PlanningProblem, courses: Courses, energy: Array, exact: bool, ledger: Ledger
    ) -> None:
        """Evaluates grid points in the order of their energy until no later one can be the best.

        The order's energies come from tables where the default net is used. They are off by some figure; the largest
        difference seen among the evaluated ones, three times over, is granted to the rest.
        """
        flat = energy.reshape(-1)
        order = np.argsort(flat)
        best, slack = np.inf, 0.0
        for i in range(0, len(order), CHUNK):
            rows = order[i : i + CHUNK]
            if not np.isfinite(flat[rows[0]]) or flat[rows[0]] > best + slack:
                return
            second, third, first = np.unravel_index(rows, energy.shape)
            vias = np.stack([courses.vias[0][first], courses.vias[1][second], courses.vias[2][third]], axis=-1)
            ledger.count(-len(rows))  # these were counted with their energies
            found = ledger.evaluate(problem, vias.reshape(len(rows), -1))
            if found.feasible.any():
                best = min(best, float(found.cost[found.feasible].min()))
            if not exact:
                slack = max(slack, 3.0 * float(np.abs(found.cost - flat[rows]).max()))

    def _plain(self, problem: PlanningProblem, ledger: Ledger) -> None:
        """Grid over via cells and over durations from a third to three times the initial ones."""
        low, high = _cells(problem)
        axes = [np.linspace(a, b, self.levels) for a, b in zip(low, high, strict=True)]
        rows: list[tuple[float, ...]] = []
        for row in product(*axes):
            rows.append(row)
            if len(rows) == CHUNK:
                ledger.evaluate(problem, np.array(rows))
                rows = []
        if rows:
            ledger.evaluate(problem, np.array(rows))


def _cells(problem: PlanningProblem) -> tuple[Array, Array]:
    """Lowest and highest grid value of every decision variable."""
    vias = problem.via_count
    ends = [problem.start + (problem.goal - problem.start) * k / max(vias, 1) for k in range(vias + 1)]
    low = np.array(ends[:-1]).reshape(vias, problem.n)
    high = np.array(ends[1:]).reshape(vias, problem.n)
    return problem.encode(low, problem.durations / 3), problem.encode(high, problem.durations * 3)


def make_courses(problem: PlanningProblem, levels: int) -> Courses:
    """Via angles and states at the quadrature nodes of every joint's levels^V courses."""
    low, high = (values.reshape(problem.via_count, problem.n) for values in _cells(problem))
    s, w = section_nodes()
    inside = w > 0
    vias, states = [], []
    for j in range(problem.n):
        axes = [np.linspace(low[i, j], high[i, j], levels) for i in range(problem.via_count)]
        own = np.array(list(product(*axes)))
        ends = np.full((len(own), 1), problem.start[j]), np.full((len(own), 1), problem.goal[j])
        points = np.concatenate([ends[0], own, ends[1]], axis=1)[:, :, None]
        splines = Splines(points, np.repeat(problem.durations[None], len(own), axis=0))
        vias.append(own)
        states.append(np.stack([part[:, :, 0] for part in splines.states(s[inside])]))
    weights = (problem.durations[:, None] * w[inside]).reshape(-1)
    return Courses(tuple(vias), tuple(_by_node(part) for part in states), weights)


def _by_node(states: Float[Array, "3 M K"]) -> Float[Array, "3 K M"]:
    """Courses innermost, so that a compiled loop over them runs in vector registers."""
    return np.ascontiguousarray(states.transpose(0, 2, 1))
