"""The quadratic programme of one step.

Cost to second order, limits to first, and nothing goes farther than the step allows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import clarabel
import daqp
import numpy as np
from scipy import sparse

from ident.arrays import Array, Float

# Second derivative of a slack's price: little beside the price itself, yet enough that the
# active-set method seldom goes round in circles.
BENT = 1e-2
# How closely an inequality is kept, a tenth of what a course's own checks look at.
CLOSE = 1e-6
# Variables beyond which an interior point is quicker where the cost is hardly bent, as that of the
# shortest time.
MANY = 100
# What the active-set method returns of an optimum.
OPTIMAL = 1

Bounds = tuple[Float[Array, " d"], Float[Array, " d"]]
"""Lowest and highest value of each variable."""

Step = tuple[Float[Array, " d"], float]
"""Change of the variables, and by how much cost and weighted shortfall should fall."""


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Linear inequalities: matrix · step ≤ room; one is a whole limit, or a decimetre."""

    matrix: Float[Array, "r d"]  # one row an inequality
    room: Float[Array, " r"]  # what is left of each; below zero where it is broken now

    @classmethod
    def none(cls, size: int) -> ConstraintRows:
        """No inequality."""
        return cls(np.empty((0, size)), np.empty(0))

    @classmethod
    def join(cls, sets: Sequence[ConstraintRows]) -> ConstraintRows:
        """All of several sets."""
        matrix = np.concatenate([rows.matrix for rows in sets])
        room = np.concatenate([rows.room for rows in sets])
        return cls(matrix, room)

    @property
    def shortfall(self) -> float:
        """By how much the worst is broken where the arm is now; zero if none is."""
        return max(0.0, -float(self.room.min(initial=0.0)))

    def shortfall_after(self, step: Float[Array, " d"]) -> float:
        """By how much the worst is broken after a step, to first order."""
        return max(0.0, float((self.matrix @ step - self.room).max(initial=0.0)))

    def in_reach(self, low: Float[Array, " d"], high: Float[Array, " d"]) -> ConstraintRows:
        """Those that a step within bounds can meet."""
        middle = self.matrix @ ((low + high) / 2)
        farthest = middle + np.abs(self.matrix) @ ((high - low) / 2)
        met = farthest > self.room
        return ConstraintRows(self.matrix[met], self.room[met])


@dataclass(frozen=True, eq=False)
class Programme:
    """½ xᵀPx + p·x over matrix · x ≤ room and bounds; x is the step, and a slack for each set."""

    quadratic: Float[Array, "x x"]
    price: Float[Array, " x"]
    matrix: Float[Array, "r x"]
    room: Float[Array, " r"]
    low: Float[Array, " x"]
    high: Float[Array, " x"]


def solve_step(
    gradient: Float[Array, " d"],
    hessian: Float[Array, "d d"],
    groups: Sequence[ConstraintRows],
    weights: Float[Array, " g"],
    bounds: Bounds,
    flat: bool = False,
) -> Step | None:
    """Minimises g·s + ½ sᵀHs + Σ weight · slack, each set of inequalities with its own slack.

    Args:
        gradient, hessian: The cost's.
        groups: Sets of inequalities.
        weights: Price of each set's largest shortfall.
        bounds: Of the step.
        flat: Whether the cost is hardly bent.

    Returns:
        The step; None where the solver gives none.
    """
    low, high = bounds
    plain = _unhindered(gradient, hessian, groups, bounds)
    if plain is not None:
        return plain
    groups = [rows.in_reach(low, high) for rows in groups]
    programme = _write(gradient, hessian, groups, weights, bounds)
    size = len(gradient)
    before = sum(w * rows.shortfall for w, rows in zip(weights, groups, strict=True))

    def promise(x: Array) -> Step:
        """The step within its bounds, and by how much it should bring cost and shortfall down."""
        step = np.clip(x[:size], low, high)
        slack = np.array([rows.shortfall_after(step) for rows in groups])
        cost = float(gradient @ step + 0.5 * step @ (hessian @ step) + weights @ slack)
        return step, before - cost

    x = _active_set(programme) if size <= MANY or not flat else None
    if x is not None and promise(x)[1] > 0.0:
        return promise(x)
    # No step at all promises nothing: an answer below that is none.
    x = _interior_point(programme)
    return None if x is None else promise(x)


def _write(
    gradient: Float[Array, " d"],
    hessian: Float[Array, "d d"],
    groups: Sequence[ConstraintRows],
    weights: Float[Array, " g"],
    bounds: Bounds,
) -> Programme:
    """The programme of a step: every row is an inequality less its set's slack."""
    size = len(gradient)
    count = len(groups)
    lengths = [len(rows.room) for rows in groups]
    quadratic = BENT * np.eye(size + count)
    quadratic[:size, :size] = hessian
    matrix = np.zeros((sum(lengths), size + count))
    matrix[:, :size] = np.concatenate([rows.matrix for rows in groups])
    slacks = size + np.repeat(np.arange(count), lengths)
    matrix[np.arange(len(matrix)), slacks] = -1.0
    return Programme(
        quadratic,
        np.concatenate([gradient, weights]),
        matrix,
        np.concatenate([rows.room for rows in groups]),
        np.append(bounds[0], np.zeros(count)),
        np.append(bounds[1], np.full(count, np.inf)),
    )


def _active_set(programme: Programme) -> Array | None:
    """The optimum by a dual active-set method; None where it goes round in circles.

    It is a few times as quick as the other.

    Source: D. Arnström, A. Bemporad, D. Axehill, A dual active-set solver for embedded quadratic
    programming using recursive LDLᵀ updates, IEEE Trans. Autom. Control 67 (2022) 4362.
    """
    room = programme.room
    upper = np.concatenate([programme.high, room])
    lower = np.concatenate([programme.low, np.full(len(room), -np.inf)])
    plain = np.zeros(len(upper), dtype=np.intc)
    x, _, status, _ = daqp.solve(
        programme.quadratic,
        programme.price,
        programme.matrix,
        upper,
        lower,
        plain,
        primal_tol=CLOSE,
    )
    if status != OPTIMAL or not np.isfinite(x).all():
        return None
    return np.array(x)


def _interior_point(programme: Programme) -> Array | None:
    """The optimum by an interior-point method; None where it gives none."""
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.iterative_refinement_enable = False  # a third of its time, for digits no step needs
    settings.equilibrate_enable = False  # rows are scaled already, and it takes half as many rounds
    settings.tol_gap_abs = CLOSE
    settings.tol_gap_rel = CLOSE
    eye = np.eye(len(programme.price))
    above = np.isfinite(programme.high)
    rows = sparse.csc_matrix(np.concatenate([programme.matrix, eye[above], -eye]))
    side = np.concatenate([programme.room, programme.high[above], -programme.low])
    cones = [clarabel.NonnegativeConeT(len(side))]
    quadratic = sparse.csc_matrix(np.triu(programme.quadratic))
    solver = clarabel.DefaultSolver(quadratic, programme.price, rows, side, cones, settings)
    solution = solver.solve()
    x = np.array(solution.x)
    if str(solution.status) not in ("Solved", "AlmostSolved") or not np.isfinite(x).all():
        return None
    return x


def _unhindered(
    gradient: Float[Array, " d"],
    hessian: Float[Array, "d d"],
    groups: Sequence[ConstraintRows],
    bounds: Bounds,
) -> Step | None:
    """Newton's own step where no bound and no inequality is in its way."""
    if any(rows.room.min(initial=0.0) < 0.0 for rows in groups):
        return None
    try:
        step = -np.linalg.solve(hessian, gradient)
    except np.linalg.LinAlgError:
        return None
    low, high = bounds
    inside = np.all(step >= low) and np.all(step <= high)  # not so of what is no number
    if not inside:
        return None
    if any(np.any(rows.matrix @ step > rows.room) for rows in groups):
        return None
    return step, float(-0.5 * gradient @ step)
