"""Laws of the mean spectrum."""

import numpy as np
import pytest
from scipy.signal import welch

from ident.motion.spectrum import mean_spectrum


@pytest.mark.parametrize("length", [64, 65, 300])
def test_the_spectrum_is_the_reference_s(length: int) -> None:
    """Frequencies and densities are those of Welch's method, for even and odd stretches and one that is all."""
    values = np.random.default_rng(1).standard_normal((300, 2))
    frequencies, power = mean_spectrum(values, 125.0, length)
    reference = welch(values, 125.0, nperseg=length, axis=0, detrend=False)
    assert np.allclose(frequencies, reference[0])
    assert np.allclose(power, reference[1], rtol=1e-9)


def test_power_adds_up_to_the_variance() -> None:
    """White noise of variance one has a density of 2 / rate, whose sum over all frequencies is one."""
    frequencies, power = mean_spectrum(np.random.default_rng(2).standard_normal((20_000, 1)), 100.0, 200)
    assert np.trapezoid(power[:, 0], frequencies) == pytest.approx(1.0, rel=0.05)
