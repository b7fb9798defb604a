"""A task on one grid of coefficients: its variables, and what its derivatives by them are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int
from plan.planners.subproblem import Bounds
from plan.planners.transcription import ACTING, DEGREE, Grid, States
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Shortest and longest duration, as multiples of the task's own.
SHORTEST_SHARE = 0.02
LONGEST_SHARE = 50.0


@dataclass(frozen=True, eq=False)
class TaskOnGrid:
    """The variables are the free coefficients, coefficient by coefficient, and for the time
    objective the duration as a share of the task's own.
    """

    problem: PlanningProblem
    grid: Grid  # knots and nodes

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.problem.n

    @property
    def timed(self) -> bool:
        """Whether the duration is a variable."""
        return self.problem.objective == "time"

    @property
    def size(self) -> int:
        """Number of variables."""
        return self.grid.free * self.n + self.timed

    @cached_property
    def reference(self) -> float:
        """Duration by which durations are measured [s]."""
        return float(self.problem.durations.sum())

    @property
    def bounds(self) -> Bounds:
        """Position limits, and no farther from the ends and the via points than the reach."""
        problem = self.problem
        points = problem.with_ends(problem.vias)
        lowest = np.maximum(points.min(axis=0) - problem.radius, problem.limits.lower)
        highest = np.minimum(points.max(axis=0) + problem.radius, problem.limits.upper)
        low = np.tile(lowest, self.grid.free)
        high = np.tile(highest, self.grid.free)
        if self.timed:
            low = np.append(low, SHORTEST_SHARE)
            high = np.append(high, LONGEST_SHARE)
        return low, high

    def join(self, free: Float[Array, "F n"], duration: float) -> Float[Array, " d"]:
        """Variables of coefficients and a duration."""
        flat = free.reshape(-1)
        return np.append(flat, duration / self.reference) if self.timed else flat.copy()

    def split(self, x: Float[Array, " d"]) -> tuple[Float[Array, "C n"], float]:
        """All coefficients and the duration [s]."""
        count = self.grid.free * self.n
        duration = float(x[count]) * self.reference if self.timed else self.reference
        free = x[:count].reshape(-1, self.n)
        return self.grid.coefficients(free, self.problem.start, self.problem.goal), duration

    def splines(self, x: Float[Array, " d"]) -> Splines:
        """The trajectory."""
        return self.grid.splines(*self.split(x))

    def changes(self, states: States, duration: float, step: Float[Array, " d"]) -> States:
        """How a step changes position, speed and acceleration at the nodes, to first order.

        Args:
            states: At the nodes.
            duration: Of the trajectory [s].
            step: Change of the variables.
        """
        count = self.grid.free * self.n
        free = step[:count].reshape(-1, self.n)
        still = np.zeros(self.n)
        coefficients = self.grid.coefficients(free, still, still)
        changes = self.grid.states(coefficients, duration)
        if not self.timed:
            return changes
        longer = float(step[count]) * self.reference / duration
        _, dq, ddq = states
        return changes[0], changes[1] - longer * dq, changes[2] - 2.0 * longer * ddq

    def sum_over_nodes(self, by_states: Sequence[Array], duration: float) -> Float[Array, " d"]:
        """Sums derivatives by the nodes' states into derivatives by the coefficients."""
        slopes = np.zeros((self.grid.sections + DEGREE, self.n))
        for order, slope in enumerate(by_states):
            slopes += self._designs[order].T @ slope / duration**order
        return slopes[self.grid.held : -self.grid.held].reshape(-1)

    @cached_property
    def _designs(self) -> Float[Array, "3 T C"]:
        """What each coefficient gives at each node: position and two derivatives by the share."""
        designs = np.zeros((3, len(self.grid.shares), self.grid.sections + DEGREE))
        rows = np.arange(len(self.grid.shares))[:, None]
        designs[:, rows, self.grid.first[:, None] + ACTING] = self.grid.bases[:3]
        return designs

    def node_rows(
        self,
        nodes: Int[Array, " r"],
        local: Sequence[Array],
        states: Sequence[Array],
        duration: float,
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some nodes.

        Args:
            nodes: Numbers of the nodes.
            local: Derivatives of each row by position, speed and so on at its node.
            states: Position, speed and so on at all nodes.
            duration: Of the trajectory [s].
        """
        bases = self.grid.bases[:, nodes]
        first = self.grid.first[nodes]
        return self.rows_at(bases, first, local, [state[nodes] for state in states], duration)

    def rows_at(
        self,
        bases: Float[Array, "4 r 4"],
        first: Int[Array, " r"],
        local: Sequence[Array],
        states: Sequence[Array] | None = None,
        duration: float = 1.0,
    ) -> Float[Array, "r d"]:
        """Rows from derivatives by the states at some places.

        By the four coefficients that act there, and by the time.

        Args:
            bases, first: What these coefficients give at the places, and the first of them.
            local: Derivatives of each row by position, speed and so on at its place.
            states: Position, speed and so on there; None where time has no part in it.
            duration: Of the trajectory [s].
        """
        count = self.grid.free * self.n
        wide = (DEGREE + 1) * self.n
        values = np.zeros((len(first), DEGREE + 1, self.n))
        for order, slope in enumerate(local):
            values += bases[order][:, :, None] * slope[:, None, :] / duration**order
        which = first[:, None] + ACTING - self.grid.held
        columns = which[:, :, None] * self.n + np.arange(self.n)
        columns = columns.reshape(-1, wide)
        # Columns of held coefficients fall away; no column stands twice in a row.
        inside = (columns >= 0) & (columns < count)
        padded = np.zeros((len(columns), count + 1))
        rows = np.arange(len(columns))[:, None]
        padded[rows, np.where(inside, columns, count)] = values.reshape(-1, wide)
        matrix = padded[:, :count]
        if not self.timed:
            return matrix
        by_time = np.zeros(len(first))
        if states is not None:
            for order in range(1, len(local)):
                change = order * (local[order] * states[order]).sum(axis=1)
                by_time -= change * self.reference / duration
        return np.concatenate([matrix, by_time[:, None]], axis=1)
