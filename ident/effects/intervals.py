"""Intervals of what is reported, from the coefficients of an effect's columns and their covariance.

How large an effect's coefficients are beforehand, and what they cost for it: an Occam factor.

What a name of the inertias' kind explains, a URDF that is a little wrong explains nearly as well;
so it matters whether its parameters are usual. A last link of twice its own weight is hardly an
error of the URDF: it is a link that carries something. With p the density of the coefficients
beforehand, ĉ their estimate and J what recordings tell about the k of them, beside an expected
deviation s of each,

    log p(y | name) − log p(y) ≈ ½ gain − cost,
    cost = ½ (ĉ − c)ᵀ J (ĉ − c) + ½ log|J + s⁻²| − ½ k log 2π − log p(c),    c = (J + s⁻²)⁻¹ J ĉ:

directions of which the recordings say nothing are where they are expected.

Source: MacKay 1992 (Laplace's approximation of the evidence).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import gammaln

from ident.arrays import Array, Float
from ident.effects.interval import Interval

# Draws behind an interval: its ends are then sure to a twentieth of its width.
INTERVAL_DRAWS = 400
# Deviations from the mean at the ends of a 95 % interval.
NORMAL_95 = 1.96
# Arms that are several times as far off as usual are rare, but there are some.
FREEDOM = 10


def grid_interval(value: float, grid: Sequence[float]) -> Interval:
    """A point of a grid with what the grid can resolve: half-way (by ratio) to its neighbours."""
    points = np.unique(np.asarray([*grid, value], dtype=float))
    place = int(np.searchsorted(points, value))
    if len(points) == 1:
        return Interval(value, value / 2.0, value * 2.0)
    is_first = place == 0
    is_last = place + 1 == len(points)
    # Beyond an end of the grid, as far as its other neighbour is, by ratio.
    below = value**2 / points[place + 1] if is_first else points[place - 1]
    above = value**2 / points[place - 1] if is_last else points[place + 1]
    low = float(np.sqrt(value * below))
    high = float(np.sqrt(value * above))
    return Interval(value, low, high)


def exactly(value: float) -> Interval:
    """A parameter that was not estimated."""
    return Interval(value, value, value)


def _about(value: float, variance: float) -> Interval:
    """95 % of a normal estimate."""
    reach = NORMAL_95 * float(np.sqrt(max(variance, 0.0)))
    return Interval(value, value - reach, value + reach)


def coefficient_interval(
    index: int,
    coefficients: Float[Array, " k"],
    covariance: Float[Array, "k k"],
    scale: float = 1.0,
) -> Interval:
    """Interval of one coefficient times a known factor."""
    estimate = scale * float(coefficients[index])
    return _about(estimate, scale**2 * covariance[index, index])


def amplitude_interval(
    coefficients: Float[Array, " k"], covariance: Float[Array, "k k"]
) -> Interval:
    """Interval of the length of a vector, such as (cos, sin) coefficients; it can't be negative."""
    size = float(np.linalg.norm(coefficients))
    along = np.full(len(coefficients), len(coefficients) ** -0.5)
    if size > 0.0:
        along = coefficients / size
    interval = _about(size, along @ covariance @ along)
    return replace(interval, low=max(0.0, interval.low))


def wave_parameters(
    order: float, coefficients: Float[Array, " 2"], covariance: Float[Array, "2 2"]
) -> dict[str, Interval]:
    """What is reported of a wave of torque A cos(order q - phase).

    Args:
        order: Waves a turn.
        coefficients: Of cos and sin [N m].
        covariance: Of these.

    Returns:
        `amplitude_Nm`, `order` and `phase_rad`, with 95 % intervals.
    """
    return {
        "amplitude_Nm": amplitude_interval(coefficients, covariance),
        "order": exactly(order),
        "phase_rad": phase_interval(coefficients, covariance),
    }


def phase_interval(coefficients: Float[Array, " 2"], covariance: Float[Array, "2 2"]) -> Interval:
    """Interval of φ in A cos(x − φ) from (cos, sin) coefficients [rad]."""
    size = float(np.hypot(*coefficients))
    phase = float(np.arctan2(coefficients[1], coefficients[0]))
    across = np.array([-np.sin(phase), np.cos(phase)])
    spread = float(np.sqrt(max(across @ covariance @ across, 0.0)))
    reach = np.pi
    if size > 0.0:
        reach = min(np.pi, NORMAL_95 * spread / size)
    return Interval(phase, phase - reach, phase + reach)


def linear_interval(
    weights: Float[Array, " k"], coefficients: Float[Array, " k"], covariance: Float[Array, "k k"]
) -> Interval:
    """Interval of a linear combination of coefficients."""
    return _about(float(weights @ coefficients), weights @ covariance @ weights)


def drawn_interval(
    function: Callable[[Float[Array, " k"]], float],
    coefficients: Float[Array, " k"],
    covariance: Float[Array, "k k"],
) -> Interval:
    """95 % interval of any function of coefficients that are not negative, from draws of them.

    For what bends within the coefficients' spread, where the delta method tells anything.
    """
    value = function(coefficients)
    if not covariance.any():
        return exactly(value)
    values, vectors = np.linalg.eigh(0.5 * (covariance + covariance.T))
    # The same draws every time: a parameter is reported the same when it is reported again.
    normal = np.random.default_rng(0).standard_normal((INTERVAL_DRAWS, len(coefficients)))
    deviations = np.sqrt(np.maximum(values, 0.0))
    drawn = coefficients + (normal * deviations) @ vectors.T
    reported = np.array([function(draw) for draw in np.maximum(drawn, 0.0)])
    low, high = np.quantile(reported, (0.025, 0.975))
    return Interval(value, min(value, float(low)), max(value, float(high)))


def delta_interval(
    function: Callable[..., float],
    coefficients: Float[Array, " k"],
    covariance: Float[Array, "k k"],
) -> Interval:
    """Interval of a smooth function of coefficients by the delta method, derivatives by central
    differences.

    Args:
        function: Of the coefficients, to a number.
        coefficients: Its point.
        covariance: Of their errors; all zero gives an interval without width.

    Returns:
        The value at the point, and the ends of its 95 % interval.
    """
    value = float(function(coefficients))
    if not covariance.any():
        return exactly(value)
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    sizes = np.maximum(deviations, 1e-12) * 1e-4 / 1e-2
    slopes = []
    for step, size in zip(np.diag(sizes), sizes, strict=True):
        rise = function(coefficients + step) - function(coefficients - step)
        slopes.append(rise / (2 * size))
    gradient = np.array(slopes)
    return _about(value, gradient @ covariance @ gradient)


@dataclass(frozen=True, eq=False)
class SizePrior:
    """What is known of an effect's coefficients beforehand.

    Attributes:
        deviation: Expected size of each, of what the recordings say nothing about.
        log_density: Log density of all of them together; of several sets of them, shape (s, k),
            that of each.
        weighs: Whether the first is a mass above zero: then the density has no value at zero, and
            over what recordings leave of it has to be integrated.
    """

    deviation: Float[Array, " k"]
    log_density: Callable[[Float[Array, "... k"]], Float[np.ndarray, "..."]]
    weighs: bool = False

    @classmethod
    def about_zero(cls, deviation: Float[Array, " k"]) -> SizePrior:
        """Student's t of a few degrees of freedom about zero for each coefficient."""
        half = 0.5 * (FREEDOM + 1)
        ratio = gammaln(half) - gammaln(0.5 * FREEDOM)
        constant = ratio - 0.5 * np.log(FREEDOM * np.pi)

        def log_density(coefficients: Float[Array, "... k"]) -> Float[np.ndarray, "..."]:
            spread = half * np.log1p((coefficients / deviation) ** 2 / FREEDOM)
            return np.asarray(np.sum(constant - spread - np.log(deviation), axis=-1))

        return cls(deviation, log_density)

    def beyond_normal(self, coefficients: Float[Array, "... k"]) -> Float[np.ndarray, "..."]:
        """By how much coefficients are likelier than by a normal of its deviations [nats]."""
        normal = np.sum((coefficients / self.deviation) ** 2, axis=-1)
        constant = np.shape(coefficients)[-1] * np.log(2.0 * np.pi)
        normal = normal + 2.0 * np.sum(np.log(self.deviation)) + constant
        return np.asarray(self.log_density(coefficients) + 0.5 * normal)
