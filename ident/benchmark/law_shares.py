"""Fits how wide intervals have to be: a factor on what the recordings leave open, and the share by
which arms differ from a law.

An estimate's error has the variance (f s)² + (d θ)² + (e r θ)², s the standard deviation that its
interval states, θ its size, r the torque that a smooth function still finds beside the law as a
share of the law's own, f a factor, d and e shares: no arm obeys a law of the catalogue to the
letter, and one that leaves much of its kind still less. They are of greatest likelihood under
Student's t of four degrees of freedom, which a few far-off estimates don't decide. A share for each
effect foretells the errors on arms left out no better.

Few estimates are off by far, and they are more than that law has. So intervals are stretched until
95 % hold on arms that f and d were not fitted to; how the stretched ones hold is told of arms that
neither fit nor stretch has seen.

Source: Lange, Little and Taylor 1989 (t likelihood); Barber, Candès, Ramdas and Tibshirani 2021
(intervals from what was left out).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize

from ident.arrays import Float
from ident.effects.intervals import NORMAL_95
from ident.inference import calibration
from ident.inference.calibration import FREEDOM, PLACES

# Where the shares begin, and the standard deviation of all numbers' logarithms.
FIRST_SHARE = 0.05
DEVIATION = 2.0
FEWEST = 20
HELD = 0.95  # of intervals by their name


@dataclass(frozen=True)
class Miss:
    """One parameter whose truth is known."""

    parameter: str
    error: float
    half_width: float  # of the interval as the recordings alone have it
    size: float
    unit: str  # arm or world
    left: float = 0.0  # torque that a smooth function still finds beside the law, as a share of it


@dataclass(frozen=True, eq=False)
class Widths:
    """The fitted numbers."""

    factor: float  # on the standard deviation of what the recordings leave open
    share: float  # what an arm's law is off by
    of_left: float  # the same, of what a smooth function still finds beside the law
    coverage: float  # share of intervals that hold the truth, units left out
    count: int

    def half_width(self, miss: Miss) -> float:
        """Half the width of a 95 % interval."""
        fitted = calibration.Widths(self.factor, self.share, self.of_left)
        return fitted.half_width(miss.parameter, miss.half_width, miss.size, miss.left)


def fit_widths(misses: Sequence[Miss]) -> Widths | None:
    """The stretched numbers, judged on units left out; None of too few parameters."""
    if len(misses) < FEWEST:
        return None
    inside = []
    for unit in units_of(misses):
        others = stretched([miss for miss in misses if miss.unit != unit])
        inside += [miss.error <= others.half_width(miss) for miss in misses if miss.unit == unit]
    return replace(stretched(misses), coverage=float(np.mean(inside)))


def units_of(misses: Sequence[Miss]) -> list[str]:
    """Arms and worlds that some parameters are of."""
    return sorted({miss.unit for miss in misses})


def stretched(misses: Sequence[Miss]) -> Widths:
    """The likeliest numbers, all times what makes 95 % hold on units left out."""
    ratios = []
    for unit in units_of(misses):
        others = likeliest([miss for miss in misses if miss.unit != unit])
        ratios += [miss.error / others.half_width(miss) for miss in misses if miss.unit == unit]
    rank = min(int(np.ceil(HELD * (len(ratios) + 1))), len(ratios)) - 1
    stretch = float(np.sort(ratios)[rank])
    whole = likeliest(misses)
    return replace(
        whole,
        factor=stretch * whole.factor,
        share=stretch * whole.share,
        of_left=stretch * whole.of_left,
    )


def likeliest(misses: Sequence[Miss]) -> Widths:
    """The numbers of greatest likelihood."""
    error = np.array([miss.error for miss in misses])
    deviation = np.array([max(miss.half_width, 1e-12) / NORMAL_95 for miss in misses])
    size = np.array([0.0 if miss.parameter in PLACES else miss.size for miss in misses])
    left = size * np.array([miss.left for miss in misses])
    # Where nobody looked what is left there is nothing to fit a share of it to.
    parts = np.array([deviation, size, left] if left.any() else [deviation, size])
    first = np.log([1.0, FIRST_SHARE, FIRST_SHARE][: len(parts)])

    def minus_log(logs: Float[np.ndarray, " k"]) -> float:
        scale = np.linalg.norm(np.exp(logs)[:, None] * parts, axis=0) + 1e-15
        far = np.log1p((error / scale) ** 2 / FREEDOM)
        density = -np.log(scale) - 0.5 * (FREEDOM + 1.0) * far
        prior = np.sum(((logs - first) / DEVIATION) ** 2)
        return float(-density.sum() + 0.5 * prior)

    numbers = np.exp(minimize(minus_log, first).x).tolist()
    factor, share, of_left = [*numbers, 0.0][:3]
    return Widths(factor, share, of_left, 1.0, len(misses))
