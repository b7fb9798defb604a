"""Losses and link inertias as a convex program: least squares within what an arm can be.

    minimise ½ xᵀ A x − bᵀ x   with   xₖ ≥ 0  for losses,   P(π + S x) ⪰ 0  for every link

A and b are the normal equations of all runs, weights and priors in them; x the changes of the
links' inertial numbers π in units S, then the losses. P is a link's 4 × 4 pseudo-inertia, positive
semidefinite for every body that can exist. Solved by an interior-point method of our own
(`interior_point`).

Source: Wensing, Kim and Slotine 2018, eq. 12 (pseudo-inertia).
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs
from scipy.optimize import nnls

from ident.arrays import Array, Float, Int
from ident.model.interior_point import NO_BODIES, Bodies, Program, minimise

# Eigenvalues of a pseudo-inertia above minus this share of its trace count as not negative.
TOLERANCE = 1e-9
# Eigenvalues that bodies found here keep at least, in units of the link's mass and its size.
MARGIN = 1e-7
# Eigenvalues of the scaled normal equations below this share of the largest are rounding.
ROUNDING = 1e-13
# Least unit of a mass, and of a moment.
LEAST_UNIT = 1e-12
# Pivot of scaled sums below which more than half of their digits are lost.
LEAST_PIVOT = float(np.finfo(float).eps ** (1 / 4))


def pseudo_inertia(link: Float[Array, "... 10"]) -> Float[Array, "... 4 4"]:
    """The matrix that is positive semidefinite for every body that can exist.

    Args:
        link: m, m·c, and Ixx Ixy Iyy Ixz Iyz Izz about the joint frame [kg, kg m, kg m²], of one
            link or of many.
    """
    numbers = np.moveaxis(np.asarray(link, dtype=float), -1, 0)
    mass, mx, my, mz, xx, xy, yy, xz, yz, zz = numbers
    half = 0.5 * (xx + yy + zz)
    rows = [
        [half - xx, -xy, -xz, mx],
        [-xy, half - yy, -yz, my],
        [-xz, -yz, half - zz, mz],
        [mx, my, mz, mass],
    ]
    return np.moveaxis(np.array(rows), (0, 1), (-2, -1))


def is_consistent(parameters: Float[Array, " 10n"]) -> bool:
    """Whether every link could be a real body."""
    matrices = pseudo_inertia(parameters.reshape(-1, 10))
    values = np.linalg.eigvalsh(matrices)[:, 0]
    sound = values >= -TOLERANCE * np.trace(matrices, axis1=1, axis2=2)
    return bool(np.all(sound & (matrices[:, 3, 3] > 0.0)))


def solve_bounded(
    information: Float[Array, "m m"],
    score: Float[Array, " m"],
    nonnegative: Sequence[int] | Int[Array, " b"],
    links: Float[Array, " 10n"] | None = None,
    scale: Float[Array, " 10n"] | None = None,
    free_links: Collection[int] = (),
) -> Float[Array, " m"]:
    """Minimises ½ xᵀ A x − bᵀ x within bounds.

    Args:
        information, score: A, positive semidefinite, and b.
        nonnegative: Positions of unknowns that may not be negative.
        links: Inertial numbers π, if the first 10 n unknowns are changes of them.
        scale: What a unit of each of these unknowns is; one if None.
        free_links: Links that need be no body.

    Raises:
        ArithmeticError: The solver found no solution.
    """
    # In units of what the data know of each unknown.
    power = np.diag(information)
    size = np.sqrt(np.maximum(power, ROUNDING * power.max(initial=1e-300)))
    values, vectors = np.linalg.eigh(information / np.outer(size, size))
    values = np.maximum(values, ROUNDING * values.max())
    scaled = (vectors * values) @ vectors.T
    right = score / size
    free = vectors @ ((vectors.T @ right) / values)
    positive = np.asarray(nonnegative, dtype=int)
    bodies = NO_BODIES if links is None else _bodies(links, scale, free_links, size)
    solution = minimise(Program(scaled, right, positive, bodies), free) / size
    solution[positive] = np.maximum(solution[positive], 0.0)
    return solution


def _bodies(
    links: Float[Array, " 10n"],
    scale: Float[Array, " 10n"] | None,
    free_links: Collection[int],
    size: Float[Array, " m"],
) -> Bodies:
    """Pseudo-inertias of the links as functions of the scaled unknowns.

    In units of each link's mass and size.
    """
    steps = np.ones(len(links)) if scale is None else np.asarray(scale)
    unit = pseudo_inertia(np.eye(10))
    constants = []
    slopes = []
    unknowns = []
    for link in range(len(links) // 10):
        if link in free_links:
            continue
        numbers = np.arange(10 * link, 10 * link + 10)
        mass = max(steps[numbers[0]], LEAST_UNIT)
        moment = max(steps[numbers[4]], LEAST_UNIT)
        frame = 1.0 / np.sqrt([moment, moment, moment, mass])
        units = np.outer(frame, frame)
        step = steps[numbers] / size[numbers]
        constants.append(units * pseudo_inertia(links[numbers]) - MARGIN * np.eye(4))
        slopes.append(units * unit * step[:, None, None])
        unknowns.append(numbers)
    if not constants:
        return NO_BODIES
    return Bodies(np.array(constants), np.array(slopes), np.array(unknowns))


def solve_partly_non_negative(
    sums: Float[Array, "k+1 k+1"], bounded: Iterable[int]
) -> Float[Array, " k"]:
    """Least squares of which some unknowns can't be negative.

    The free ones are eliminated, the rest is bounded: the same as `solve_bounded` without links, in
    a part of its time, for arms that are tuned again and again.

    Args:
        sums: Sums of squares and products of the unknowns' columns and, last, of what they are to
            be.
        bounded: Positions of the unknowns that can't be negative.
    """
    power = np.diag(sums)
    # An unknown without rows, as of a joint at rest, stays zero.
    seen = power[:-1] > 0.0
    is_bounded = np.zeros(len(seen), dtype=bool)
    is_bounded[list(bounded)] = True
    positive = np.flatnonzero(seen & is_bounded)
    free = np.flatnonzero(seen & ~is_bounded)
    scale = np.sqrt(np.where(power > 0.0, power, 1.0))
    scaled = sums / (scale[:, None] * scale)
    unbounded = _solve_definite(scaled)
    if unbounded is not None and np.all(unbounded[is_bounded] >= 0.0):
        return unbounded * scale[-1] / scale[:-1]
    values, vectors = np.linalg.eigh(scaled)
    root = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T  # rootᵀ root: the scaled sums
    columns = [*free, *positive, -1]
    triangle = np.asarray(np.linalg.qr(root[:, columns], mode="r"))
    count = len(free)
    solution = np.zeros(len(sums) - 1)
    remaining = triangle[count:, count:-1]
    # SciPy's routine spoils memory where there is nothing to solve.
    if remaining.size:
        solution[positive], _ = nnls(remaining, triangle[count:, -1])
    of_positive = triangle[:count, count:-1] @ solution[positive]
    left = triangle[:count, -1] - of_positive
    of_free = triangle[:count, :count]
    solution[free] = np.linalg.lstsq(of_free, left, rcond=None)[0]
    return solution * scale[-1] / scale[:-1]


def _solve_definite(sums: Float[Array, "k+1 k+1"]) -> Float[Array, " k"] | None:
    """Least squares by sums scaled to a diagonal of one; None where they tell nothing of some."""
    factor, failed = dpotrf(sums[:-1, :-1], lower=1)
    pivots = np.diag(factor)
    if failed or np.min(pivots, initial=1.0) < LEAST_PIVOT:
        return None
    solution, _ = dpotrs(factor, sums[:-1, -1], lower=1)
    return np.asarray(solution)
