"""How a plan that starts with an acceleration is executed from rest.

The same path, passed along it a little later: a drive can't have an acceleration at once. With s(t)
the time along the plan and u = s²/2, an arm that the plan begins with a steady acceleration a has
q̈ = a u''(t). So u'' rises from 0 to 1 within the ramp by a smooth step, and then lies a little
above 1, in the shape of a bump, until the pace s' has come to 1. A rate that reached 1 within the
ramp itself would ask for up to a quarter more than the plan's own acceleration, which a motion at
its torque limit hasn't got; the bump is two per cent at most. The end is the beginning's mirror
image.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float

# Longest ramp, as a share of the plan's duration.
RAMP_SHARE = 0.2
# Length of the bump, as a share of the plan's duration less the ramp: both bumps are over before
# the middle.
BUMP_SHARE = 0.9
# Integral and double integral over 0 to 1 of the bump 16 y² (1 - y)².
ONCE = 16.0 / 30.0
TWICE = 16.0 / 60.0

Progress = tuple[Float[Array, " T"], Float[Array, " T"], Float[Array, " T"]]
"""Time along the plan [s], its rate, and the rate of that [1/s]."""


@dataclass(frozen=True)
class GentleEnds:
    """The time law of an executed plan."""

    total: float  # duration of the plan [s]
    # time in which acceleration gets going, a fifth of the duration at most; 0 for none [s]
    ramp: float

    @property
    def duration(self) -> float:
        """Duration of the execution [s]."""
        return self.total + 2.0 * self._lag

    @cached_property
    def _bump(self) -> tuple[float, float]:
        """Length of the bump [s], and its height."""
        ramp = self.ramp
        length = 0.5 * BUMP_SHARE * self.total - 0.5 * ramp
        # Where the bump ends pace is one, so u'² = 2 u: a quadratic equation for its height.
        first = 0.5 * ramp + length
        once = ONCE * length
        whole = 0.15 * ramp**2 + 0.5 * ramp * length + 0.5 * length**2
        twice = TWICE * length**2
        a = once**2
        half = first * once - twice
        c = first**2 - 2.0 * whole
        return length, float((-half + np.sqrt(half**2 - a * c)) / a)

    @cached_property
    def _lag(self) -> float:
        """Time lost at each end [s]."""
        if self.ramp <= 0.0:
            return 0.0
        length, height = self._bump
        return 0.5 * self.ramp - ONCE * height * length

    def at(self, times: Float[Array, " T"]) -> Progress:
        """How far the plan is at times of the execution [s]."""
        if self.ramp <= 0.0:
            return np.minimum(times, self.total), np.ones_like(times), np.zeros_like(times)
        late = times > self.duration / 2
        since_end = np.where(late, self.duration - times, times)
        s, rate, change = self._first_half(np.maximum(since_end, 0.0))
        return np.where(late, self.total - s, s), rate, np.where(late, -change, change)

    def _first_half(self, t: Float[Array, " T"]) -> Progress:
        """The same of the first half: ramp, bump, and the plan's own pace."""
        ramp = self.ramp
        length, _ = self._bump
        s_ramp, rate_ramp, change_ramp = self._on_ramp(t)
        s_bump, rate_bump, change_bump = self._on_bump(t)
        over = t - ramp - length
        on_ramp = t < ramp
        steady = over > 0.0
        s = np.where(on_ramp, s_ramp, s_bump + np.maximum(over, 0.0))
        rate = np.where(on_ramp, rate_ramp, np.where(steady, 1.0, rate_bump))
        change = np.where(on_ramp, change_ramp, np.where(steady, 0.0, change_bump))
        return s, rate, change

    def _on_ramp(self, t: Float[Array, " T"]) -> Progress:
        """Where u'' rises; held at its end afterwards."""
        ramp = self.ramp
        x = np.minimum(t / ramp, 1.0)
        root = np.sqrt(0.5 - 0.2 * x)
        s = ramp * x**2 * root
        rate = (x - 0.5 * x**2) / root
        # (u'' - s'²) / s, with x² taken out of both.
        change = ((3.0 - 2.0 * x) - (1.0 - 0.5 * x) ** 2 / root**2) / (ramp * root)
        return s, rate, change

    def _on_bump(self, t: Float[Array, " T"]) -> Progress:
        """Where u'' lies above one; held at its ends before and after."""
        ramp = self.ramp
        length, height = self._bump
        y = np.clip((t - ramp) / length, 0.0, 1.0)
        once = 16.0 * y**3 * (1.0 / 3.0 - y / 2.0 + y**2 / 5.0)
        twice = 16.0 * y**4 * (1.0 / 12.0 - y / 10.0 + y**2 / 30.0)
        since = y * length
        plain = 0.15 * ramp**2 + 0.5 * ramp * since + 0.5 * since**2
        u = plain + height * length**2 * twice
        slope = 0.5 * ramp + since + height * length * once
        push = 1.0 + 16.0 * height * y**2 * (1.0 - y) ** 2
        s = np.sqrt(2.0 * u)
        pace = slope / s
        return s, pace, (push - pace**2) / s
