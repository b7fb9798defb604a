"""Motions that start and end at rest, as functions of time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from ident.arrays import Array, Float

TICK_S = 1e-3
"""Period of the controller [s]."""
# Share of its duration in which a Fourier series, or a chirp, is faded in, and out.
FADING_SHARE = 0.15
# Longest time in which a chirp is faded [s].
LONGEST_FADING_S = 0.8
# Power of the frequency by which a chirp's swing falls.
SWING_POWER = 1.35
# Standstill before point-to-point moves [s].
FIRST_DWELL_S = 0.1
# A move over less is none [rad].
SHORTEST_MOVE = 1e-9

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
        backwards = -self.dq[::-1]
        return ReferenceMotion(name, self.q[::-1].copy(), backwards, self.ddq[::-1].copy())

    def held(self, before: float, after: float) -> ReferenceMotion:
        """With standstill before and after [s]."""
        pads = ((round(before / TICK_S), round(after / TICK_S)), (0, 0))
        return ReferenceMotion(
            name=self.name,
            q=np.pad(self.q, pads, "edge"),
            dq=np.pad(self.dq, pads),
            ddq=np.pad(self.ddq, pads),
        )


def ticks(duration: float) -> Float[Array, " K"]:
    """Times of the controller's ticks from zero to a duration [s]."""
    return np.arange(round(duration / TICK_S) + 1) * TICK_S


def via_spline(name: str, points: Float[Array, "m n"], duration: float) -> ReferenceMotion:
    """Quintic spline through points at equal times.

    It rests at both ends, without velocity and acceleration.
    """
    knots = np.linspace(0.0, duration, len(points))
    still = np.zeros(points.shape[1])
    rest = [(1, still), (2, still)]
    spline = make_interp_spline(knots, points, k=5, bc_type=(rest, rest))
    t = ticks(duration)
    return ReferenceMotion(name, spline(t), spline(t, 1), spline(t, 2))


def window(t: Float[Array, " K"], duration: float, ramp: float) -> Float[Array, " K"]:
    """0 → 1 → 0 with three continuous derivatives, flat in between.

    Args:
        t: Times, from 0 to the duration [s].
        duration, ramp: When it ends, and how long it rises and falls [s].
    """
    s = np.clip(np.minimum(t, duration - t) / ramp, 0.0, 1.0)
    return s**4 * (35.0 - 84.0 * s + 70.0 * s**2 - 20.0 * s**3)


def sampled(name: str, q: Float[Array, "K n"]) -> ReferenceMotion:
    """A motion from densely sampled positions of a smooth curve.

    Derivatives are central differences. These stand five ticks apart at most, far below any
    motion's time scale (errors under 1e-4).
    """
    dq = np.gradient(q, TICK_S, axis=0, edge_order=2)
    ddq = np.gradient(dq, TICK_S, axis=0, edge_order=2)
    dq[[0, -1]] = 0.0
    ddq[[0, -1]] = 0.0
    return ReferenceMotion(name, q, dq, ddq)


def fourier(
    name: str,
    centre: Float[Array, " n"],
    sines: Float[Array, "m n"],
    cosines: Float[Array, "m n"],
    base_hz: float,
    duration: float,
) -> ReferenceMotion:
    """Finite Fourier series about a pose, faded in and out."""
    t = ticks(duration)
    order = 2.0 * np.pi * base_hz * np.arange(1, len(sines) + 1)
    angle = np.outer(t, order)
    wave = np.sin(angle) @ sines + np.cos(angle) @ cosines
    fading = window(t, duration, FADING_SHARE * duration)
    return sampled(name, centre + fading[:, None] * wave)


def chirp(
    name: str,
    centre: Float[Array, " n"],
    amplitude: Float[Array, " n"],
    band_hz: tuple[float, float],
    phase: Float[Array, " n"],
    duration: float,
) -> ReferenceMotion:
    """Logarithmic sweep of frequency about a pose [rad].

    The swing falls as the frequency rises, so that speed falls slowly.

    Args:
        name: Of the motion.
        centre: The pose [rad].
        amplitude: At the lowest frequency [rad].
        band_hz: Lowest and highest frequency [Hz].
        phase: Start of each joint's wave [rad].
        duration: Of it all [s].
    """
    t = ticks(duration)
    low, high = band_hz
    rate = np.log(high / low) / duration
    angle = 2.0 * np.pi * low * np.expm1(rate * t) / rate
    fading = window(t, duration, min(LONGEST_FADING_S, FADING_SHARE * duration))
    swing = (np.exp(-rate * t)) ** SWING_POWER * fading
    wave = np.sin(angle[:, None] + phase)
    return sampled(name, centre + swing[:, None] * amplitude * wave)


def ramps(
    start: float, moves: Sequence[tuple[float, float]], acceleration: float, dwell: float
) -> Float[Array, " K"]:
    """Point-to-point moves of one joint at constant speeds.

    With smooth corners, and standstill between them.

    Args:
        start: First position [rad].
        moves: (goal [rad], speed [rad/s]) of each move.
        acceleration: Mean acceleration of the corners [rad/s²].
        dwell: Standstill after each move [s].
    """
    pieces = [_standstill(start, FIRST_DWELL_S)]
    position = start
    for goal, speed in moves:
        pieces.append(_move(position, goal, speed, acceleration))
        pieces.append(_standstill(goal, dwell))
        position = goal
    return np.concatenate(pieces)


def _standstill(position: float, duration: float) -> Float[Array, " K"]:
    """A position, held for a time [s]."""
    return np.full(max(round(duration / TICK_S), 1), position)


def _move(start: float, goal: float, speed: float, acceleration: float) -> Float[Array, " K"]:
    """One move, whose speed rises by a smooth step, stays, and falls."""
    distance = abs(goal - start)
    if distance < SHORTEST_MOVE:
        return np.full(1, goal)
    corner = speed / acceleration
    if speed * corner > distance:  # too short to reach the speed
        speed = np.sqrt(distance * acceleration)
        corner = np.sqrt(distance / acceleration)
    total = distance / speed + corner
    t = ticks(total)
    s = np.clip(np.minimum(t, total - t) / corner, 0.0, 1.0)
    profile = speed * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    steps = 0.5 * (profile[1:] + profile[:-1]) * TICK_S
    way = np.concatenate([[0.0], np.cumsum(steps)])
    share = distance / way[-1]
    return start + np.sign(goal - start) * way * share


def together(name: str, joints: Sequence[Float[Array, " K"]]) -> ReferenceMotion:
    """One motion of all joints, each waiting at its end for the slowest."""
    longest = max(len(path) for path in joints)
    columns = []
    for path in joints:
        waiting = np.full(longest - len(path), path[-1])
        columns.append(np.concatenate([path, waiting]))
    return sampled(name, np.column_stack(columns))
