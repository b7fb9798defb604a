"""Scores with intervals: shares after Wilson, means by bootstrap, and how well probabilities are meant."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

Z = 1.959964
RESAMPLES = 2000
BINS = 10


@dataclass(frozen=True)
class Score:
    """A share or mean with its 95 % interval and the number of cases behind it; None if no case speaks of it."""

    value: float | None = None
    low: float | None = None
    high: float | None = None
    count: int = 0


def share(hits: Iterable[bool]) -> Score:
    """Share of hits with Wilson's interval.

    Source: Wilson 1927.
    """
    found = [bool(one) for one in hits]
    n = len(found)
    if n == 0:
        return Score()
    p = sum(found) / n
    centre = (p + Z**2 / (2 * n)) / (1 + Z**2 / n)
    reach = Z / (1 + Z**2 / n) * float(np.sqrt(p * (1 - p) / n + Z**2 / (4 * n**2)))
    return Score(p, max(centre - reach, 0.0), min(centre + reach, 1.0), n)


def mean(values: Sequence[float]) -> Score:
    """Mean with the percentile interval of a bootstrap over cases."""
    if len(values) == 0:
        return Score()
    x = np.asarray(values, dtype=float)
    draws = x[np.random.default_rng(0).integers(len(x), size=(RESAMPLES, len(x)))].mean(axis=1)
    return Score(float(x.mean()), float(np.quantile(draws, 0.025)), float(np.quantile(draws, 0.975)), len(x))


def auroc(positive: Sequence[float], negative: Sequence[float]) -> Score:
    """Probability that a positive case scores above a negative one, ties counting half; interval by Hanley and McNeil.

    Source: Hanley and McNeil 1982.
    """
    n, m = len(positive), len(negative)
    if not n or not m:
        return Score()
    difference = np.subtract.outer(np.asarray(positive, dtype=float), np.asarray(negative, dtype=float))
    area = float(np.mean((difference > 0.0) + 0.5 * (difference == 0.0)))
    q1, q2 = area / (2.0 - area), 2.0 * area**2 / (1.0 + area)
    variance = area * (1.0 - area) + (n - 1) * (q1 - area**2) + (m - 1) * (q2 - area**2)
    reach = Z * float(np.sqrt(max(variance, 0.0) / (n * m)))
    return Score(area, max(area - reach, 0.0), min(area + reach, 1.0), n + m)


@dataclass(frozen=True)
class Bin:
    """Names whose probability lies in one bin: the mean of their probabilities, and how often they are right."""

    low: float
    high: float
    said: float
    right: Score


def calibration_curve(said: Sequence[float], right: Sequence[bool], bins: int = BINS) -> tuple[Bin, ...]:
    """Bins of equal width that hold anything."""
    p, hit = np.asarray(said, dtype=float), np.asarray(right, dtype=bool)
    which = np.minimum((p * bins).astype(int), bins - 1)
    return tuple(
        Bin(k / bins, (k + 1) / bins, float(p[which == k].mean()), share(hit[which == k]))
        for k in map(int, np.unique(which))
    )


def calibration_error(said: Sequence[float], right: Sequence[bool]) -> Score:
    """Expected calibration error: mean distance of probability and share right, weighted by the number of names."""
    if len(said) == 0:
        return Score()
    p, hit = np.asarray(said, dtype=float), np.asarray(right, dtype=bool)

    def distance(p: np.ndarray, hit: np.ndarray) -> float:
        which = np.minimum((p * BINS).astype(int), BINS - 1)
        return sum(abs(float(p[which == k].sum() - hit[which == k].sum())) for k in np.unique(which)) / len(p)

    draws = np.random.default_rng(0).integers(len(p), size=(RESAMPLES // 10, len(p)))
    errors = [distance(p[rows], hit[rows]) for rows in draws]
    return Score(distance(p, hit), float(np.quantile(errors, 0.025)), float(np.quantile(errors, 0.975)), len(p))
