"""Laws of the common filter: its design and its numbers are SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfilt, sosfiltfilt, sosfreqz

from ident.motion.filter import design_lowpass, filter_both_ways, resting_states


@pytest.mark.parametrize(
    ("order", "cutoff", "rate"), [(4, 10.0, 250.0), (4, 5.0, 30.0), (2, 0.5, 1000.0), (6, 40.0, 100.0)]
)
def test_the_design_is_that_of_scipy(order: int, cutoff: float, rate: float) -> None:
    """One at rest, 3 dB down at the corner, and the same response as the reference at every frequency."""
    ours = design_lowpass(order, cutoff, rate)
    frequencies = np.linspace(0.0, 0.499 * rate, 200)
    response = sosfreqz(ours, frequencies, fs=rate)[1]
    reference = sosfreqz(butter(order, cutoff, fs=rate, output="sos"), frequencies, fs=rate)[1]
    assert np.allclose(response, reference, rtol=0, atol=1e-9)
    assert np.abs(sosfreqz(ours, [cutoff], fs=rate)[1][0]) == pytest.approx(np.sqrt(0.5))


def test_a_resting_filter_stays_at_rest() -> None:
    """Started in its resting state, a filter answers a constant by that constant, from the first sample."""
    sections = design_lowpass(4, 10.0, 250.0)
    out, _ = sosfilt(sections, np.full(50, 3.0), zi=3.0 * resting_states(sections))
    assert np.allclose(out, 3.0)


@pytest.mark.parametrize(("order", "cutoff"), [(3, 10.0), (4, 50.0), (4, 0.0)])
def test_no_filter_where_there_can_be_none(order: int, cutoff: float) -> None:
    """Odd orders and corners beyond half the rate are refused."""
    with pytest.raises(ValueError, match="no low-pass"):
        design_lowpass(order, cutoff, 100.0)


@pytest.mark.parametrize("shape", [(400,), (400, 6), (400, 6, 3), (40, 100)])
@pytest.mark.parametrize("padding", [0, 1, 39])
@pytest.mark.parametrize("order", [2, 4, 5, 7])
def test_equals_scipy(shape: tuple[int, ...], padding: int, order: int) -> None:
    """Law: whatever the shape, the extension and the number of sections, the numbers are those of `sosfiltfilt`."""
    sections = butter(order, 10.0, fs=125.0, output="sos")
    values = np.random.default_rng(3).normal(size=shape).cumsum(axis=0)
    expected = sosfiltfilt(sections, values, axis=0, padlen=padding)
    assert np.allclose(filter_both_ways(sections, values, padding), expected, rtol=1e-11, atol=1e-11)


def test_leaves_its_input_alone() -> None:
    """Law: the signals that are filtered stay what they were."""
    values = np.random.default_rng(4).normal(size=(50, 2))
    before = values.copy()
    filter_both_ways(butter(2, 10.0, fs=125.0, output="sos"), values, 9)
    assert np.array_equal(values, before)
