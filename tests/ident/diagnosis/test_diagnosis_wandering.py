"""A law of warmth against friction that wanders from run to run."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.regression.wandering import chance_of_curve

RUNS, NOISE = 12, 0.004
LAWS = [
    np.kron(np.exp(-np.arange(RUNS) / constant)[:, None], np.eye(2)) for constant in (1.0, 3.0, 10.0)
]  # viscous and Coulomb change as a gear warms up, at three paces


def levels(rng: np.random.Generator, curve: Float[Array, " R"]) -> Float[Array, " s"]:
    """Both levels of each run: a common course, and noise."""
    return np.repeat(curve, 2) + NOISE * rng.standard_normal(2 * RUNS)


def chance(rng: np.random.Generator, curve: Float[Array, " R"]) -> float:
    spread: Array = NOISE**2 * np.eye(2 * RUNS)
    return chance_of_curve(levels(rng, curve), spread, LAWS, rng)


def test_what_wanders_is_taken_for_warmth_as_rarely_as_told() -> None:
    """Law: of random walks, of levels of each run's own and of steady friction, few come below one in ten."""
    rng = np.random.default_rng(8)
    for step, own in ((0.05, 0.0), (0.0, 0.05), (0.0, 0.0)):
        found = [
            chance(rng, np.cumsum(step * rng.standard_normal(RUNS)) + own * rng.standard_normal(RUNS))
            for _ in range(25)
        ]
        assert np.mean(np.array(found) <= 0.1) <= 0.28  # P(Binomial(25, 0.1) > 7) = 0.2 %


def test_warmth_is_found() -> None:
    """Law: a smooth fall by a tenth, far above the noise, is no wandering."""
    rng = np.random.default_rng(9)
    assert chance(rng, 0.1 * np.exp(-np.arange(RUNS) / 3.0)) <= 0.01


def test_few_runs_tell_nothing() -> None:
    assert (
        chance_of_curve(np.array([0.1, 0.1, 0.0, 0.0]), 1e-6 * np.eye(4), [LAWS[0][:4]], np.random.default_rng(0))
        == 1.0
    )
