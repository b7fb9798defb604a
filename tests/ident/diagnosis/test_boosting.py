"""What the diagnosis has small ones of its own of: the same numbers as the libraries that take longer to load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.optimize import nnls
from sklearn.ensemble import HistGradientBoostingRegressor

from ident.diagnosis.gap.boosting import grow_trees
from ident.diagnosis.gap.settings import USUAL_TREES
from ident.diagnosis.regression.least_squares import solve_signed
from ident.effects.contact import _running_mean
from ident.telemetry.spikes import running_medians


@pytest.mark.parametrize("samples", [30, 60, 700, 3000])
@pytest.mark.parametrize("penalty", [0.0, 1.0])
def test_trees_are_those_of_scikit_learn(samples: int, penalty: float) -> None:
    """Law: the same splits and answers, on samples seen and unseen, with inputs of few values and of one."""
    rng = np.random.default_rng(samples)
    inputs, unseen = rng.standard_normal((samples, 9)), 1.5 * rng.standard_normal((400, 9))
    inputs[:, 1], inputs[:, 2] = np.round(inputs[:, 1]), 1.0
    inputs[:, 3] = np.arange(samples)
    values = np.sin(3.0 * inputs[:, 0]) + 0.5 * np.sign(inputs[:, 1] + inputs[:, 4]) + 1e-3 * inputs[:, 3]
    values += 0.3 * rng.standard_normal(samples)
    settings = replace(USUAL_TREES, penalty=penalty)
    theirs = HistGradientBoostingRegressor(
        max_iter=settings.rounds,
        max_leaf_nodes=settings.leaves,
        learning_rate=settings.rate,
        min_samples_leaf=settings.leaf_samples,
        l2_regularization=settings.penalty,
        early_stopping=False,
    ).fit(inputs, values)
    ours = grow_trees(inputs, values, settings)
    for asked in (inputs, unseen):
        assert np.allclose(ours.predict(asked), theirs.predict(asked), rtol=0, atol=1e-12)


def test_more_trees_leave_less_of_what_they_saw() -> None:
    """Law: each tree lowers the squared error of its own samples."""
    rng = np.random.default_rng(1)
    inputs = rng.standard_normal((500, 3))
    values = inputs[:, 0] * inputs[:, 1]
    left = [
        np.mean((values - grow_trees(inputs, values, replace(USUAL_TREES, rounds=k)).predict(inputs)) ** 2)
        for k in (1, 5, 25)
    ]
    assert np.var(values) > left[0] > left[1] > left[2]


@pytest.mark.parametrize("unknowns", [1, 2, 4, 7])
def test_signed_least_squares_are_those_of_scipy(unknowns: int) -> None:
    """Law: the least squares with bounds, whichever unknowns have one; a free one is the difference of two bounded."""
    rng = np.random.default_rng(unknowns)
    for _ in range(50):
        rows, goal = rng.standard_normal((20, unknowns)), rng.standard_normal(20)
        rows[:, -1] += 3.0 * rows[:, 0]
        signed = rng.random(unknowns) < 0.6
        doubled = nnls(np.column_stack([rows, -rows[:, ~signed]]), goal)[0]
        expected = doubled[:unknowns].copy()
        expected[~signed] -= doubled[unknowns:]
        found = solve_signed(rows.T @ rows, rows.T @ goal, signed)
        assert np.all(found[signed] >= 0.0)
        assert np.allclose(found, expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("width", [1, 2, 5, 8, 40])
def test_running_means_and_medians_are_those_of_scipy(width: int) -> None:
    """Law: mirrored at the ends, or held there."""
    values = np.random.default_rng(width).random(30)
    assert np.allclose(_running_mean(values, width), uniform_filter1d(values, width), rtol=0, atol=1e-14)
    held = running_medians(np.pad(values, width, mode="edge")[:, None], width)[:, 0]
    assert np.array_equal(held, median_filter(values, 2 * width + 1, mode="nearest"))
