"""How much each joint's friction varies from run to run: a variance component, separated from noise.

A run's friction level s_r, as a share of the model's, is estimated from what the model leaves of the run, with variance
v_r known from the run's length and motion. Of R runs, Σ (s_r − s̄)² / v_r beyond R − 1 is due to friction itself:

    τ² = max(0, Σ w (s − s̄)² − (R − 1)) / (Σ w − Σ w² / Σ w),  w = 1 / v.

Few runs say little of it: what is usual counts as some more (`usual_runs`).

Source: DerSimonian and Laird 1986 (moment estimator of a variance component).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.regression.dwells import DwellRows
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection

# Holds that a joint's level of static friction, guessed by its Coulomb friction, counts as.
GUESS = 4.0


def residual_weights(evidence: Evidence, projection: Projection) -> Float[Array, " P"]:
    """What a model leaves of a row is the row's product with these."""
    weights = np.zeros(evidence.layout.size + 1)
    weights[projection.inside] = -projection.estimate
    weights[-1] = 1.0
    return weights


def squares_left(evidence: Evidence, projection: Projection) -> Float[Array, "n B"]:
    """What a model leaves of each joint's rows in each block, in squares of the noise."""
    weights, local = residual_weights(evidence, projection), evidence.layout.local
    return np.array([evidence.times(j, weights[own]) @ weights[own] for j, own in enumerate(local)])


def block_sums_left(evidence: Evidence, projection: Projection) -> Float[Array, "B P"]:
    """Sums over each block of every column, the torque last, times what a model leaves of the rows."""
    weights = residual_weights(evidence, projection)
    sums = np.zeros((len(evidence.fold_of_block), evidence.layout.size + 1))
    for j, local in enumerate(evidence.layout.local):
        sums[:, local] += evidence.times(j, weights[local])
    return sums


def estimate_run_spread(evidence: Evidence, projection: Projection) -> Float[Array, " n"]:
    """Relative standard deviation of each joint's friction from run to run.

    Args:
        evidence: Sums of the session.
        projection: The model that leaves the residual; solved with about this spread or a larger one.
    """
    weights = residual_weights(evidence, projection)
    return np.array([_spread_of_joint(evidence, j, weights) for j in range(evidence.layout.n)])


def excess_over_noise(values: Float[Array, " R"], variance: Float[Array, " R"]) -> tuple[float, float]:
    """What values differ by beyond their noise, and what a variance component of one would add to that.

    Args:
        values: Estimates of one thing.
        variance: Of each by noise.
    """
    weight = 1.0 / variance
    mean = float(weight @ values / weight.sum())
    excess = float(weight @ (values - mean) ** 2) - (len(values) - 1)
    return excess, float(weight.sum() - weight @ weight / weight.sum())


def _spread_of_joint(evidence: Evidence, joint: int, weights: Float[Array, " P"]) -> float:
    own = weights[evidence.layout.local[joint]]
    level, variance = evidence.friction.relative_levels(joint, own)
    held, runs = evidence.settings, len(level)
    if runs < 2:
        return held.usual_spread
    excess, scale = excess_over_noise(level, variance * evidence.misfit(joint, weights))
    found = max(0.0, excess) / max(scale, 1e-300)
    usual = held.usual_runs * held.usual_spread**2
    return float(np.sqrt((runs * found + usual) / (runs + held.usual_runs)))


def estimate_held(evidence: Evidence, model: Projection) -> tuple[DwellRows, ...]:
    """Each joint's holds with the level of static friction that what a model leaves of them speaks for.

    With z the rows' residuals in standard deviations and h the share of each that the model took up, f_s² times
    (ν + Σ z²) / (ν + Σ (1 − h)): the guess, by the Coulomb level, counts as ν holds.

    Args:
        evidence: Sums with the holds in them.
        model: A model with all that may act.
    """
    weights = residual_weights(evidence, model)
    root = np.linalg.cholesky(model.spread)
    place = {int(column): k for k, column in enumerate(model.inside)}
    found = []
    for held, local in zip(evidence.dwells, evidence.layout.local, strict=True):
        rows = held.weighted
        used = [k for k, column in enumerate(local) if int(column) in place]
        taken = float(np.sum((rows[:, used] @ root[[place[int(local[k])] for k in used]]) ** 2))
        holds = len(np.unique(held.hold))
        factor = (GUESS + float(np.sum((rows @ weights[local]) ** 2))) / (GUESS + max(holds - taken, 0.0))
        found.append(replace(held, friction=held.friction * float(np.sqrt(factor))))
    return tuple(found)
