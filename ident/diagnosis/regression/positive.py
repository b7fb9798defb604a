"""Sums of squares that stay positive after something was taken off them."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float

# Least eigenvalue of the normalised matrix.
LEAST_EIGENVALUE = 1e-6


def positive(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """A symmetric matrix that is positive definite: itself, or the nearest of its eigenvectors.

    Sums that encoder noise was taken off are estimates: along a direction that the motion hardly shows they may come
    out below zero.
    """
    root = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    try:
        np.linalg.cholesky(matrix)
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(matrix / np.outer(root, root))
        return np.asarray((vectors * np.maximum(values, LEAST_EIGENVALUE)) @ vectors.T * np.outer(root, root))
    return matrix
