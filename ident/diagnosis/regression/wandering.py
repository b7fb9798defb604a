"""Whether friction changes by a law of warmth or merely wanders from run to run.

A slow curve follows some of any random walk, so that a law of warmth must show beside one. Of every stretch r the level
of its viscous and of its Coulomb friction are known, as shares y_r of the model's, with covariance V_r. They are
normal about their mean (and about what the law gives, D_r b) with covariance

    V_r δ_rs + τ² I δ_rs + σ² min(r, s) R,   R = I or 1 1ᵀ:

levels of their own, and a random walk, of either kind of friction alone or of both together. τ, σ, R and b are those of
the greatest likelihood, with and without the law. How much the law gains by chance is drawn: levels of the best model
without it, fitted with every variant of the law.

Source: Harvey 1989, section 2.3 (random walk plus noise); Davison and Hinkley 1997, section 4.2 (Monte Carlo tests).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import Array, Float
from ident.diagnosis.regression.design import Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection
from ident.diagnosis.regression.run_spread import residual_weights
from ident.diagnosis.regression.settings import USUAL_WANDERING, WanderingSettings


def chance_of_law(evidence: Evidence, model: Projection, variants: Sequence[Group], rng: np.random.Generator) -> float:
    """p-value of a slow effect against friction that wanders.

    Args:
        evidence: Sums of the session, friction free to vary.
        model: The model without the effect.
        variants: The effect at its joint, with all its inner parameters.
        rng: Draws levels of friction that wanders.
    """
    joint = variants[0].joint
    weights = residual_weights(evidence, model)
    seen, noise = evidence.friction.levels(joint, evidence.misfit(joint, weights))
    levels = seen @ weights[evidence.layout.local[joint]]
    laws = []
    for group in variants:
        after = np.zeros((evidence.layout.size + 1, len(group.columns)))
        after[group.columns, np.arange(len(group.columns))] = 1.0
        after[model.inside] = -model.slopes[:, group.columns]
        laws.append(seen @ after[evidence.layout.local[joint]])  # what the model leaves of each column
    return chance_of_curve(levels, block_diag(*noise), laws, rng, evidence.settings.wandering)


def chance_of_curve(
    levels: Float[Array, " s"],
    spread: Float[Array, "s s"],
    laws: Sequence[Float[Array, "s k"]],
    rng: np.random.Generator,
    settings: WanderingSettings = USUAL_WANDERING,
) -> float:
    """p-value of laws against friction that wanders, all of them together.

    Args:
        levels: Viscous and Coulomb level of each stretch in turn.
        spread: Their covariance by noise.
        laws: What each variant of the law adds to the levels, a column a coefficient.
        rng: Draws levels of friction that wanders.
        settings: How friction may wander, and how often it is drawn.
    """
    if len(levels) < 2 * settings.fewest:
        return 1.0
    covariances = list(_covariances(spread, settings))
    _, best = _greatest(levels[:, None], covariances, [])
    root = np.linalg.cholesky(covariances[int(best[0])])
    drawn = np.concatenate([levels[:, None], root @ rng.standard_normal((len(levels), settings.draws))], axis=1)
    gain = _greatest(drawn, covariances, laws)[0] - _greatest(drawn, covariances, [])[0]
    return float(np.mean(gain >= gain[0] - 1e-9))


def _covariances(spread: Float[Array, "s s"], settings: WanderingSettings) -> Iterator[Float[Array, "s s"]]:
    """Of the levels (viscous and Coulomb of each stretch in turn), for all that is tried."""
    size = len(spread)
    order = np.arange(size // 2)
    walk = 1.0 + np.minimum(order[:, None], order[None, :])
    walks = [np.kron(walk, kind) for kind in (np.eye(2), np.ones((2, 2)))]
    for own in settings.own:
        yield spread + own**2 * np.eye(size)
        for step in settings.steps[1:]:
            for kind in walks:
                yield spread + own**2 * np.eye(size) + step**2 * kind


def _greatest(
    levels: Float[Array, "s d"], covariances: Sequence[Float[Array, "s s"]], laws: Sequence[Float[Array, "s k"]]
) -> tuple[Float[Array, " d"], Float[Array, " d"]]:
    """Greatest log likelihood of each column of levels over all covariances and laws, and the number of the former."""
    mean = np.tile(np.eye(2), (len(levels) // 2, 1))
    greatest, best = np.full(levels.shape[1], -np.inf), np.zeros(levels.shape[1])
    for k, covariance in enumerate(covariances):
        root = np.linalg.cholesky(covariance)
        y = np.linalg.solve(root, levels)
        fixed = np.linalg.qr(np.linalg.solve(root, mean))[0]
        y -= fixed @ (fixed.T @ y)
        left = np.sum(y**2, axis=0)
        explained = np.zeros_like(left)
        for law in laws:
            curve = np.linalg.solve(root, law)
            curve -= fixed @ (fixed.T @ curve)
            axes, sizes, _ = np.linalg.svd(curve, full_matrices=False)
            explained = np.maximum(explained, np.sum((axes[:, sizes > 1e-6 * sizes[0]].T @ y) ** 2, axis=0))
        value = -0.5 * (left - explained) - np.log(np.diag(root)).sum()
        best = np.where(value > greatest, k, best)
        greatest = np.maximum(greatest, value)
    return greatest, best
