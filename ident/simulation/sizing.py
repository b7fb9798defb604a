"""The size at which a cause shows as much as is wanted: regula falsi on logarithmic scales, within physical bounds.

Most causes show in proportion to a power of their size, a straight line on logarithmic scales, so that two or three
trials find it; one that sets in at a threshold (play, saturation) is bracketed.

Source: Dowell and Jarratt 1971 (the Illinois method).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

MOST_TRIALS = 12
# A first step goes no further than by this factor: far from a trial the power law is a guess.
LONGEST_STEP = 30.0
# Exponents of the power law that two trials on one side may suggest.
LEAST_POWER, GREATEST_POWER = 0.3, 4.0
# Relative difference below which two sizes are one: they are told with four digits.
SAME = 1e-3


@dataclass(frozen=True)
class SizeTrial:
    """One size, and how much it shows as a multiple of what is wanted; both as logarithms."""

    size: float
    shown: float


class SizeSearch:
    """Proposes sizes one after the other, each from how much the ones before showed.

    Args:
        start: Size to begin with.
        small, large: The sizes that show least and most; where a smaller size shows more, `small` is the larger.
    """

    def __init__(self, start: float, small: float, large: float) -> None:
        self._ends = np.log(small), np.log(large)
        self._below: SizeTrial | None = None
        self._above: SizeTrial | None = None
        self._last: SizeTrial | None = None
        self._power = -1.0 if large < small else 1.0
        self.size = start

    def tell(self, shown: float) -> bool:
        """Takes in what the present size shows, in multiples of what is wanted, and moves on to the next size.

        Returns:
            Whether there is one: not where even the bound shows too little or too much, nor between equal sizes.
        """
        with np.errstate(divide="ignore"):
            trial = SizeTrial(float(np.log(self.size)), float(np.log(shown)))
        end = self._ends[shown < 1.0]
        if np.isclose(trial.size, end, rtol=0.0, atol=SAME):
            return False
        if shown < 1.0:
            self._below, self._above = trial, self._eased(self._above, self._last is self._below)
        else:
            self._above, self._below = trial, self._eased(self._below, self._last is self._above)
        guess = self._guess(trial)
        self._last = trial
        self.size = float(np.exp(guess))
        return abs(guess - trial.size) > SAME

    @staticmethod
    def _eased(other: SizeTrial | None, again: bool) -> SizeTrial | None:
        """The trial on the far side; told as half as far off where the near side moved twice running."""
        return SizeTrial(other.size, 0.5 * other.shown) if other is not None and again else other

    def _guess(self, trial: SizeTrial) -> float:
        low, high = self._below, self._above
        if low is not None and high is not None:
            if np.isfinite(low.shown) and np.isfinite(high.shown):
                share = low.shown / (low.shown - high.shown)
                return low.size + share * (high.size - low.size)
            return 0.5 * (low.size + high.size)
        return float(np.clip(trial.size + self._step(trial), min(self._ends), max(self._ends)))

    def _step(self, trial: SizeTrial) -> float:
        """Step of a search that has seen one side only, along the power law of the last two trials."""
        power, last = self._power, self._last
        if last is not None and np.isfinite(last.shown) and np.isfinite(trial.shown):
            slope = (trial.shown - last.shown) / (trial.size - last.size)
            power = np.sign(power) * np.clip(abs(slope), LEAST_POWER, GREATEST_POWER)
        longest = np.log(LONGEST_STEP)
        return float(np.clip(-trial.shown, -longest, longest) / power)


def find_size(
    shown: Callable[[float], float], wanted: float, search: SizeSearch, tolerance: float
) -> tuple[float, float]:
    """Tries sizes until one shows what is wanted.

    Args:
        shown: How much a size shows; called with sizes of four digits, as they are told.
        wanted: How much is wanted.
        search: Where to begin, and within which bounds.
        tolerance: Relative error of what is shown at which to stop.

    Returns:
        The best size that was tried, and what it shows.
    """
    best, off = (np.nan, np.nan), np.inf
    for _ in range(MOST_TRIALS):
        search.size = float(f"{search.size:.4g}")  # the last digits depend on the machine's linear algebra
        seen = shown(search.size)
        with np.errstate(divide="ignore"):
            error = abs(float(np.log(seen / wanted)))
        if error <= off:
            best, off = (search.size, seen), error
        if off < tolerance or not search.tell(seen / wanted):
            break
    return best
