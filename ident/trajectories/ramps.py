"""How a plan that starts with an acceleration is executed from rest: the same path, passed along it a little later.

A drive can't have an acceleration at once. With s(t) the time along the plan and u = s²/2, an arm that the plan begins
with a steady acceleration a has q̈ = a u''(t). So u'' rises from 0 to 1 within the ramp by a smooth step, and then lies
a little above 1, in the shape of a bump, until the pace s' has come to 1. A rate that reached 1 within the ramp itself
would ask for up to a quarter more than the plan's own acceleration, which a motion at its torque limit hasn't got; the
bump is two per cent at most. The end is the beginning's mirror image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float

# Longest ramp, as a share of the plan's duration.
RAMP_SHARE = 0.2
# Length of the bump, as a share of the plan's duration less the ramp: both bumps are over before the middle.
BUMP_SHARE = 0.9
# Integral and double integral over 0 to 1 of the bump 16 y² (1 - y)².
ONCE, TWICE = 16.0 / 30.0, 16.0 / 60.0


@dataclass(frozen=True)
class GentleEnds:
    """The time law of an executed plan.

    Attributes:
        total: Duration of the plan [s].
        ramp: Time in which acceleration gets going, a fifth of the duration at most; 0 for none [s].
    """

    total: float
    ramp: float

    @property
    def duration(self) -> float:
        """Duration of the execution [s]."""
        return self.total + 2.0 * self._lag

    @cached_property
    def _bump(self) -> tuple[float, float]:
        """Length of the bump [s], and its height."""
        length = 0.5 * BUMP_SHARE * self.total - 0.5 * self.ramp
        # Where the bump ends pace is one, so u'² = 2 u: a quadratic equation for its height.
        first, once = 0.5 * self.ramp + length, ONCE * length
        whole, twice = 0.15 * self.ramp**2 + 0.5 * self.ramp * length + 0.5 * length**2, TWICE * length**2
        a, half, c = once**2, first * once - twice, first**2 - 2.0 * whole
        return length, float((-half + np.sqrt(half**2 - a * c)) / a)

    @cached_property
    def _lag(self) -> float:
        """Time lost at each end [s]."""
        if self.ramp <= 0.0:
            return 0.0
        length, height = self._bump
        return 0.5 * self.ramp - ONCE * height * length

    def at(self, times: Float[Array, " T"]) -> tuple[Array, Array, Array]:
        """Time along the plan [s], its rate, and the rate of that [1/s], at times of the execution."""
        if self.ramp <= 0.0:
            return np.minimum(times, self.total), np.ones_like(times), np.zeros_like(times)
        late = times > self.duration / 2
        s, rate, change = self._begun(np.maximum(np.where(late, self.duration - times, times), 0.0))
        return np.where(late, self.total - s, s), rate, np.where(late, -change, change)

    def _begun(self, t: Float[Array, " T"]) -> tuple[Array, Array, Array]:
        """The first half."""
        ramp, (length, height) = self.ramp, self._bump
        x = np.minimum(t / ramp, 1.0)
        root = np.sqrt(0.5 - 0.2 * x)
        s, rate = ramp * x**2 * root, (x - 0.5 * x**2) / root
        # (u'' - s'²) / s, with x² taken out of both.
        change = ((3.0 - 2.0 * x) - (1.0 - 0.5 * x) ** 2 / root**2) / (ramp * root)
        y = np.clip((t - ramp) / length, 0.0, 1.0)
        once = 16.0 * y**3 * (1.0 / 3.0 - y / 2.0 + y**2 / 5.0)
        twice = 16.0 * y**4 * (1.0 / 12.0 - y / 10.0 + y**2 / 30.0)
        since = y * length
        u = 0.15 * ramp**2 + 0.5 * ramp * since + 0.5 * since**2 + height * length**2 * twice
        slope = 0.5 * ramp + since + height * length * once
        push = 1.0 + 16.0 * height * y**2 * (1.0 - y) ** 2
        later = np.sqrt(2.0 * u)
        pace = slope / later
        over = t - ramp - length
        begun, steady = t < ramp, over > 0.0
        s = np.where(begun, s, later + np.maximum(over, 0.0))
        rate = np.where(begun, rate, np.where(steady, 1.0, pace))
        change = np.where(begun, change, np.where(steady, 0.0, (push - pace**2) / later))
        return s, rate, change
