"""Curves that start and end at rest, as functions of time, and references as simple controllers make them.

A simple controller is sent positions at a slow, even rate and joins them by straight lines; a moving average over one
period makes the velocity a chain of ramps (steps of acceleration), another one makes the acceleration one (steps of
jerk).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.ndimage import uniform_filter1d

from ident.arrays import Array, Float

TICK_S = 1e-3
"""Period of the controller [s]."""

Curve = Callable[[Float[Array, " K"]], Float[Array, "K n"]]


@dataclass(frozen=True, eq=False)
class ReferenceMotion:
    """A reference trajectory at the controller's ticks."""

    name: str  # what it is, for file names
    q: Float[Array, "K n"]  # position, velocity, acceleration, shape (K, n)
    dq: Float[Array, "K n"]
    ddq: Float[Array, "K n"]

    @property
    def duration(self) -> float:
        """From the first to the last tick [s]."""
        return (len(self.q) - 1) * TICK_S

    def reversed(self, name: str) -> ReferenceMotion:
        """The same path backwards."""
        return ReferenceMotion(name, self.q[::-1].copy(), -self.dq[::-1], self.ddq[::-1].copy())

    def held(self, before: float, after: float) -> ReferenceMotion:
        """With standstill before and after [s]."""
        pads = ((round(before / TICK_S), round(after / TICK_S)), (0, 0))
        return ReferenceMotion(self.name, np.pad(self.q, pads, "edge"), np.pad(self.dq, pads), np.pad(self.ddq, pads))


def ticks(duration: float) -> Float[Array, " K"]:
    """Times of the controller's ticks from zero to a duration [s]."""
    return np.arange(round(duration / TICK_S) + 1) * TICK_S


def via_spline(name: str, points: Float[Array, "m n"], duration: float) -> ReferenceMotion:
    """Quintic spline through points at equal times, with rest (no velocity, no acceleration) at both ends."""
    knots = np.linspace(0.0, duration, len(points))
    rest = [(1, np.zeros(points.shape[1])), (2, np.zeros(points.shape[1]))]
    spline = make_interp_spline(knots, points, k=5, bc_type=(rest, rest))
    t = ticks(duration)
    return ReferenceMotion(name, spline(t), spline(t, 1), spline(t, 2))


def window(t: Float[Array, " K"], duration: float, ramp: float) -> Float[Array, " K"]:
    """0 → 1 → 0 with three continuous derivatives, flat in between."""
    s = np.clip(np.minimum(t, duration - t) / ramp, 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def sampled(name: str, q: Float[Array, "K n"]) -> ReferenceMotion:
    """A motion from densely sampled positions of a smooth curve; derivatives by central differences.

    The differences stand five ticks apart at most, far below any motion's time scale (errors under 1e-4).
    """
    dq = np.gradient(q, TICK_S, axis=0, edge_order=2)
    ddq = np.gradient(dq, TICK_S, axis=0, edge_order=2)
    dq[[0, -1]] = ddq[[0, -1]] = 0.0
    return ReferenceMotion(name, q, dq, ddq)


def fourier(
    name: str, centre: Array, sines: Float[Array, "m n"], cosines: Array, base_hz: float, duration: float
) -> ReferenceMotion:
    """Finite Fourier series about a pose, faded in and out over 15 % of the duration."""
    t = ticks(duration)
    order = 2.0 * np.pi * base_hz * np.arange(1, len(sines) + 1)
    wave = np.sin(np.outer(t, order)) @ sines + np.cos(np.outer(t, order)) @ cosines
    return sampled(name, centre + window(t, duration, 0.15 * duration)[:, None] * wave)


def chirp(
    name: str, centre: Array, amplitude: Array, band_hz: tuple[float, float], phase: Array, duration: float
) -> ReferenceMotion:
    """Logarithmic sweep of frequency about a pose [rad]; the swing falls as it rises, so that speed falls slowly.

    The amplitude is that at the lowest frequency [rad], the phase the start of each joint's wave, of shape (n,).
    """
    t = ticks(duration)
    low, high = band_hz
    rate = np.log(high / low) / duration
    angle = 2.0 * np.pi * low * np.expm1(rate * t) / rate
    swing = (np.exp(-rate * t)) ** 1.35 * window(t, duration, min(0.8, 0.15 * duration))
    return sampled(name, centre + swing[:, None] * amplitude * np.sin(angle[:, None] + phase))


def ramps(start: float, moves: Sequence[tuple[float, float]], acceleration: float, dwell: float) -> Float[Array, " K"]:
    """Point-to-point moves of one joint at constant speeds, with smooth corners and standstill between them.

    Args:
        start: First position [rad].
        moves: (goal [rad], speed [rad/s]) of each move.
        acceleration: Mean acceleration of the corners [rad/s²].
        dwell: Standstill after each move [s].
    """
    pieces = [np.full(max(round(0.1 / TICK_S), 1), start)]
    at = start
    for goal, speed in moves:  # speed rises by a smooth step, stays, and falls
        distance, path = abs(goal - at), np.full(1, goal)
        if distance >= 1e-9:
            corner = speed / acceleration
            if speed * corner > distance:  # too short to reach the speed
                speed, corner = np.sqrt(distance * acceleration), np.sqrt(distance / acceleration)
            total = distance / speed + corner
            t = ticks(total)
            s = np.clip(np.minimum(t, total - t) / corner, 0.0, 1.0)
            profile = speed * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
            way = np.concatenate([[0.0], np.cumsum(0.5 * (profile[1:] + profile[:-1]) * TICK_S)])
            path = at + np.sign(goal - at) * way * (distance / way[-1])
        pieces += [path, np.full(max(round(dwell / TICK_S), 1), goal)]
        at = goal
    return np.concatenate(pieces)


def together(name: str, joints: Sequence[Float[Array, " K"]]) -> ReferenceMotion:
    """One motion of all joints, each waiting at its end for the slowest."""
    longest = max(len(path) for path in joints)
    columns = [np.concatenate([path, np.full(longest - len(path), path[-1])]) for path in joints]
    return sampled(name, np.column_stack(columns))


# Period at which positions are sent [s]: ordinary motions, and those that swing fast.
PERIOD_S, FAST_PERIOD_S = 0.08, 0.02
FAST = ("chirp",)
AVERAGES = {"acceleration": 1, "jerk": 2}


def stepped(motion: ReferenceMotion, shape: str) -> ReferenceMotion:
    """A motion that rests at both ends as such a controller follows it, with steps of `jerk` or `acceleration`."""
    if shape not in AVERAGES:
        return motion
    period = round((FAST_PERIOD_S if motion.name in FAST else PERIOD_S) / TICK_S)
    ticks = np.arange(len(motion.q))
    sent = np.append(np.arange(0, len(motion.q), period), len(motion.q) - 1)
    q = np.column_stack([np.interp(ticks, sent, column[sent]) for column in motion.q.T])
    for _ in range(AVERAGES[shape]):
        # Mean over one period about each tick.
        mean: Float[Array, "K n"] = uniform_filter1d(q, period + 1 - period % 2, axis=0, mode="nearest")
        q = mean
    dq = np.gradient(q, TICK_S, axis=0)
    ddq = np.gradient(dq, TICK_S, axis=0)
    return ReferenceMotion(motion.name, q, dq, ddq)


# How a plan that starts with an acceleration is executed from rest: the same path, passed along it a little later.
# A drive can't have an acceleration at once. With s(t) the time along the plan and u = s²/2, an arm that the plan
# begins with a steady acceleration a has q̈ = a u''(t). So u'' rises from 0 to 1 within the ramp by a smooth step,
# and then lies a little above 1, in the shape of a bump, until the pace s' has come to 1. A rate that reached 1
# within the ramp itself would ask for up to a quarter more than the plan's own acceleration, which a motion at its
# torque limit hasn't got; the bump is two per cent at most. The end is the beginning's mirror image.


# Longest ramp, as a share of the plan's duration.
RAMP_SHARE = 0.2
# Length of the bump, as a share of the plan's duration less the ramp: both bumps are over before the middle.
BUMP_SHARE = 0.9
# Integral and double integral over 0 to 1 of the bump 16 y² (1 - y)².
ONCE, TWICE = 16.0 / 30.0, 16.0 / 60.0


@dataclass(frozen=True)
class GentleEnds:
    """The time law of an executed plan."""

    total: float  # duration of the plan [s]
    ramp: float  # time in which acceleration gets going, a fifth of the duration at most; 0 for none [s]

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
