"""What blocks of time say: how unsure a model's coefficients are, and how much friction varies from
run to run.

The latter is a variance component of each joint, separated from noise.

A stretch's friction s_r, its viscous and its Coulomb level as shares of the model's, is estimated
from what the model leaves of the stretch, with covariance V_r known from its length and motion.
Both vary by themselves, with variance τ² about means that the model has; τ is where

    −½ Σ (log|Σ_r| + (s_r − s̄)ᵀ Σ_r⁻¹ (s_r − s̄)) − ½ log|Σ Σ_r⁻¹| − ½ ν (log τ² + τ_0² / τ²),
    Σ_r = V_r + τ² I,

is greatest: few runs say little of it, and what is usual, τ_0, counts as ν more (`usual_runs`).

Source: Patterson and Thompson 1971 (restricted likelihood of a variance component).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.regression.dwells import DwellRows
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.level_likelihood import walk_likelihood
from ident.regression.settings import RegressionSettings

# Holds that a joint's level of static friction, guessed by its Coulomb friction, counts as.
GUESS = 4.0
# Spreads of friction that are tried: least and greatest share, and how many (chosen: steps of 4 %).
SPREADS = (1e-3, 0.5, 160)
# Below this share of the model's variance the variance between blocks is numerically zero.
LEAST_BLOCK_VARIANCE = 1e-9
# Columns of a joint that carry less than this share of its largest carry nothing: their scores are
# no measure of how blocks vary; nor are those of columns of whose scores the model leaves less than
# the second share.
LEAST_COLUMN = 1e-6
LEAST_LEFT = 0.05


def squares_left(evidence: Evidence, projection: Projection) -> Float[Array, "n B"]:
    """Squares of what a model leaves of each joint's rows, summed over each block, in units of the
    noise's variance.
    """
    squares = []
    for j, local in enumerate(evidence.layout.local):
        weights = projection.weights[local]
        squares.append(evidence.times(j, weights) @ weights)
    return np.array(squares)


def block_sums_left(evidence: Evidence, projection: Projection) -> Float[Array, "B P"]:
    """Scores of each block: every column, the torque last, times what a model leaves of the rows,
    summed over the block.
    """
    sums = np.zeros((len(evidence.fold_of_block), evidence.layout.size + 1))
    for j, local in enumerate(evidence.layout.local):
        sums[:, local] += evidence.times(j, projection.weights[local])
    return sums


def robust_covariance(evidence: Evidence, projection: Projection) -> Float[Array, "z z"]:
    """Covariance of a model's coefficients by the block sandwich, with variances not below the
    model's own.
    """
    every = block_sums_left(evidence, projection)
    left = every[:, projection.inside]
    blocks = len(left)
    meat = left.T @ left * blocks / max(blocks - 1, 1)
    spread = projection.spread
    sandwich = spread @ meat @ spread
    return floor_at_model_variance(sandwich, spread)


def floor_at_model_variance(
    sandwich: Float[Array, "z z"], spread: Float[Array, "z z"]
) -> Float[Array, "z z"]:
    """A block sandwich covariance, scaled so that no variance is below the model's own.

    Args:
        sandwich: The covariance by block scores.
        spread: The model's own.
    """
    of_model = np.diag(spread)
    between = np.diag(sandwich)
    # A column that is nearly zero in all blocks has no variance between them: the model's holds.
    silent = between <= LEAST_BLOCK_VARIANCE * of_model
    ratio = of_model / np.where(silent, of_model, between)
    lift = np.where(silent, 0.0, np.sqrt(np.maximum(1.0, ratio)))
    floor = np.diag(np.where(silent, of_model, 0.0))
    return np.asarray(sandwich * np.outer(lift, lift) + floor)


def measure_inflation(
    evidence: Evidence, projection: Projection, known: Float[Array, "z z"] | None = None
) -> float:
    """Variance inflation: factor by which block scores vary more than the noise model says; divides
    log evidence.

    It is the median ratio of sandwich to model variance over the baseline's coefficients, at least
    1.

    Args:
        evidence, projection: Block sums and the solved model.
        known: Sandwich covariance of its coefficients, if it was computed before.
    """
    if known is None:
        known = robust_covariance(evidence, projection)
    tuned = slice(evidence.layout.tuned)
    model = np.diag(projection.spread)[tuned]
    robust = np.diag(known)[tuned]
    ratios = robust / np.maximum(model, 1e-300)
    return float(max(1.0, np.median(ratios)))


def worth_of_rows(evidence: Evidence, projection: Projection) -> Float[Array, " n"]:
    """How many whitened rows of each joint are worth one independent row of the noise, one at the
    least.

    Two things tell it, of which the larger counts: the mean square of what the model leaves of the
    rows, and by how much the squares of blocks' scores exceed those of independent rows.

    Args:
        evidence: Sums of the session.
        projection: A solved model.
    """
    worths = np.ones(evidence.layout.n)
    for j, local in enumerate(evidence.layout.local):
        dispersion = evidence.dispersion[j]
        weights = projection.weights[local]
        squares = weights @ evidence.total[j].over() @ weights
        mean_square = squares / max(float(evidence.samples[j]), 1.0)
        ratios = [1.0 / dispersion, mean_square]
        score_ratios = _score_ratios(evidence, projection, j)
        if len(score_ratios) > 0:
            ratios.append(np.median(score_ratios))
        worths[j] = dispersion * max(ratios)
    return worths


def _score_ratios(evidence: Evidence, projection: Projection, joint: int) -> Float[Array, " c"]:
    """Squares of blocks' scores Xᵀr, summed over the blocks, over what independent rows would have.

    With G = XᵀX and C the covariance of the model's coefficients, independent rows have the
    diagonal of G − G C G: of the scores the model has taken a part.

    Args:
        evidence: Sums of the session.
        projection: A solved model.
        joint: Index of the joint.

    Returns:
        One ratio for each of the joint's columns in the model that carries something and of whose
        scores the model leaves something.
    """
    local = evidence.layout.local[joint]
    in_rows = np.flatnonzero(np.isin(local, projection.inside))
    in_model = projection.places(local[in_rows])
    gram = evidence.total[joint].over()[np.ix_(in_rows, in_rows)]
    covariance = projection.spread[np.ix_(in_model, in_model)]
    power = np.diag(gram)
    expected = np.diag(gram - gram @ covariance @ gram)
    carries = power > LEAST_COLUMN * power.max(initial=0.0)
    used = carries & (expected > LEAST_LEFT * power)
    if not used.any():
        return np.zeros(0)
    every = evidence.times(joint, projection.weights[local])
    scores = every[:, in_rows[used]]
    squares = (scores**2).sum(axis=0)
    return np.asarray(squares / expected[used])


def estimate_run_spread(evidence: Evidence, weights: Float[Array, " P"]) -> Float[Array, " n"]:
    """Relative standard deviation of each joint's friction from run to run.

    Args:
        evidence: Sums of the session.
        weights: What a model leaves of a row is the row's product with these; solved with about
            this spread or more.
    """
    return np.array([_spread_of_joint(evidence, j, weights) for j in range(evidence.layout.n)])


def _spread_of_joint(evidence: Evidence, joint: int, weights: Float[Array, " P"]) -> float:
    """A joint's spread; the usual one where a single stretch says nothing of it.

    Args:
        evidence: Sums of the session.
        joint: Index of the joint.
        weights: As in `estimate_run_spread`.
    """
    settings = evidence.settings
    levels, noise = levels_left(evidence, joint, weights)
    if len(levels) < 2:
        return settings.usual_spread
    tried = np.geomspace(*SPREADS)
    likelihoods = walk_likelihood(levels, noise, tried, 0.0)
    return float(tried[np.argmax(likelihoods + spread_prior(tried, settings))])


def levels_left(
    evidence: Evidence, joint: int, weights: Float[Array, " P"]
) -> tuple[Float[Array, "R 2"], Float[Array, "R 2 2"]]:
    """Friction levels of the stretches in which a joint moves, by what a model leaves of its rows.

    Args:
        evidence: Sums of the session.
        joint: Index of the joint.
        weights: As in `estimate_run_spread`.

    Returns:
        Each stretch's viscous and Coulomb level as shares of the model's, and the covariance of
        both by noise.
    """
    misfit = evidence.misfit(joint, weights)
    of_weights, noise = evidence.friction.estimate_levels(joint, misfit)
    of_joint = weights[evidence.layout.local[joint]]
    return (of_weights @ of_joint).reshape(-1, 2), noise


def spread_prior(spread: Any, settings: RegressionSettings) -> Any:
    """Log prior of friction's relative spread, or of several, up to a constant [nats].

    Args:
        spread: τ.
        settings: τ_0 and ν, `usual_spread` and `usual_runs`.
    """
    ratio = settings.usual_spread / spread
    return -0.5 * settings.usual_runs * (2.0 * np.log(spread) + ratio**2)


def estimate_held(
    evidence: Evidence, dwells: Sequence[DwellRows], model: Projection
) -> tuple[float, ...]:
    """The level of static friction that what a model leaves of each joint's holds speaks for [N m].

    With z the rows' residuals in standard deviations and h the share of each that the model took
    up, f_s² times (ν + Σ z²) / (ν + Σ (1 − h)): the guess, by the Coulomb level, counts as ν holds.

    Args:
        evidence: Sums with the holds in them.
        dwells: The holds, joint by joint.
        model: A model with all that may act.
    """
    root = np.linalg.cholesky(model.spread)
    levels = []
    for held, local in zip(dwells, evidence.layout.local, strict=True):
        rows = held.weighted
        used = np.flatnonzero(np.isin(local, model.inside))
        places = model.places(local[used])
        of_model = rows[:, used] @ root[places]
        residual = rows @ model.weights[local]
        taken = float(np.sum(of_model**2))
        left = float(np.sum(residual**2))
        holds = len(np.unique(held.hold))
        factor = (GUESS + left) / (GUESS + max(holds - taken, 0.0))
        levels.append(held.friction * float(np.sqrt(factor)))
    return tuple(levels)
