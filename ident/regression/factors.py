"""Solving symmetric systems: Cholesky factors, and unknowns that can't be negative.

Sums that encoder noise was taken off are estimates, which need not be positive along every
direction; `positive` says what is done then."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from ident.arrays import Array, Bool, Float, Int

# Ridge, in multiples of its power, of an unknown that its sign holds at zero.
OFF = 1e6
# Times that all wrong signs are exchanged together (two are mostly enough), and exchanges for each
# unknown in all.
MOST_EXCHANGES = 10
# Least eigenvalue of a normalised matrix that counts as positive.
LEAST_EIGENVALUE = 1e-9


def solve_signed(
    matrix: Float[Array, "k k"], target: Float[Array, " k"], signed: Bool[Array, " k"]
) -> Float[Array, " k"]:
    """Least squares from normal equations; unknowns marked `signed` are not negative.

    Unknowns of the wrong sign are fixed at zero, and those let go of which the squares would fall
    with more of them: all together at first, then the last one alone, which ends.

    Source: Kim and Park 2011 (block principal pivoting); Murty 1974 (the last one alone).

    Args:
        matrix, target: Sums of the columns, and of these times the torque.
        signed: Which unknowns are not negative.
    """
    free = np.ones(len(target), dtype=bool)
    solution = factorise(matrix).solve(target)
    if not signed.any():
        return solution
    for k in range(MOST_EXCHANGES * len(target)):
        is_negative = solution < 0.0
        slope = target - matrix @ solution
        would_gain = slope > 1e-12 * np.abs(target)
        wrong = signed & np.where(free, is_negative, would_gain)
        if not wrong.any():
            break
        if k < MOST_EXCHANGES:
            free ^= wrong
        else:
            last = np.flatnonzero(wrong)[-1]
            free[last] = not free[last]
        solution = np.zeros(len(target))
        if free.any():
            of_free = matrix[np.ix_(free, free)]
            solution[free] = factorise(of_free).solve(target[free])
    return np.where(signed, np.maximum(solution, 0.0), solution)


def factorise_signed(
    information: Float[Array, "z z"], target: Float[Array, " z"], signed: Int[Array, " s"]
) -> Factor:
    """The factor of a model's information; signed unknowns that would come out negative are kept at
    zero, in place.

    Else a model would have what no law has: friction by load that is negative one way is a gain of
    the torque.
    """
    factor = factorise(information)
    if len(signed) == 0:
        return factor
    units = np.zeros((len(target), 1 + len(signed)))
    units[:, 0] = target
    units[signed, 1 + np.arange(len(signed))] = 1.0
    free = factor.solve(units)[signed]
    estimate = free[:, 0]
    if not (estimate < 0.0).any():
        return factor
    rest = np.linalg.inv(free[:, 1:])  # what the other unknowns leave of the signed ones
    every = np.ones(len(signed), dtype=bool)
    bounded = solve_signed(rest, rest @ estimate, every)
    off = signed[bounded <= 0.0]
    information[off, off] += OFF * np.abs(information[off, off])
    return factorise(information)


def positive(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """A symmetric matrix that is positive definite: itself, or one that holds what can't be seen at
    rest.

    Sums that encoder noise was taken off are estimates: along a direction that the motion hardly
    shows, even of one column alone, they may come out below zero. Such a direction is given the
    curvature of a well-seen one, so that solutions stay small along it.
    """
    power = np.abs(np.diag(matrix))
    root = np.sqrt(np.maximum(power, 1e-300))
    scale = np.outer(root, root)
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix / scale)
        lifted = np.where(values > LEAST_EIGENVALUE, values, 1.0)
        return np.asarray((vectors * lifted) @ vectors.T * scale)
    return matrix


@dataclass(frozen=True, eq=False)
class Factor:
    """Cholesky's factor of a positive matrix; by LAPACK itself, as most of these systems are small,
    and many.
    """

    lower: Float[Array, "k k"]  # what stands above the diagonal is none of it

    def solve(self, target: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
        """Solution of the linear system with one right-hand side, or several."""
        solution, _ = dpotrs(self.lower, target, lower=1)
        return np.asarray(solution)


def factorise(matrix: Float[Array, "k k"]) -> Factor:
    """The factor of a symmetric matrix, or of what `positive` makes of it.

    Raises:
        LinAlgError: It holds what is no number.
    """
    lower, failed = dpotrf(matrix, lower=1, clean=0)
    if failed:
        lower = np.linalg.cholesky(positive(matrix))
    return Factor(lower)
