"""Limits of a URDF as far as they are known.

Exporters write zeros, ones or giants where nobody gave a limit. Such a number says nothing of the
arm: taken at its word, a joint could neither move nor hold itself.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Bool, Float

# What exporters write for a speed or a torque that nobody knows, whatever its unit.
PLACEHOLDERS = (0.0, 1.0)
# Beyond these a limit stands for none [N m or N; rad/s or m/s; rad or m].
LARGEST_EFFORT = 1e5
LARGEST_SPEED = 1e3
LARGEST_POSITION = 1e5


class KnownLimits(NamedTuple):
    """The limits of n joints, infinite where they are unknown."""

    lower: Float[Array, " n"]  # position [rad or m]
    upper: Float[Array, " n"]
    speed: Float[Array, " n"]  # [rad/s or m/s]
    effort: Float[Array, " n"]  # [N m or N]

    @property
    def reach(self) -> Float[Array, " n"]:
        """The farthest position to either side [rad or m]."""
        return np.asarray(np.maximum(np.abs(self.lower), np.abs(self.upper)))


def is_placeholder(values: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Which limits are an exporter's round numbers, and none that somebody gave.

    Args:
        values: Limits of speed [rad/s] or torque [N m], as the URDF has them.
    """
    return np.isin(np.asarray(values, dtype=float), PLACEHOLDERS)


def has_room(lower: Float[Array, " n"], upper: Float[Array, " n"]) -> Bool[Array, " n"]:
    """Of which joints the limits of position leave room; 0 to 0 says that nobody knows them.

    Args:
        lower, upper: Limits of position, as the URDF has them [rad or m].
    """
    return np.asarray(upper > lower)


def known_limits(
    lower: Float[Array, " n"],
    upper: Float[Array, " n"],
    speed: Float[Array, " n"],
    effort: Float[Array, " n"],
) -> KnownLimits:
    """The limits as a URDF states them, made infinite where that says nothing.

    Args:
        lower, upper: Positions [rad or m]; unknown where there is no room between them, or more
            than any joint has.
        speed, effort: Unknown where they are placeholders or beyond all measure.
    """
    lower = np.asarray(lower, dtype=float)
    upper = np.asarray(upper, dtype=float)
    speed = np.asarray(speed, dtype=float)
    effort = np.asarray(effort, dtype=float)
    bounded = has_room(lower, upper) & (upper - lower < LARGEST_POSITION)
    moves = (speed > 0.0) & (speed < LARGEST_SPEED) & ~is_placeholder(speed)
    pulls = (effort > 0.0) & (effort < LARGEST_EFFORT) & ~is_placeholder(effort)
    return KnownLimits(
        np.where(bounded, lower, -np.inf),
        np.where(bounded, upper, np.inf),
        np.where(moves, speed, np.inf),
        np.where(pulls, effort, np.inf),
    )
