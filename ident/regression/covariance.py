"""How unsure a model's coefficients are: what blocks of time say of it, beside what the noise's model says."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.run_spread import block_sums_left

# Below this share of the model's variance the variance between blocks is numerically zero.
LEAST_BLOCK_VARIANCE = 1e-9
# Columns of a joint that carry less than this share of its largest carry nothing: their scores are no measure of how
# blocks vary; nor are those of columns of whose scores the model leaves less than the second share.
LEAST_COLUMN, LEAST_LEFT = 1e-6, 0.05


def robust_covariance(evidence: Evidence, projection: Projection) -> Float[Array, "z z"]:
    """Covariance of a model's coefficients by the block sandwich, with variances not below the model's own."""
    part = block_sums_left(evidence, projection)[:, projection.inside]
    blocks = len(part)
    meat = part.T @ part * blocks / max(blocks - 1, 1)
    return floor_at_model_variance(projection.spread @ meat @ projection.spread, projection.spread)


def floor_at_model_variance(sandwich: Float[Array, "z z"], spread: Float[Array, "z z"]) -> Float[Array, "z z"]:
    """A block sandwich covariance with variances that are not below the model's own, `spread`."""
    own, between = np.diag(spread), np.diag(sandwich)
    # A column that is nearly zero in all blocks has no variance between them: the model's holds.
    silent = between <= LEAST_BLOCK_VARIANCE * own
    lift = np.where(silent, 0.0, np.sqrt(np.maximum(1.0, own / np.where(silent, own, between))))
    return np.asarray(sandwich * np.outer(lift, lift) + np.diag(np.where(silent, own, 0.0)))


def measure_inflation(evidence: Evidence, projection: Projection, known: Float[Array, "z z"] | None = None) -> float:
    """Variance inflation: factor by which block scores vary more than the noise model says; divides log evidence.

    It is the median ratio of sandwich to model variance over the baseline's coefficients, at least 1.

    Args:
        evidence, projection: Block sums and the solved model.
        known: Sandwich covariance of its coefficients, if it was computed before.
    """
    tuned = slice(evidence.layout.tuned)
    model = np.diag(projection.spread)[tuned]
    robust = np.diag(robust_covariance(evidence, projection) if known is None else known)[tuned]
    return float(max(1.0, np.median(robust / np.maximum(model, 1e-300))))


def worth_of_rows(evidence: Evidence, projection: Projection) -> Float[Array, " n"]:
    """How many whitened rows of each joint are worth one independent row of the noise, one at the least.

    By what the model leaves of them, or, where that is more, by how much larger the squares of blocks' scores Xᵀr are
    than those of independent rows, the median over the joint's columns; of the scores the model has taken a part:
    G − G C G is expected, C the covariance of its coefficients.
    """
    found = np.ones(evidence.layout.n)
    for j, local in enumerate(evidence.layout.local):
        weights, at = projection.weights[local], np.flatnonzero(np.isin(local, projection.inside))
        places, gram = projection.places(local[at]), evidence.total[j].over()
        ratio = [1.0 / evidence.dispersion[j], weights @ gram @ weights / max(float(evidence.samples[j]), 1.0)]
        gram = gram[np.ix_(at, at)]
        alone = np.diag(gram)
        expected = np.diag(gram - gram @ projection.spread[np.ix_(places, places)] @ gram)
        used = (alone > LEAST_COLUMN * alone.max(initial=0.0)) & (expected > LEAST_LEFT * alone)
        if used.any():
            scores = evidence.times(j, weights)[:, at[used]]
            ratio.append(np.median((scores**2).sum(axis=0) / expected[used]))
        found[j] = evidence.dispersion[j] * max(ratio)
    return found
