"""Fits how wide intervals have to be: a factor on what the recordings leave open, and what an arm's
law is off by.

An estimate's error has the variance (f s)² + (d_e |θ|)², s the standard deviation that its interval
states, θ its size, f one factor and d_e a share of each effect: no arm obeys a law of the catalogue
to the letter. Both are of greatest likelihood under Student's t of four degrees of freedom, which a
few far-off estimates don't decide; d_e is drawn towards the share of all effects.

Source: Lange, Little and Taylor 1989 (t likelihood).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import gammaln

from ident.arrays import Array, Float
from ident.effects.intervals import NORMAL_95
from ident.inference import calibration
from ident.inference.calibration import FREEDOM, PLACES

# Standard deviation of an effect's log share about that of all, and of that about a twentieth.
BETWEEN_EFFECTS, COMMON = 1.0, 2.0
FIRST_SHARE = 0.05
FEWEST = 20


@dataclass(frozen=True)
class Miss:
    """One parameter whose truth is known."""

    effect: str
    parameter: str
    error: float
    half_width: float  # of the interval as the recordings alone have it
    size: float
    unit: str  # arm or world


@dataclass(frozen=True, eq=False)
class Widths:
    """The fitted numbers."""

    factor: float  # on the standard deviation of what the recordings leave open
    shares: Mapping[str, float]  # by effect, what an arm's law is off by
    common: float  # of effects without a share of their own
    coverage: float  # share of intervals that hold the truth, units left out
    count: int

    def half_width(self, miss: Miss) -> float:
        """Half the width of a 95 % interval."""
        fitted = calibration.Widths(self.factor, self.common, self.shares)
        return fitted.half_width(miss.effect, miss.parameter, miss.half_width, miss.size)


def fit_widths(misses: Sequence[Miss]) -> Widths | None:
    """The numbers of greatest likelihood, judged on units left out; None of too few parameters."""
    if len(misses) < FEWEST:
        return None
    inside = []
    for unit in sorted({miss.unit for miss in misses}):
        others = _fit([miss for miss in misses if miss.unit != unit])
        own = [miss for miss in misses if miss.unit == unit]
        inside += [miss.error <= others.half_width(miss) for miss in own]
    whole = _fit(misses)
    return Widths(whole.factor, whole.shares, whole.common, float(np.mean(inside)), len(misses))


def _fit(misses: Sequence[Miss]) -> Widths:
    effects = sorted({miss.effect for miss in misses})
    number = {effect: k for k, effect in enumerate(effects)}
    error = np.array([miss.error for miss in misses])
    deviation = np.array([max(miss.half_width, 1e-12) / NORMAL_95 for miss in misses])
    size = np.array([0.0 if miss.parameter in PLACES else miss.size for miss in misses])
    of_effect = np.array([number[miss.effect] for miss in misses])

    def minus_log(values: Float[Array, " k"]) -> float:
        log_factor, log_common, apart = values[0], values[1], values[2:]
        shares = np.exp(log_common + apart)[of_effect]
        scale = np.sqrt((np.exp(log_factor) * deviation) ** 2 + (shares * size) ** 2) + 1e-15
        density = -np.log(scale) - 0.5 * (FREEDOM + 1.0) * np.log1p((error / scale) ** 2 / FREEDOM)
        density += gammaln(0.5 * (FREEDOM + 1.0)) - gammaln(0.5 * FREEDOM)
        prior = np.sum((apart / BETWEEN_EFFECTS) ** 2)
        prior += ((log_common - np.log(FIRST_SHARE)) / COMMON) ** 2 + (log_factor / COMMON) ** 2
        return float(-density.sum() + 0.5 * prior)

    best = minimize(minus_log, np.append([0.0, np.log(FIRST_SHARE)], np.zeros(len(effects))))
    shares = {effect: float(np.exp(best.x[1] + best.x[2 + k])) for effect, k in number.items()}
    return Widths(float(np.exp(best.x[0])), shares, float(np.exp(best.x[1])), 1.0, len(misses))
