"""Power spectrum of a signal, averaged over half-overlapping stretches.

Source: Welch 1967; Hann's window.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float


def mean_spectrum(
    values: Float[Array, "T n"], rate: float, length: int
) -> tuple[Float[Array, " f"], Float[Array, "f n"]]:
    """One-sided power density; as scipy.signal's `welch` without detrending, whose import takes a second.

    Args:
        values: Signals, evenly sampled.
        rate: Sampling rate [Hz].
        length: Samples of a stretch, no more than there are.

    Returns:
        Frequencies [Hz] and density [unit² / Hz].
    """
    window = np.sin(np.pi * np.arange(length) / length) ** 2
    step = length - length // 2
    starts = range(0, len(values) - length + 1, step)
    total = np.zeros((length // 2 + 1, values.shape[1]))
    for start in starts:
        total += np.abs(np.fft.rfft(window[:, None] * values[start : start + length], axis=0)) ** 2
    total /= len(starts) * rate * np.sum(window**2)
    total[1 : -1 if length % 2 == 0 else None] *= 2.0
    return np.fft.rfftfreq(length, 1.0 / rate), total
