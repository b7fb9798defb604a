"""Sums of squares that stay positive after something was taken off them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dpotrf, dpotrs

from ident.arrays import Array, Float

# Least eigenvalue of the normalised matrix.
LEAST_EIGENVALUE = 1e-9


def positive(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """A symmetric matrix that is positive definite: itself, or one that holds what can't be seen at rest.

    Sums that encoder noise was taken off are estimates: along a direction that the motion hardly shows, even of one
    column alone, they may come out below zero. Such a direction is given the curvature of a well-seen one, so that
    solutions stay small along it.
    """
    root = np.sqrt(np.maximum(np.abs(np.diag(matrix)), 1e-300))
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix / np.outer(root, root))
        return np.asarray(
            (vectors * np.where(values > LEAST_EIGENVALUE, values, 1.0)) @ vectors.T * np.outer(root, root)
        )
    return matrix


@dataclass(frozen=True, eq=False)
class Factor:
    """Cholesky's factor of a positive matrix; by LAPACK itself, as most of these systems are small, and many."""

    lower: Float[Array, "k k"]  # what stands above the diagonal is none of it

    def solve(self, target: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
        """Solution of the linear system with one right-hand side, or several."""
        return np.asarray(dpotrs(self.lower, target, lower=1)[0])


def factorise(matrix: Float[Array, "k k"]) -> Factor:
    """The factor of a symmetric matrix, or of what `positive` makes of it.

    Raises:
        LinAlgError: It holds what is no number.
    """
    lower, failed = dpotrf(matrix, lower=1, clean=0)
    return Factor(np.linalg.cholesky(positive(matrix)) if failed else lower)
