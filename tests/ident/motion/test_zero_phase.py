"""The compiled filter is SciPy's, column by column."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from ident.motion.zero_phase import filter_both_ways


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
