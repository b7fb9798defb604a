"""How much each joint's friction varies from run to run: a variance component, separated from noise.

A stretch's friction s_r, its viscous and its Coulomb level as shares of the model's, is estimated from what the model
leaves of the stretch, with covariance V_r known from its length and motion. Both vary by themselves, with variance τ²
about means that the model has; τ is where

    −½ Σ (log|Σ_r| + (s_r − s̄)ᵀ Σ_r⁻¹ (s_r − s̄)) − ½ log|Σ Σ_r⁻¹| − ½ ν (log τ² + τ_0² / τ²),    Σ_r = V_r + τ² I,

is greatest: few runs say little of it, and what is usual, τ_0, counts as ν more (`usual_runs`).

Source: Patterson and Thompson 1971 (restricted likelihood of a variance component).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.regression.dwells import DwellRows
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.settings import RegressionSettings

# Holds that a joint's level of static friction, guessed by its Coulomb friction, counts as.
GUESS = 4.0
# Spreads of friction that are tried: least and greatest share, and how many (chosen: steps of 4 %).
SPREADS = (1e-3, 0.5, 160)


def squares_left(evidence: Evidence, projection: Projection) -> Float[Array, "n B"]:
    """What a model leaves of each joint's rows in each block, in squares of the noise."""
    weights = projection.weights
    return np.array([evidence.times(j, weights[own]) @ weights[own] for j, own in enumerate(evidence.layout.local)])


def block_sums_left(evidence: Evidence, projection: Projection) -> Float[Array, "B P"]:
    """Sums over each block of every column, the torque last, times what a model leaves of the rows."""
    sums = np.zeros((len(evidence.fold_of_block), evidence.layout.size + 1))
    for j, local in enumerate(evidence.layout.local):
        sums[:, local] += evidence.times(j, projection.weights[local])
    return sums


def block_scores(evidence: Evidence, projection: Projection) -> Float[Array, "B P"]:
    """Score of every column in every block, after the model: Φ̃_bᵀ r_b."""
    raw = block_sums_left(evidence, projection)
    return raw - raw[:, projection.inside] @ projection.slopes


def estimate_run_spread(evidence: Evidence, projection: Projection) -> Float[Array, " n"]:
    """Relative standard deviation of each joint's friction from run to run.

    Args:
        evidence: Sums of the session.
        projection: The model that leaves the residual; solved with about this spread or a larger one.
    """
    return np.array([_spread_of_joint(evidence, j, projection.weights) for j in range(evidence.layout.n)])


def _spread_of_joint(evidence: Evidence, joint: int, weights: Float[Array, " P"]) -> float:
    settings = evidence.settings
    follow, noise = evidence.friction.levels(joint, evidence.misfit(joint, weights))
    levels = (follow @ weights[evidence.layout.local[joint]]).reshape(-1, 2)
    if len(levels) < 2:
        return settings.usual_spread
    tried = np.geomspace(*SPREADS)
    return float(tried[np.argmax(_likelihood(levels, noise, tried, settings))])


def _likelihood(
    levels: Float[Array, "R 2"], noise: Float[Array, "R 2 2"], spreads: Float[Array, " k"], settings: RegressionSettings
) -> Float[Array, " k"]:
    """Restricted log likelihoods of friction levels that vary by so much, times what is known of it beforehand."""
    each = np.linalg.inv(noise + spreads[:, None, None, None] ** 2 * np.eye(2))
    total = each.sum(axis=1)
    mean = np.linalg.solve(total, np.einsum("krab,rb->ka", each, levels)[..., None])[..., 0]
    off = levels - mean[:, None]
    left = np.einsum("kra,krab,krb->k", off, each, off)
    weight = np.linalg.slogdet(each)[1].sum(axis=1) - np.linalg.slogdet(total)[1]
    usual = settings.usual_runs * (2.0 * np.log(spreads) + (settings.usual_spread / spreads) ** 2)
    return np.asarray(0.5 * (weight - left - usual))


def estimate_held(evidence: Evidence, dwells: Sequence[DwellRows], model: Projection) -> tuple[float, ...]:
    """The level of static friction that what a model leaves of each joint's holds speaks for [N m].

    With z the rows' residuals in standard deviations and h the share of each that the model took up, f_s² times
    (ν + Σ z²) / (ν + Σ (1 − h)): the guess, by the Coulomb level, counts as ν holds.

    Args:
        evidence: Sums with the holds in them.
        dwells: The holds, joint by joint.
        model: A model with all that may act.
    """
    root = np.linalg.cholesky(model.spread)
    found = []
    for held, local in zip(dwells, evidence.layout.local, strict=True):
        rows = held.weighted
        used = np.flatnonzero(np.isin(local, model.inside))
        taken = float(np.sum((rows[:, used] @ root[model.places(local[used])]) ** 2))
        holds = len(np.unique(held.hold))
        factor = (GUESS + float(np.sum((rows @ model.weights[local]) ** 2))) / (GUESS + max(holds - taken, 0.0))
        found.append(held.friction * float(np.sqrt(factor)))
    return tuple(found)
