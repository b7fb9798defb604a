"""Losses and bodies within what can exist, by Newton's method along the central path.

    minimise ½ xᵀ A x − bᵀ x − μ (Σ log det M_l(x) + Σ log x_k)   for μ → 0

M_l is a link's pseudo-inertia, linear in x, less a margin; x_k are the losses that can't be
negative. The function is self-concordant, so that a few steps at each μ reach its minimum from any
body; what is missed of the optimum at the end is at most μ times the number of rows of all matrices
and bounds.

Source: Boyd and Vandenberghe 2004, sections 9.6 and 11.3 (barrier method); Wensing, Kim and Slotine
2018, eq. 12.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from ident.arrays import Array, Float, Int

# μ falls by this factor at a time.
FALL = 0.05
# It falls so far that what is missed is this share of the function's size.
GAP = 1e-10
# Newton's decrement at which a point is central enough, and as the last one is to be.
CENTRAL = 1e-2
SHARP = 1e-9
MOST_STEPS = 60
MOST_HALVINGS = 40
# Armijo's share of the expected fall.
EXPECTED = 0.1
# Least eigenvalue of a matrix at the start, as a share of its largest one.
INSIDE = 0.1
# Ridge of the unknowns in units of their curvature: keeps a solve well-posed.
RIDGE = 1e-13


@dataclass(frozen=True, eq=False)
class Bodies:
    """Matrices that must stay positive: M_l(x) = constant_l + Σ_k x_k slope_lk.

    k is of the link's own unknowns.
    """

    constant: Float[Array, "l 4 4"]
    slopes: Float[Array, "l k 4 4"]
    unknowns: Int[Array, "l k"]

    @property
    def rows(self) -> int:
        """Rows of all matrices together."""
        return 4 * len(self.constant)

    def matrices(self, x: Float[Array, " m"]) -> Float[Array, "l 4 4"]:
        """All matrices at a point."""
        return np.asarray(self.constant + np.einsum("lk,lkab->lab", x[self.unknowns], self.slopes))

    def start(self, x: Float[Array, " m"]) -> Float[Array, " m"]:
        """A point near another, where every matrix has positive eigenvalues."""
        moved = np.array(x, dtype=float)
        for link, matrix in enumerate(self.matrices(x)):
            values, vectors = np.linalg.eigh(matrix)
            lifted = np.maximum(values, INSIDE * max(float(np.abs(values).max()), 1.0))
            wanted = (vectors * lifted) @ vectors.T - self.constant[link]
            columns = self.slopes[link].reshape(len(self.slopes[link]), 16).T
            moved[self.unknowns[link]] = np.linalg.lstsq(columns, wanted.ravel(), rcond=None)[0]
        return moved


@dataclass(frozen=True, eq=False)
class Program:
    """The function and what bounds it; unknowns are scaled so that A has a diagonal of one."""

    information: Float[Array, "m m"]
    score: Float[Array, " m"]
    positive: Int[Array, " b"]
    bodies: Bodies

    def value(self, x: Float[Array, " m"], weight: float) -> float:
        """Function and barrier; infinite outside."""
        if np.any(x[self.positive] <= 0.0):
            return float("inf")
        try:
            factors = np.linalg.cholesky(self.bodies.matrices(x))
        except np.linalg.LinAlgError:
            return float("inf")
        logs = 2.0 * float(np.sum(np.log(np.diagonal(factors, axis1=1, axis2=2))))
        logs += float(np.sum(np.log(x[self.positive])))
        return float(0.5 * x @ self.information @ x - self.score @ x) - weight * logs

    def slope_and_curvature(self, x: Float[Array, " m"], weight: float) -> tuple[Array, Array]:
        """Gradient and Hessian of function and barrier."""
        slope = self.information @ x - self.score
        curvature = self.information.copy()
        inverse = np.linalg.inv(self.bodies.matrices(x))
        product = np.einsum("lab,lkbc->lkac", inverse, self.bodies.slopes)
        by_body = np.einsum("lkaa->lk", product)
        bend = np.einsum("lkab,lmba->lkm", product, product)
        for link, unknowns in enumerate(self.bodies.unknowns):
            slope[unknowns] -= weight * by_body[link]
            curvature[np.ix_(unknowns, unknowns)] += weight * bend[link]
        slope[self.positive] -= weight / x[self.positive]
        curvature[self.positive, self.positive] += weight / x[self.positive] ** 2
        return slope, curvature

    def centre(self, x: Float[Array, " m"], weight: float, tolerance: float) -> Float[Array, " m"]:
        """Newton's method with a halved step where the function would not fall."""
        here = self.value(x, weight)
        for _ in range(MOST_STEPS):
            slope, curvature = self.slope_and_curvature(x, weight)
            step = _solve(curvature, -slope)
            decrement = float(-slope @ step)
            if decrement <= tolerance * weight:
                break
            length = 1.0
            for _ in range(MOST_HALVINGS):
                there = self.value(x + length * step, weight)
                if there <= here - EXPECTED * length * decrement:
                    break
                length *= 0.5
            else:
                break
            x = x + length * step
            here = there
        return x


NO_BODIES = Bodies(np.zeros((0, 4, 4)), np.zeros((0, 10, 4, 4)), np.zeros((0, 10), dtype=int))


def _solve(curvature: Float[Array, "m m"], right: Float[Array, " m"]) -> Float[Array, " m"]:
    size = np.sqrt(np.diag(curvature))
    scaled = curvature / np.outer(size, size)
    scaled[np.diag_indices(len(size))] += RIDGE
    try:
        return np.asarray(cho_solve(cho_factor(scaled), right / size) / size)
    except LinAlgError:
        return np.asarray(np.linalg.lstsq(scaled, right / size, rcond=None)[0] / size)


def minimise(program: Program, free: Float[Array, " m"]) -> Float[Array, " m"]:
    """The minimum within all bounds.

    Args:
        program: Function and bounds.
        free: Where the function is least without them.

    Raises:
        ArithmeticError: No point inside was found.
    """
    reach = float(np.abs(free).max(initial=1e-12))
    x = program.bodies.start(free)
    x[program.positive] = np.maximum(x[program.positive], 1e-2 * reach)
    curved = 0.5 * free @ program.information @ free
    size = abs(float(curved - program.score @ free))
    above = program.value(x, 0.0) + size
    bounds = max(program.bodies.rows + len(program.positive), 1)
    if not np.isfinite(above):
        raise ArithmeticError("no losses and bodies were found that the recordings allow")
    last = GAP * max(size, above, 1e-300) / bounds
    weight = max(above, last) / bounds
    while weight > last:
        x = program.centre(x, weight, CENTRAL)
        weight = max(FALL * weight, last)
    return program.centre(x, last, SHARP)
