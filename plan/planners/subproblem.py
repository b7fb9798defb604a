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
# Variables beyond which an interior point is quicker.
MANY = 150


@dataclass(frozen=True, eq=False)
class ConstraintRows:
    """Linear inequalities: matrix · step ≤ room, in units in which one is a whole limit or a decimetre.

    Attributes:
        matrix: One row an inequality.
        room: What is left of each; below zero where it is broken now.
    """

    matrix: Float[Array, "r d"]
    room: Float[Array, " r"]

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


@dataclass(frozen=True, eq=False)
class Step:
    """What the programme found.

    Attributes:
        step: Change of the variables.
        promised: By how much cost and weighted shortfall should fall.
        slack: What each set of inequalities is left short of.
    """

    step: Float[Array, " d"]
    promised: float
    slack: Float[Array, " g"]


def solve_step(
    gradient: Float[Array, " d"],
    hessian: Float[Array, "d d"],
    groups: list[ConstraintRows],
    weights: Float[Array, " g"],
    low: Float[Array, " d"],
    high: Float[Array, " d"],
) -> Step | None:
    """Minimises g·s + ½ sᵀHs + Σ weight · slack, each set of inequalities with one slack of its own.

    Args:
        gradient, hessian: The cost's.
        groups: Sets of inequalities.
        weights: Price of each set's largest shortfall.
        low, high: Bounds of the step.

    Returns:
        The step; None where the solver gives none.
    """
    plain = _unhindered(gradient, hessian, groups, low, high)
    if plain is not None:
        return plain
    groups = [rows.in_reach(low, high) for rows in groups]
    few = len(gradient) <= MANY
    step = _active_set(gradient, hessian, groups, weights, low, high) if few else None
    if step is None:
        step = _interior_point(gradient, hessian, groups, weights, low, high)
    if step is None:
        return None
    before = sum(w * max(0.0, -float(r.room.min(initial=0.0))) for w, r in zip(weights, groups, strict=True))
    slack = np.array([max(0.0, float((r.matrix @ step - r.room).max(initial=0.0))) for r in groups])
    after = float(gradient @ step + 0.5 * step @ (hessian @ step) + weights @ slack)
    return Step(step, before - after, slack)


def _active_set(
    gradient: Array, hessian: Array, groups: list[ConstraintRows], weights: Array, low: Array, high: Array
) -> Array | None:
    """The step by a dual active-set method, a few times as quick as the other; None where it goes round in circles.

    Source: D. Arnström, A. Bemporad, D. Axehill, A dual active-set solver for embedded quadratic programming using
    recursive LDLᵀ updates, IEEE Trans. Autom. Control 67 (2022) 4362.
    """
    size, count = len(gradient), len(groups)
    matrix, room = _elastic(groups, size)
    upper = np.concatenate([high, np.full(count, np.inf), room])
    lower = np.concatenate([low, np.zeros(count), np.full(len(room), -np.inf)])
    plain = np.zeros(len(upper), dtype=np.intc)
    price = np.concatenate([gradient, weights])
    x, _, status, _ = daqp.solve(_bent(hessian, count), price, matrix, upper, lower, plain, primal_tol=CLOSE)
    step = np.array(x)[:size]
    return np.clip(step, low, high) if status == 1 and np.isfinite(step).all() else None


def _interior_point(
    gradient: Array, hessian: Array, groups: list[ConstraintRows], weights: Array, low: Array, high: Array
) -> Array | None:
    """The step by an interior-point method; None where it gives none."""
    size, whole = len(gradient), np.triu(_bent(hessian, len(groups)))
    matrix, side = _stack(groups, low, high)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.iterative_refinement_enable = False  # a third of its time, for digits that no step needs
    price = np.concatenate([gradient, weights])
    cones = [clarabel.NonnegativeConeT(len(side))]
    solver = clarabel.DefaultSolver(_compress(whole), price, _compress(matrix), side, cones, settings)
    found = solver.solve()
    x = np.array(found.x)
    if not np.isfinite(x).all() or str(found.status) not in ("Solved", "AlmostSolved"):
        return None
    return np.clip(x[:size], low, high)


def _bent(hessian: Float[Array, "d d"], count: int) -> Float[Array, "c c"]:
    """The cost's second derivative, and that of so many slacks behind it."""
    size = len(hessian)
    whole = BENT * np.eye(size + count)
    whole[:size, :size] = hessian
    return whole


def _elastic(groups: list[ConstraintRows], size: int) -> tuple[Float[Array, "r c"], Float[Array, " r"]]:
    """All inequalities of the step, each set less its slack, which stands behind the step."""
    lengths = [len(rows.room) for rows in groups]
    matrix, end = np.zeros((sum(lengths), size + len(groups))), 0
    for k, rows in enumerate(groups):
        matrix[end : end + lengths[k], :size] = rows.matrix
        matrix[end : end + lengths[k], size + k] = -1.0
        end += lengths[k]
    return matrix, np.concatenate([rows.room for rows in groups])


def _stack(groups: list[ConstraintRows], low: Array, high: Array) -> tuple[Float[Array, "r c"], Float[Array, " r"]]:
    """The same, and the bounds of the step and of the slacks."""
    size, count = len(low), len(groups)
    matrix, room = _elastic(groups, size)
    bounds = np.eye(size + count)
    rows = [matrix, bounds[:size], -bounds[:size], -bounds[size:]]
    return np.concatenate(rows), np.concatenate([room, high, -low, np.zeros(count)])


def _compress(matrix: Float[Array, "r c"]) -> sparse.csc_matrix:
    """A dense matrix by columns; SciPy's own way takes several times as long at these sizes."""
    turned = np.ascontiguousarray(matrix.T)
    columns, rows = np.nonzero(turned)
    ends = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=len(turned)))])
    return sparse.csc_matrix((turned[columns, rows], rows, ends), shape=matrix.shape)


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
    return Step(step, float(-0.5 * gradient @ step), np.zeros(len(groups)))
