"""Whether friction changes by a law of warmth or merely wanders from run to run.

A slow curve follows some of any random walk, so that a law of warmth must be likelier than one. Of every stretch r the
levels of viscous and Coulomb friction are known, as shares y_r of the model's, with covariance V_r:

    y_r = x_r + D_r b + e_r,    x_r = x_{r−1} + w_r,    Var e_r = V_r + τ² I,    Var w_r = σ² R,    R = I or 1 1ᵀ.

The law has b and no walk (σ = 0), the walk has no law (b = 0). Of either the likeliest τ counts, of the walk σ and R,
of the law its inner parameters. A coefficient costs half the logarithm of the number of levels, a choice that of how
many there are to choose from.

Source: Harvey 1989, sections 2.3 and 3.4 (random walk plus noise, its likelihood by the Kalman filter); Schwarz 1978.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection

# Variance of the first level before anything is known of it: ten times the model's friction.
UNKNOWN = 100.0
# Of a walk: viscous and Coulomb friction each by itself, or both alike.
KINDS = np.stack([np.eye(2), np.ones((2, 2))])


def log_odds_of_law(evidence: Evidence, model: Projection, variants: Sequence[Group]) -> float:
    """By how much a slow law at a joint is likelier than friction that wanders there [nats].

    Args:
        evidence: Sums of the session.
        model: The model without the law.
        variants: The law, with all its inner parameters.
    """
    joint = variants[0].joint
    local, settings = evidence.layout.local[joint], evidence.settings.wandering
    seen, noise = evidence.friction.levels(joint, evidence.misfit(joint, model.weights))
    columns = [seen @ model.left_of(group.columns)[local] for group in variants]
    return log_odds_of_curve(seen @ model.weights[local], noise, columns, settings.own, settings.steps)


def log_odds_of_curve(
    levels: Float[Array, " s"],
    noise: Float[Array, "R 2 2"],
    laws: Sequence[Float[Array, "s k"]],
    own: Sequence[float],
    steps: Sequence[float],
) -> float:
    """By how much the likeliest of some laws is likelier than a random walk [nats].

    Args:
        levels: Viscous and Coulomb level of each of R stretches in turn, s = 2 R of them.
        noise: Their covariance by noise, stretch by stretch.
        laws: What each variant of the law adds to the levels, a column a coefficient.
        own: Standard deviations of a stretch's own friction that are tried.
        steps: Standard deviations of a walk's step that are tried.
    """
    size = np.log(max(len(levels), 2))
    each_own = np.repeat(own, len(steps) * len(KINDS))
    each_step = np.tile(np.square(steps)[:, None, None, None] * KINDS, (len(own), 1, 1, 1)).reshape(-1, 2, 2)
    white, scale = _innovations(levels[:, None], noise, each_own, each_step)
    walk = float(np.max(-0.5 * np.sum(white**2, axis=(1, 2)) - scale)) - 0.5 * size - np.log(len(KINDS))
    best = -np.inf
    for law in laws:
        white, scale = _innovations(np.column_stack([levels, law]), noise, np.array(own), np.zeros((len(own), 2, 2)))
        for one, each in zip(white, scale, strict=True):
            left = one[:, 0] - one[:, 1:] @ np.linalg.lstsq(one[:, 1:], one[:, 0], rcond=1e-6)[0]
            best = max(best, float(-0.5 * left @ left - each) - 0.5 * law.shape[1] * size - np.log(len(laws)))
    return best - walk


def _innovations(
    signals: Float[Array, "s m"], noise: Float[Array, "R 2 2"], own: Float[Array, " C"], walk: Float[Array, "C 2 2"]
) -> tuple[Float[Array, "C s m"], Float[Array, " C"]]:
    """What a Kalman filter of each of C walks does not foretell of some signals, in standard deviations.

    Args:
        signals: Two levels of each stretch in turn, one signal beside the other.
        noise: Covariance of the two levels by noise, stretch by stretch.
        own: Standard deviation of a stretch's own levels, walk by walk.
        walk: Covariance of a step, walk by walk.

    Returns:
        The innovations, and half the logarithm of their covariance's determinant.
    """
    cases, stretches = len(own), len(noise)
    white, scale = np.zeros((cases, stretches, 2, signals.shape[1])), np.zeros(cases)
    mean, spread = np.zeros((cases, 2, signals.shape[1])), UNKNOWN * np.broadcast_to(np.eye(2), (cases, 2, 2))
    for r, seen in enumerate(signals.reshape(stretches, 2, -1)):
        whole = spread + noise[r] + own[:, None, None] ** 2 * np.eye(2)
        root, new = np.linalg.cholesky(whole), seen - mean
        white[:, r] = np.linalg.solve(root, new)
        scale += np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
        gain = spread @ np.linalg.inv(whole)
        mean = mean + gain @ new
        spread = spread - gain @ spread + walk
    return white.reshape(cases, 2 * stretches, -1), scale
