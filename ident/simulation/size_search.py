"""The size of an effect that shows as much as is wanted, by regula falsi on logarithmic scales.

Most causes show in proportion to a power of their size, a straight line there, so that two or three
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
LEAST_POWER = 0.3
GREATEST_POWER = 4.0
# Relative difference below which two sizes are one: they are reported with four digits.
SAME = 1e-3

Trial = tuple[float, float]
"""Logarithms of a size, and of how much it shows as a multiple of what is wanted."""


class _Bracket:
    """The nearest trials on both sides of what is wanted."""

    def __init__(self, ends: tuple[float, float]) -> None:
        self.ends = ends
        self.below: Trial | None = None
        self.above: Trial | None = None
        self.last: Trial | None = None

    def next_guess(self, trial: Trial, shows_too_little: bool) -> float:
        """Takes a trial; logarithm of the size to be tried next."""
        # The far side counts as half as far off where the near side moved twice running.
        if shows_too_little:
            if self.above and self.last is self.below:
                self.above = _halved(self.above)
            self.below = trial
        else:
            if self.below and self.last is self.above:
                self.below = _halved(self.below)
            self.above = trial
        if self.below and self.above:
            guess = _between(self.below, self.above)
        else:
            guess = self._beyond(trial)
        self.last = trial
        return guess

    def _beyond(self, trial: Trial) -> float:
        """A step along the power law of the last two trials, where one side only is known."""
        power = 1.0
        if self.last and np.isfinite(self.last[1]) and np.isfinite(trial[1]):
            rise = trial[1] - self.last[1]
            slope = rise / (trial[0] - self.last[0])
            power = float(np.clip(abs(slope), LEAST_POWER, GREATEST_POWER))
        low, high = self.ends
        if low > high:
            power = -power
        longest = np.log(LONGEST_STEP)
        step = float(np.clip(-trial[1], -longest, longest) / power)
        return float(np.clip(trial[0] + step, *sorted(np.log(self.ends))))


def _halved(trial: Trial) -> Trial:
    """The same, half as far off."""
    return trial[0], 0.5 * trial[1]


def _between(below: Trial, above: Trial) -> float:
    """Where a straight line between two trials shows what is wanted."""
    share = 0.5
    if np.isfinite(below[1]) and np.isfinite(above[1]):
        share = below[1] / (below[1] - above[1])
    return below[0] + share * (above[0] - below[0])


def find_size(
    shown: Callable[[float], float],
    wanted: float,
    start: float,
    ends: tuple[float, float],
    tolerance: float,
) -> tuple[float, float]:
    """Tries sizes until one shows what is wanted, or a bound shows too little or too much.

    Args:
        shown: How much a size shows; called with sizes of four digits, as they are reported.
        wanted: How much is wanted.
        start: Size to begin with.
        ends: The sizes that show least and most; the first is the larger where a smaller size shows
            more.
        tolerance: Relative error of what is shown at which to stop.

    Returns:
        The best size that was tried, and what it shows.
    """
    best = (np.nan, np.nan)
    error = np.inf
    size = start
    bracket = _Bracket(ends)
    for _ in range(MOST_TRIALS):
        size = float(f"{size:.4g}")  # the last digits depend on the machine's linear algebra
        seen = shown(size)
        with np.errstate(divide="ignore"):
            trial = (float(np.log(size)), float(np.log(seen / wanted)))
        if abs(trial[1]) <= error:
            best = (size, seen)
            error = abs(trial[1])
        too_little = bool(seen / wanted < 1.0)
        end = np.log(ends[too_little])
        if error < tolerance or np.isclose(trial[0], end, rtol=0.0, atol=SAME):
            break
        guess = bracket.next_guess(trial, too_little)
        if abs(guess - trial[0]) <= SAME:
            break
        size = float(np.exp(guess))
    return best
