"""Shares, means, areas and calibration, each with its 95 % interval.

Source: Wilson 1927 (shares); Hanley and McNeil 1982 (area under the curve).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int

Z = 1.959964
RESAMPLES = 2000
BINS = 10


@dataclass(frozen=True)
class Score:
    """A share or mean with its 95 % interval and the number of cases behind it.

    None if no case speaks of it.
    """

    value: float | None = None
    low: float | None = None
    high: float | None = None
    count: int = 0


def share(hits: Iterable[bool]) -> Score:
    """Share of hits with Wilson's 95 % interval; empty without cases."""
    outcomes = [bool(hit) for hit in hits]
    n = len(outcomes)
    if n == 0:
        return Score()
    p = sum(outcomes) / n
    shrink = 1 + Z**2 / n
    centre = (p + Z**2 / (2 * n)) / shrink
    reach = Z / shrink * float(np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)))
    return Score(p, max(centre - reach, 0.0), min(centre + reach, 1.0), n)


def mean(values: Sequence[float]) -> Score:
    """Mean with the 95 % percentile interval of a bootstrap over cases; empty without cases."""
    count = len(values)
    if count == 0:
        return Score()
    cases = np.asarray(values, dtype=float)
    drawn = np.random.default_rng(0).integers(count, size=(RESAMPLES, count))
    means = cases[drawn].mean(axis=1)
    return Score(float(cases.mean()), *_ends(means), count)


def _ends(draws: Sequence[float] | np.ndarray) -> tuple[float, float]:
    """Percentile interval of a bootstrap."""
    return float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975))


def auroc(positive: Sequence[float], negative: Sequence[float]) -> Score:
    """Probability that a positive case scores above a negative one, ties counting half."""
    n = len(positive)
    m = len(negative)
    if not n or not m:
        return Score()
    scores = np.asarray(positive, dtype=float)
    other_scores = np.asarray(negative, dtype=float)
    difference = np.subtract.outer(scores, other_scores)
    area = float(np.mean((difference > 0.0) + 0.5 * (difference == 0.0)))
    # Probability that two positive cases score above a negative one, and one above two.
    two_positive = area / (2.0 - area)
    two_negative = 2.0 * area**2 / (1.0 + area)
    between_positive = (n - 1) * (two_positive - area**2)
    between_negative = (m - 1) * (two_negative - area**2)
    variance = area * (1.0 - area) + between_positive + between_negative
    reach = Z * float(np.sqrt(max(variance, 0.0) / (n * m)))
    return Score(area, max(area - reach, 0.0), min(area + reach, 1.0), n + m)


def calibration_curve(
    said: Sequence[float], right: Sequence[bool], bins: int = BINS
) -> list[tuple[float, float, float, Score]]:
    """How often names of about one probability are right, in bins of equal width.

    Args:
        said: Probability of each name, 0 to 1.
        right: Whether it was.
        bins: How many.

    Returns:
        For each bin that holds any: its bounds, the mean of what was said, and the share right.
    """
    p = np.asarray(said, dtype=float)
    hit = np.asarray(right, dtype=bool)
    bin_of_name = _bin_of(p, bins)
    curve = []
    for k in map(int, np.unique(bin_of_name)):
        inside = bin_of_name == k
        curve.append((k / bins, (k + 1) / bins, float(p[inside].mean()), share(hit[inside])))
    return curve


def _bin_of(p: Float[Array, " k"], bins: int) -> Int[Array, " k"]:
    """Number of the bin of equal width that each probability falls into."""
    return np.minimum((p * bins).astype(int), bins - 1)


def calibration_error(said: Sequence[float], right: Sequence[bool]) -> Score:
    """Expected calibration error.

    Mean distance of probability and share right, weighted by the number of names.
    """
    n = len(said)
    if n == 0:
        return Score()
    p = np.asarray(said, dtype=float)
    bin_of_name = _bin_of(p, BINS)
    over = p - np.asarray(right, dtype=bool)

    def error(names: Int[Array, " n"]) -> float:
        """That of some names, each as often as it is drawn."""
        distances = np.abs(np.bincount(bin_of_name[names], over[names]))
        return float(distances.sum() / n)

    draws = np.random.default_rng(0).integers(n, size=(RESAMPLES // 10, n))
    resampled = [error(names) for names in draws]
    return Score(error(np.arange(n)), *_ends(resampled), n)


def is_inside(parameter: str, true: float, low: float, high: float) -> bool:
    """Whether an interval holds a true parameter; a phase is one whatever turns are added to it."""
    if parameter == "phase_rad":
        away = np.angle(np.exp(1j * (true - 0.5 * (low + high))))
        return bool(abs(away) <= 0.5 * (high - low) + 1e-9)
    slack = 1e-6 * abs(true)
    return low - slack <= true <= high + slack
