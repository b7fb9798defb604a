"""The quadratic programme of one step: cost to second order, limits to first, nothing farther than the step allows."""

from __future__ import annotations

from dataclasses import dataclass

import clarabel
import daqp
import numpy as np
from scipy import sparse

from ident.arrays import Array, Float

# Second derivative of a slack's price: little beside the price itself, yet enough that the active-set method seldom
# goes round in circles. How closely an inequality is kept, a tenth of what a course's own checks look at.
BENT, CLOSE = 1e-2, 1e-6
# Variables beyond which an interior point is quicker where the cost is hardly bent, as that of the shortest time.
MANY = 150


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Linear inequalities: matrix · step ≤ room, in units in which one is a whole limit or a decimetre."""

    matrix: Float[Array, "r d"]  # one row an inequality
    room: Float[Array, " r"]  # what is left of each; below zero where it is broken now

    @classmethod
    def none(cls, size: int) -> ConstraintRows:
        """No inequality."""
        return cls(np.empty((0, size)), np.empty(0))

    @classmethod
    def join(cls, parts: list[ConstraintRows]) -> ConstraintRows:
        """All of several sets."""
        return cls(np.concatenate([p.matrix for p in parts]), np.concatenate([p.room for p in parts]))

    def in_reach(self, low: Float[Array, " d"], high: Float[Array, " d"]) -> ConstraintRows:
        """Those that a step within bounds can meet."""
        farthest = self.matrix @ ((low + high) / 2) + np.abs(self.matrix) @ ((high - low) / 2)
        met = farthest > self.room
        return ConstraintRows(self.matrix[met], self.room[met])


Step = tuple[Float[Array, " d"], float]
"""Change of the variables, and by how much cost and weighted shortfall should fall."""


def solve_step(
    gradient: Float[Array, " d"],
    hessian: Float[Array, "d d"],
    groups: list[ConstraintRows],
    weights: Float[Array, " g"],
    bounds: tuple[Float[Array, " d"], Float[Array, " d"]],
    flat: bool = False,
) -> Step | None:
    """Minimises g·s + ½ sᵀHs + Σ weight · slack, each set of inequalities with one slack of its own.

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
    plain = _unhindered(gradient, hessian, groups, low, high)
    if plain is not None:
        return plain
    groups = [rows.in_reach(low, high) for rows in groups]
    size, count, lengths = len(gradient), len(groups), [len(rows.room) for rows in groups]
    # The variables are the step's and a slack for each set; the rows are the inequalities less their set's slack.
    whole = BENT * np.eye(size + count)
    whole[:size, :size] = hessian
    matrix = np.zeros((sum(lengths), size + count))
    matrix[:, :size] = np.concatenate([rows.matrix for rows in groups])
    matrix[np.arange(len(matrix)), size + np.repeat(np.arange(count), lengths)] = -1.0
    sides = np.append(low, np.zeros(count)), np.append(high, np.full(count, np.inf))
    given = whole, np.concatenate([gradient, weights]), matrix, np.concatenate([rows.room for rows in groups]), *sides
    before = sum(w * max(0.0, -float(r.room.min(initial=0.0))) for w, r in zip(weights, groups, strict=True))

    def promise(x: Array) -> Step:
        """The step within its bounds, and by how much it should bring cost and shortfall down."""
        step = np.clip(x[:size], low, high)
        slack = np.array([max(0.0, float((r.matrix @ step - r.room).max(initial=0.0))) for r in groups])
        return step, before - float(gradient @ step + 0.5 * step @ (hessian @ step) + weights @ slack)

    x = _active_set(*given) if size <= MANY or not flat else None
    if x is not None and promise(x)[1] > 0.0:
        return promise(x)
    # No step at all promises nothing: an answer below that is none.
    x = _interior_point(*given)
    return None if x is None else promise(x)


def _active_set(whole: Array, price: Array, matrix: Array, room: Array, low: Array, high: Array) -> Array | None:
    """The optimum by a dual active-set method, a few times as quick as the other; None where it goes round in circles.

    Source: D. Arnström, A. Bemporad, D. Axehill, A dual active-set solver for embedded quadratic programming using
    recursive LDLᵀ updates, IEEE Trans. Autom. Control 67 (2022) 4362.
    """
    upper, lower = np.concatenate([high, room]), np.concatenate([low, np.full(len(room), -np.inf)])
    plain = np.zeros(len(upper), dtype=np.intc)
    x, _, status, _ = daqp.solve(whole, price, matrix, upper, lower, plain, primal_tol=CLOSE)
    return np.array(x) if status == 1 and np.isfinite(x).all() else None


def _interior_point(whole: Array, price: Array, matrix: Array, room: Array, low: Array, high: Array) -> Array | None:
    """The optimum by an interior-point method; None where it gives none."""
    settings, eye, above = clarabel.DefaultSettings(), np.eye(len(price)), np.isfinite(high)
    settings.verbose = False
    settings.max_threads = 1
    settings.iterative_refinement_enable = False  # a third of its time, for digits that no step needs
    rows = sparse.csc_matrix(np.concatenate([matrix, eye[above], -eye]))
    side = np.concatenate([room, high[above], -low])
    cones = [clarabel.NonnegativeConeT(len(side))]
    found = clarabel.DefaultSolver(sparse.csc_matrix(np.triu(whole)), price, rows, side, cones, settings).solve()
    x = np.array(found.x)
    return x if np.isfinite(x).all() and str(found.status) in ("Solved", "AlmostSolved") else None


def _unhindered(gradient: Array, hessian: Array, groups: list[ConstraintRows], low: Array, high: Array) -> Step | None:
    """Newton's own step where no bound and no inequality is in its way."""
    if any(rows.room.min(initial=0.0) < 0.0 for rows in groups):
        return None
    try:
        step = -np.linalg.solve(hessian, gradient)
    except np.linalg.LinAlgError:
        return None
    inside = bool(np.all(step >= low) and np.all(step <= high))
    if not inside or any(np.any(rows.matrix @ step > rows.room) for rows in groups):
        return None
    return step, float(-0.5 * gradient @ step)
