"""The size at which a cause shows as much as is wanted: regula falsi on logarithmic scales, within physical bounds.

Most causes show in proportion to a power of their size, a straight line on logarithmic scales, so that two or three
trials find it; one that sets in at a threshold (play, saturation) is bracketed.

Source: Dowell and Jarratt 1971 (the Illinois method).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

MOST_TRIALS = 12
# A first step goes no further than by this factor: far from a trial the power law is a guess.
LONGEST_STEP = 30.0
# Exponents of the power law that two trials on one side may suggest.
LEAST_POWER, GREATEST_POWER = 0.3, 4.0
# Relative difference below which two sizes are one: they are reported with four digits.
SAME = 1e-3
# Logarithms of a size, and of how much it shows as a multiple of what is wanted.
Trial = tuple[float, float]


def find_size(
    shown: Callable[[float], float], wanted: float, start: float, ends: tuple[float, float], tolerance: float
) -> tuple[float, float]:
    """Tries sizes until one shows what is wanted, or a bound shows too little or too much.

    Args:
        shown: How much a size shows; called with sizes of four digits, as they are reported.
        wanted: How much is wanted.
        start: Size to begin with.
        ends: The sizes that show least and most; the first is the larger where a smaller size shows more.
        tolerance: Relative error of what is shown at which to stop.

    Returns:
        The best size that was tried, and what it shows.
    """
    best, off, size = (np.nan, np.nan), np.inf, start
    below: Trial | None = None
    above: Trial | None = None
    last: Trial | None = None
    for _ in range(MOST_TRIALS):
        size = float(f"{size:.4g}")  # the last digits depend on the machine's linear algebra
        seen = shown(size)
        with np.errstate(divide="ignore"):
            trial = float(np.log(size)), float(np.log(seen / wanted))
        if abs(trial[1]) <= off:
            best, off = (size, seen), abs(trial[1])
        too_little = seen / wanted < 1.0
        at_end = np.isclose(trial[0], np.log(ends[too_little]), rtol=0.0, atol=SAME)
        if off < tolerance or at_end:
            break
        # The far side counts as half as far off where the near side moved twice running.
        if too_little:
            below, above = trial, (above[0], 0.5 * above[1]) if above and last is below else above
        else:
            above, below = trial, (below[0], 0.5 * below[1]) if below and last is above else below
        if below and above:
            finite = np.isfinite(below[1]) and np.isfinite(above[1])
            share = below[1] / (below[1] - above[1]) if finite else 0.5
            guess = below[0] + share * (above[0] - below[0])
        else:
            guess = float(np.clip(trial[0] + _step(trial, last, ends), *sorted(np.log(ends))))
        last, size = trial, float(np.exp(guess))
        if abs(guess - trial[0]) <= SAME:
            break
    return best


def _step(trial: Trial, last: Trial | None, ends: tuple[float, float]) -> float:
    """Step of a search that has seen one side only, along the power law of the last two trials."""
    power = 1.0
    if last and np.isfinite(last[1]) and np.isfinite(trial[1]):
        power = np.clip(abs((trial[1] - last[1]) / (trial[0] - last[0])), LEAST_POWER, GREATEST_POWER)
    longest = np.log(LONGEST_STEP)
    return float(np.clip(-trial[1], -longest, longest) / (power if ends[0] <= ends[1] else -power))
