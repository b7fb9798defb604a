"""Laws of friction that wanders: what few noisy steps leave open stays open, and what many tell is taken."""

from __future__ import annotations

import numpy as np
import pytest

from ident.diagnosis.change.between_run_variance import NO_WALK, estimate_random_walk

USUAL = 0.1


def mean_of(runs: int, step: float, noise: float, usual: float = USUAL, seed: int = 5) -> float:
    """Mean variance of the difference of two sets of such runs, as a share of what steps of that size do."""
    rng = np.random.default_rng(seed)
    sets = [
        (np.cumsum(step * rng.standard_normal(runs)) + noise * rng.standard_normal(runs), np.full(runs, noise**2), 1)
        for _ in range(2)
    ]
    found = estimate_random_walk(sets, usual)
    assert found.weight.sum() == pytest.approx(1.0)
    return float(found.weight @ found.variance) / (2.0 * runs / 3.0 * step**2)


def test_many_steps_are_taken_as_they_are_whatever_was_usual() -> None:
    assert mean_of(400, 0.3, 0.01) == pytest.approx(1.0, rel=0.15)
    assert mean_of(400, 0.03, 0.001) == pytest.approx(1.0, rel=0.15)


def test_steps_that_drown_in_noise_stay_as_likely_as_they_usually_are() -> None:
    """An estimate would be zero for half of such sets; friction wanders all the same."""
    found = [mean_of(6, USUAL, 20.0 * USUAL, seed=seed) for seed in range(8)]
    assert min(found) > 1.0


def test_what_does_not_wander_has_no_such_variance() -> None:
    sets = [(np.zeros(5), np.ones(5), 1)] * 2
    assert estimate_random_walk(sets, 0.0) is NO_WALK


def test_sessions_of_several_days_begin_anew() -> None:
    """The same runs from two days instead of one: each mean is off by less, and there are two of them."""
    sizes, noise = 0.1 * np.arange(6.0), np.full(6, 1e-6)
    one, two = (estimate_random_walk([(sizes, noise, days)] * 2, USUAL) for days in (1, 2))
    np.testing.assert_allclose(one.variance, 4.0 * two.variance)
