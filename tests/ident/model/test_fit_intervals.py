"""Laws of intervals about values that lie beside those of least variance."""

import numpy as np
import pytest

from ident.model.intervals import half_width, quantile

DEVIATION, DOF = 0.3, 8.0


@pytest.mark.parametrize("level", [0.5, 0.95, 0.99])
@pytest.mark.parametrize("shift", [0.0, 0.1, 0.5, -2.0])
def test_an_interval_holds_the_truth_as_often_as_it_says(shift: float, level: float) -> None:
    """Law: of drawn errors of the value of least variance, the said share lies within, whatever the shift."""
    errors = shift + DEVIATION * np.random.default_rng(3).standard_t(DOF, 200_000)
    half = half_width(np.array([DEVIATION]), np.array([shift]), np.array([DOF]), level)
    assert np.mean(np.abs(errors) <= half) == pytest.approx(level, abs=4e-3)


def test_no_shift_is_the_usual_interval() -> None:
    """Law: without a shift the half width is Student's, also beside others that are shifted."""
    usual = quantile(np.array([DOF])) * DEVIATION
    assert half_width(np.array([DEVIATION]), np.zeros(1), np.array([DOF])) == pytest.approx(usual)
    both = half_width(np.full(2, DEVIATION), np.array([0.0, 1.0]), np.full(2, DOF))
    assert both[0] == pytest.approx(usual[0])


def test_a_shift_is_no_spread() -> None:
    """Law: wider with the shift, by less than the shift; and narrower than of the mean square error."""
    shifts = np.linspace(0.0, 3.0, 13)
    half = half_width(np.full(13, DEVIATION), shifts, np.full(13, DOF))
    growth = np.diff(half)
    assert np.all(growth > 0.0)
    assert np.all(growth <= np.diff(shifts) + 1e-9)
    assert np.all(half[4:] < quantile(np.full(9, DOF)) * np.hypot(DEVIATION, shifts[4:]))
    assert half_width(np.zeros(1), np.array([-0.7]), np.array([DOF])) == pytest.approx(0.7)
