"""Clamped cubic splines against SciPy's, and their exact extremes."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import CubicSpline

from plan.spline import Splines


def random_splines(seed: int, vias: int, batch: int = 20) -> Splines:
    rng = np.random.default_rng(seed)
    return Splines(rng.uniform(-2, 2, (batch, vias + 2, 3)), rng.uniform(0.1, 1.0, (batch, vias + 1)))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(0, 6))
def test_equals_scipy(seed: int, vias: int) -> None:
    """Position, velocity and acceleration equal SciPy's clamped spline to 1e-9 of their size."""
    splines = random_splines(seed, vias, 1)
    knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
    known = CubicSpline(knots, splines.points[0], bc_type="clamped")
    times = np.linspace(0.0, knots[-1], 50)
    for order, ours in enumerate(splines.at(times)):
        theirs = known(times, order)
        assert np.abs(ours - theirs).max() < 1e-9 * max(1.0, np.abs(theirs).max())


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000), st.integers(0, 5))
def test_extremes_bound_dense_samples(seed: int, vias: int) -> None:
    """Top speed and position range are never passed by dense samples, and are met by them to 0.1 %."""
    splines = random_splines(seed, vias)
    q, dq, _ = splines.states(np.linspace(0, 1, 400))
    for exact, sampled in (
        (splines.top_speed, np.abs(dq).max(axis=1)),
        (splines.highest, q.max(axis=1)),
        (-splines.lowest, -q.min(axis=1)),
    ):
        assert np.all(exact >= sampled - 1e-9)
        assert np.all(exact <= sampled + 1e-3 * (1.0 + np.abs(sampled)))


def test_batch_equals_single() -> None:
    """Section by section, the batch gives what `at` gives."""
    splines = random_splines(3, 2)
    s = np.array([0.0, 0.3, 1.0])
    batch = splines.states(s)
    one = Splines(splines.points[4:5], splines.durations[4:5])
    knots = np.concatenate([[0.0], np.cumsum(one.durations[0])])
    times = (knots[:-1, None] + s * one.durations[0][:, None]).reshape(-1) - 1e-12
    for order, values in enumerate(one.at(np.maximum(times, 0.0))):
        assert np.allclose(batch[order][4], values, atol=1e-8)
