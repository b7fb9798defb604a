"""Profile likelihood of a chosen effect over its fine grid, for intervals of its nonlinear
parameters.

A law's torque is nonlinear in some parameters: the speed of a Stribeck curve, the order of a wave.
Each point of their grid has linear coefficients of its own, so intervals at the best point alone
are too narrow. With Δ the fall of the log likelihood from the best point to another, θ the
parameter there and s its standard deviation, the profile of the parameter reaches to

    θ ± s √(2 (drop − Δ)),    drop = ½ χ²₁(95 %) = 1.92,

and the interval is the union over all points with Δ < drop.

Source: Pawitan 2001 (profile likelihood).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from ident.arrays import Float
from ident.effects.base import Interval, SessionContext
from ident.regression.design import Group

# Fall of the log likelihood at the ends of a 95 % interval: half of χ²₁ [nats].
DROP = 1.92
TURN = 2.0 * np.pi
# Which ends of an interval are open, by whether the profile is within the drop at either end.
OPEN_ENDS: dict[tuple[bool, bool], Literal["", "low", "high", "both"]] = {
    (False, False): "",
    (True, False): "low",
    (False, True): "high",
    (True, True): "both",
}


@dataclass(frozen=True, eq=False)
class Profile:
    """Log likelihood and coefficients of an accepted effect at all points of its fine grid."""

    group: Group  # the point whose parameters are reported
    points: tuple[Group, ...]  # all points of the grid, that one among them
    log_likelihood: Float[np.ndarray, " m"]  # of each [nats]
    # Of each, in the columns' own units.
    coefficients: tuple[Float[np.ndarray, " k"], ...]
    covariance: tuple[Float[np.ndarray, "k k"], ...]
    drop: float = DROP  # fall at the ends of a 95 % interval [nats]

    def inner_parameters(self) -> dict[str, Interval]:
        """Intervals of the grid's own parameters, of zero width for a parameter that has one value
        on the grid.

        Returns:
            By name, in the parameters' own units; empty where the effect has no grid.
        """
        intervals = {}
        for name, value in self.group.variant.inner.items():
            values = np.array([mate.variant.inner[name] for mate in self.points])
            on_grid = np.unique(values)
            if len(on_grid) < 2 or np.any(on_grid <= 0):
                intervals[name] = Interval(float(value), float(value), float(value))
            elif name in self.group.effect.doubt.exact:
                intervals[name] = self._exact(float(value), values, on_grid)
            else:
                by_point = [self.log_likelihood[values == point].max() for point in on_grid]
                falls = np.array(by_point)
                intervals[name] = profile_interval(np.log(on_grid), falls, self.drop)
        return intervals

    def _exact(
        self,
        value: float,
        values: Float[np.ndarray, " m"],
        on_grid: Float[np.ndarray, " k"],
    ) -> Interval:
        """Interval of a parameter that has one of the grid's values, or lies between two.

        Args:
            value: That of the best point.
            values: Of all points.
            on_grid: Each of these once, increasing.
        """
        falls = self.log_likelihood.max() - self.log_likelihood
        likely = values[falls < self.drop]
        # A whole number lies at one of them; a line of a spectrum anywhere up to the next.
        is_whole = np.array_equal(on_grid, np.round(on_grid))
        reach = 0.0 if is_whole else 0.5 * float(np.diff(on_grid).min())
        low = min(value, *likely) - reach
        high = max(value, *likely) + reach
        return Interval(value, float(low), float(high))

    def parameters(self, session: SessionContext) -> dict[str, Interval]:
        """Parameters of the best point, with intervals that hold those of all points within the
        drop.
        """
        best = self.points.index(self.group)
        reported = self._at(best, session)
        falls = np.maximum(self.log_likelihood[best] - self.log_likelihood, 0.0)
        within = falls < self.drop
        within[best] = False
        for k in np.flatnonzero(within):
            others = self._at(int(k), session)
            narrowing = float(np.sqrt(1.0 - falls[k] / self.drop))
            for name, interval in reported.items():
                reported[name] = unite(interval, others[name], narrowing, name)
        return reported | self.inner_parameters()

    def _at(self, point: int, session: SessionContext) -> dict[str, Interval]:
        """Parameters of one point of the grid."""
        group = self.points[point]
        return group.effect.parameters(
            session,
            group.joint,
            group.variant,
            self.coefficients[point],
            self.covariance[point],
        )


def unite(interval: Interval, other: Interval, narrowing: float, name: str) -> Interval:
    """An interval widened to hold another one that is shrunk about its value first.

    Args:
        interval, other: The interval, and what it is to hold.
        narrowing: Factor of the other's width, from 0 to 1.
        name: The parameter's; values of `phase_rad` are compared modulo 2π.
    """
    shift = 0.0
    if name == "phase_rad":
        turns = np.round((interval.value - other.value) / TURN)
        shift = TURN * turns
    middle = other.value + shift
    low = middle - narrowing * (other.value - other.low)
    high = middle + narrowing * (other.high - other.value)
    return replace(
        interval,
        low=float(min(interval.low, low)),
        high=float(max(interval.high, high)),
    )


def profile_interval(
    x: Float[np.ndarray, " k"], falls: Float[np.ndarray, " k"], drop: float
) -> Interval:
    """Maximum and 95 % interval of a profile over a parameter's logarithm: a parabola through the
    top points.

    Where the profile does not fall by the drop within the grid, the interval is open: it ends half
    a step beyond the grid.

    Args:
        x: Logarithms of the parameter's values on the grid, increasing.
        falls: Log likelihood at each [nats].
        drop: How far below its maximum the log likelihood is at the interval's ends [nats].

    Returns:
        Of the parameter itself; `open` tells which ends are.
    """
    top = int(np.argmax(falls))
    best = x[top]
    peak = falls[top]
    step = float(np.min(np.diff(x)))
    low = best
    high = best
    margin = step / 2
    if 0 < top < len(x) - 1:
        near = slice(top - 1, top + 2)
        from_top = x[near] - x[top]
        a, b, c = np.polyfit(from_top, falls[near], 2)
        if a < 0:
            best = x[top] - b / (2 * a)
            peak = c - b**2 / (4 * a)
            reach = float(np.sqrt(drop / -a))
            low = best - reach
            high = best + reach
            margin = 0.0
    inside = falls > peak - drop
    low = min(low, x[inside].min(initial=best) - margin)
    high = max(high, x[inside].max(initial=best) + margin)
    low = max(low, x[0] - step / 2)
    high = min(high, x[-1] + step / 2)
    is_open = (bool(inside[0]), bool(inside[-1]))
    return Interval(
        float(np.exp(best)),
        float(np.exp(low)),
        float(np.exp(high)),
        OPEN_ENDS[is_open],
    )
