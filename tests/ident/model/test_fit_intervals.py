"""Laws of intervals of values that may lie beside the ones of least variance."""

import numpy as np
import pytest

from ident.model.intervals import limits, quantile

DEVIATION, DOF = 0.3, 8.0


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
@pytest.mark.parametrize("apart", [0.0, 0.1, 0.6])
def test_an_interval_holds_the_truth_as_often_as_it_says(apart: float, level: float) -> None:
    """Law: the said share of truths lies within, or more by what reaches out to the value."""
    rng = np.random.default_rng(3)
    errors = DEVIATION * rng.standard_t(DOF, 100_000)
    shift = apart * rng.standard_normal(100_000)
    ends = limits(errors + shift, shift, np.full(100_000, DEVIATION), np.full(100_000, DOF), level)
    held = (ends[:, 0] <= 0.0) & (ends[:, 1] >= 0.0)
    half = quantile(np.array([DOF]), level) * DEVIATION
    inside = np.abs(shift) <= half
    assert np.mean(held[inside]) == pytest.approx(level, abs=6e-3)
    assert np.mean(held) >= level - 5e-3


def test_no_shift_is_the_usual_interval() -> None:
    """Law: without a shift it is Student's about the value, also beside others that are shifted."""
    usual = quantile(np.array([DOF])) * DEVIATION
    ends = limits(np.ones(2), np.array([0.0, 1.0]), np.full(2, DEVIATION), np.full(2, DOF))
    assert ends[0] == pytest.approx([1.0 - usual[0], 1.0 + usual[0]])


def test_an_interval_stays_where_the_preferred_value_moves() -> None:
    """Law: no wider while the value lies inside, then as wide as reaches the value, which is never outside."""
    shift = np.linspace(-3.0, 3.0, 25)
    ends = limits(1.0 + shift, shift, np.full(25, DEVIATION), np.full(25, DOF))
    half = quantile(np.array([DOF]))[0] * DEVIATION
    width = np.diff(ends, axis=1)[:, 0]
    inside = np.abs(shift) <= half
    assert inside.any()
    assert not inside.all()
    assert width[inside] == pytest.approx(2.0 * half)
    assert width[~inside] == pytest.approx(half + np.abs(shift[~inside]))
    assert np.all((ends[:, 0] <= 1.0 + shift) & (ends[:, 1] >= 1.0 + shift))
