"""Clamped cubic splines through via points, thousands at a time.

A trajectory is V via points between start and goal and V + 1 section durations. Position, velocity
and acceleration are continuous and the ends are at rest. (Natural splines, the usual library
default, would start and end with velocity; the paper does not print its end condition.)
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from ident.arrays import Array, Float, freeze
from ident.compiled import compiled


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _slopes(points: Array, h: Array) -> Array:
    """Velocities at the knots that make the acceleration continuous: one tridiagonal solve a
    trajectory.
    """
    batch, knots, n = points.shape
    out = np.zeros((batch, knots, n))
    upper = np.empty(knots)
    for b in range(batch):
        upper[0] = 0.0
        for i in range(1, knots - 1):
            h0 = h[b, i - 1]
            h1 = h[b, i]
            pivot = 2.0 * (h0 + h1) - h1 * upper[i - 1]
            upper[i] = h0 / pivot
            for j in range(n):
                slope0 = (points[b, i, j] - points[b, i - 1, j]) / h0
                slope1 = (points[b, i + 1, j] - points[b, i, j]) / h1
                out[b, i, j] = (3.0 * (h1 * slope0 + h0 * slope1) - h1 * out[b, i - 1, j]) / pivot
        for i in range(knots - 3, 0, -1):
            for j in range(n):
                out[b, i, j] -= upper[i] * out[b, i + 1, j]
    return out


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _states(points: Array, slopes: Array, h: Array, s: Array) -> Array:
    """Position, velocity, acceleration at local times s of every section, shape (3, B, sections
    len(s), n).
    """
    batch, knots, n = points.shape
    count = s.shape[0]
    out = np.empty((3, batch, (knots - 1) * count, n))
    for b in range(batch):
        for k in range(knots - 1):
            inverse = 1.0 / h[b, k]
            for j in range(n):
                q0 = points[b, k, j]
                v0 = slopes[b, k, j] * h[b, k]
                v1 = slopes[b, k + 1, j] * h[b, k]
                d = points[b, k + 1, j] - q0
                c2 = 3.0 * d - 2.0 * v0 - v1
                c3 = v0 + v1 - 2.0 * d
                for i in range(count):
                    x = s[i]
                    out[0, b, k * count + i, j] = q0 + x * (v0 + x * (c2 + x * c3))
                    out[1, b, k * count + i, j] = (v0 + x * (2.0 * c2 + 3.0 * c3 * x)) * inverse
                    out[2, b, k * count + i, j] = (2.0 * c2 + 6.0 * c3 * x) * inverse * inverse
    return out


@compiled(fastmath=True, nogil=True, error_model="numpy")
def _extremes(points: Array, slopes: Array, h: Array) -> tuple[Array, Array, Array]:
    """Top speed of every section and joint, and the lowest and highest position of every joint."""
    batch, knots, n = points.shape
    speed = np.empty((batch, knots - 1, n))
    low = np.empty((batch, n))
    high = np.empty((batch, n))
    for b in range(batch):
        for j in range(n):
            low[b, j] = points[b, 0, j]
            high[b, j] = points[b, 0, j]
        for k in range(knots - 1):
            for j in range(n):
                q0 = points[b, k, j]
                v0 = slopes[b, k, j] * h[b, k]
                v1 = slopes[b, k + 1, j] * h[b, k]
                d = points[b, k + 1, j] - q0
                c2 = 3.0 * d - 2.0 * v0 - v1
                c3 = v0 + v1 - 2.0 * d
                top = max(abs(v0), abs(v1))
                low[b, j] = min(low[b, j], q0 + d)
                high[b, j] = max(high[b, j], q0 + d)
                if abs(c3) > 1e-14:
                    x = -c2 / (3.0 * c3)
                    if 0.0 < x < 1.0:
                        top = max(top, abs(v0 + x * (2.0 * c2 + 3.0 * c3 * x)))
                inside = c2 * c2 - 3.0 * c3 * v0
                if inside >= 0.0:
                    # Both roots of v0 + 2 c2 x + 3 c3 x², by the form that does not cancel.
                    half = -(c2 + (np.sqrt(inside) if c2 >= 0.0 else -np.sqrt(inside)))
                    for root in range(2):
                        if root == 0:
                            x = half / (3.0 * c3) if abs(c3) > 1e-14 else 2.0
                        else:
                            x = v0 / half if abs(half) > 1e-14 else 2.0
                        if 0.0 < x < 1.0:
                            turning = q0 + x * (v0 + x * (c2 + x * c3))
                            low[b, j] = min(low[b, j], turning)
                            high[b, j] = max(high[b, j], turning)
                speed[b, k, j] = top / h[b, k]
    return speed, low, high


@dataclass(frozen=True, eq=False)
class Splines:
    """A batch of B clamped cubic splines with V via points."""

    points: Float[Array, "B K n"]  # start, via points, goal [rad]
    durations: Float[Array, "B S"]  # section durations, all above zero [s]
    # Velocities at the knots, of a curve that a controller makes of points and velocities [rad/s];
    # None for those of the clamped spline, which alone make the acceleration continuous.
    sent_velocities: Float[Array, "B K n"] | None = None

    def __post_init__(self) -> None:
        for name in ("points", "durations", "sent_velocities"):
            if getattr(self, name) is not None:
                values = np.ascontiguousarray(getattr(self, name), dtype=float)
                object.__setattr__(self, name, freeze(values))

    @cached_property
    def slopes(self) -> Float[Array, "B K n"]:
        """Velocities at the knots; zero at both ends of a clamped spline [rad/s]."""
        if self.sent_velocities is not None:
            return self.sent_velocities
        return _slopes(self.points, self.durations)

    @cached_property
    def _bounds(self) -> tuple[Array, Array, Array]:
        return _extremes(self.points, self.slopes, self.durations)

    @property
    def section_speeds(self) -> Float[Array, "B S n"]:
        """Top speed of every section and joint, exact [rad/s]."""
        return self._bounds[0]

    @property
    def top_speed(self) -> Float[Array, "B n"]:
        """Top speed of every joint, exact [rad/s]."""
        return self._bounds[0].max(axis=1)

    @cached_property
    def _accelerations(self) -> Float[Array, "B S 2 n"]:
        """Acceleration at both ends of every section; linear in between [rad/s²]."""
        sections = self.durations.shape[1]
        return self.states(np.array([0.0, 1.0]))[2].reshape(len(self.points), sections, 2, -1)

    @property
    def top_acceleration(self) -> Float[Array, "B n"]:
        """Largest acceleration of every joint, exact [rad/s²]."""
        return np.abs(self._accelerations).max(axis=(1, 2))

    @property
    def top_jerk(self) -> Float[Array, "B n"]:
        """Largest jerk of every joint between start and goal, exact [rad/s³]."""
        steps = np.abs(np.diff(self._accelerations, axis=2))[:, :, 0]
        return (steps / self.durations[:, :, None]).max(axis=1)

    @property
    def end_acceleration(self) -> Float[Array, "B n"]:
        """Larger acceleration of every joint at start and goal, which a motion from rest to rest
        jumps to [rad/s²].
        """
        return np.abs(self._accelerations[:, [0, -1], [0, 1]]).max(axis=1)

    @property
    def acceleration_jumps(self) -> Float[Array, "B n"]:
        """Largest step of each joint's acceleration at a knot between start and goal [rad/s²];
        nought if clamped.
        """
        before = self._accelerations[:, :-1, 1]
        after = self._accelerations[:, 1:, 0]
        return np.abs(after - before).max(axis=1, initial=0.0)

    @property
    def lowest(self) -> Float[Array, "B n"]:
        """Lowest position of every joint, exact [rad]."""
        return self._bounds[1]

    @property
    def highest(self) -> Float[Array, "B n"]:
        """Highest position of every joint, exact [rad]."""
        return self._bounds[2]

    @property
    def total(self) -> Float[Array, " B"]:
        """Whole duration [s]."""
        return self.durations.sum(axis=1)

    def states(self, s: Float[Array, " m"]) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration at local times s ∈ [0, 1] of every section, each (B,
        S·m, n).
        """
        # Read-only, whoever asks: loops are compiled anew for what may be written.
        shares = freeze(s)
        q, dq, ddq = _states(self.points, self.slopes, self.durations, shares)
        return q, dq, ddq

    def at(self, times: Float[Array, " T"]) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration of the first trajectory at times, each (T, n)."""
        return self._curve(times), self._curve(times, 1), self._curve(times, 2)

    @cached_property
    def _curve(self) -> CubicHermiteSpline:
        knots = np.concatenate([[0.0], np.cumsum(self.durations[0])])
        return CubicHermiteSpline(knots, self.points[0], self.slopes[0])
