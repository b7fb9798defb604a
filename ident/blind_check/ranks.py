"""Ranks of simulation-based calibration: where the truth lies in the distribution that was told of it.

Of honest intervals the place of the true figure in the told distribution is uniform between 0 and 1. Where intervals
are too narrow the truth lies at the ends too often (a U), where they are too wide it lies in the middle (a hump), and
where figures are told too low or too high the histogram has a slope.

Figures have intervals where their name is true: of effects that noise could hide those are told which noise made
larger, so that a slope need not be the interval's fault.

Sources: Talts, Betancourt, Simpson, Vehtari and Gelman 2018 (ranks); Kuiper 1960 and Stephens 1970 (the test, which
sees a wrong width sooner than Kolmogorov's and Smirnov's); Meinshausen, Meier and Bühlmann 2009 (twice the median of
the p-values of draws that hang together).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr

from ident.arrays import Array
from ident.blind_check.statistics import Z, binomial_ends

BINS = 10
# Fewer figures of a kind have no histogram of their own, and fewer cases no test.
LEAST_FIGURES, LEAST_CASES = 12, 8
# p-value below which ranks are told to be uneven: some twenty kinds are looked at.
ODD = 0.01
# One figure of each case, so many times.
DRAWS = 99
TERMS = 100  # of the series of Kuiper's law
# Turns that a phase's distribution may go round the circle either way.
TURNS = np.arange(-3, 4)


def place_of_truth(true: float, value: float, low: float, high: float, circular: bool = False) -> float | None:
    """The told chance that the figure is below the true one; None where the interval has no width.

    The told law is normal, cut in two at the value: below and above it lies a half each, as wide as the interval there.

    Args:
        true: The true figure.
        value, low, high: As told, with the 95 % interval.
        circular: Whether the figure is an angle, whose law goes round the circle [rad].
    """
    widths = np.maximum([value - low, high - value], 0.0) / Z
    if not widths.any():
        return None
    if not circular:
        return float(_chance_below(np.array([true - value]), widths)[0])
    away = float(np.angle(np.exp(1j * (true - value))))
    whole = _chance_below(away + 2 * np.pi * TURNS, widths) - _chance_below(2 * np.pi * TURNS - np.pi, widths)
    return float(np.clip(whole.sum(), 0.0, 1.0))


def _chance_below(away: Array, widths: Array) -> Array:
    """Of distances from the value, the chance of less; a half without width is a step."""
    own = np.where(away < 0.0, widths[0], widths[1])
    step = np.where(away < 0.0, -np.inf, np.where(away > 0.0, np.inf, 0.0))
    return np.asarray(ndtr(np.divide(away, own, out=step, where=own > 0.0)))


@dataclass(frozen=True)
class RankHistogram:
    """Places of true figures in their told distributions.

    Attributes:
        cases: Cases that they are of.
        bins: Figures in each of ten bins of equal width.
        band: Least and most in a bin of uniform ones, 95 % of the time for each bin.
        p_value: That uniform ones are as uneven; None of few cases.
        lean: Their mean less a half, in its standard errors.
        spread: Their mean squared distance from a half less a twelfth, in its standard errors.
    """

    cases: int
    bins: tuple[int, ...]
    band: tuple[int, int]
    p_value: float | None
    lean: float
    spread: float

    @property
    def count(self) -> int:
        return sum(self.bins)

    @property
    def is_odd(self) -> bool:
        """Whether something speaks against the intervals."""
        return self.p_value is not None and self.p_value < ODD

    @property
    def words(self) -> str:
        """What the ranks say of the intervals."""
        if self.p_value is None:
            return "too few to say"
        if not self.is_odd:
            return "nothing speaks against the intervals"
        if max(abs(self.lean), abs(self.spread)) < Z:
            return "uneven, neither by width nor by a slope"
        if abs(self.spread) >= abs(self.lean):
            return "intervals too narrow" if self.spread > 0.0 else "intervals too wide"
        return "figures told too low" if self.lean > 0.0 else "figures told too high"

    def to_dict(self) -> dict[str, Any]:
        return {"count": self.count, **vars(self), "words": self.words}


def count_ranks(places: Sequence[float], cases: Sequence[str]) -> RankHistogram:
    """The histogram of places with its test.

    Args:
        places: Each from 0 to 1.
        cases: The case of each; the figures of one case hang together, and the test takes one of each case at a time.
    """
    u = np.asarray(places, dtype=float)
    n, owners = len(u), list(dict.fromkeys(cases))
    counts = np.bincount(np.minimum((u * BINS).astype(int), BINS - 1), minlength=BINS)
    rows = [np.flatnonzero([one == owner for one in cases]) for owner in owners]
    root = np.sqrt(max(n, 1))
    return RankHistogram(
        cases=len(owners),
        bins=tuple(map(int, counts)),
        band=binomial_ends(n, 1.0 / BINS),
        p_value=_p_value(u, rows) if len(owners) >= LEAST_CASES else None,
        lean=float(np.sum(u - 0.5) / n * root * np.sqrt(12.0)) if n else 0.0,
        spread=float(np.sum((u - 0.5) ** 2 - 1.0 / 12.0) / n * root * np.sqrt(180.0)) if n else 0.0,
    )


def _p_value(u: Array, rows: Sequence[Array]) -> float:
    """Of figures that hang together within rows."""
    if len(rows) == len(u):
        return kuiper_p_value(u)
    generator = np.random.default_rng(0)
    drawn = [[own[generator.integers(len(own))] for own in rows] for _ in range(DRAWS)]
    return min(1.0, 2.0 * float(np.median([kuiper_p_value(u[chosen]) for chosen in drawn])))


def kuiper_p_value(u: Array) -> float:
    """Chance that uniform numbers lie as far above and below their law, both taken together.

    Args:
        u: Numbers from 0 to 1, eight or more.
    """
    n, ordered = len(u), np.sort(u)
    above = float(np.max(np.arange(1, n + 1) / n - ordered))
    below = float(np.max(ordered - np.arange(n) / n))
    scaled = (np.sqrt(n) + 0.155 + 0.24 / np.sqrt(n)) * (above + below)
    if scaled < 0.4:  # the series alternates there, and its sum is one
        return 1.0
    squares = (np.arange(1, TERMS) * scaled) ** 2
    return float(np.clip(2.0 * np.sum((4.0 * squares - 1.0) * np.exp(-2.0 * squares)), 0.0, 1.0))
