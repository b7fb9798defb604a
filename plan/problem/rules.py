"""What a scene file asks of a motion's way beside limits, and of its end as a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ident.arrays import Array, Float


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is to be."""

    frame: str | None  # its name; the arm's last link if None
    place: Float[Array, " 3"]  # in the base frame [m]
    # Its axes in the base frame; None where any will do.
    rotation: Float[Array, "3 3"] | None = None


@dataclass(frozen=True, eq=False)
class ViaPoint:
    """A via point that must be passed."""

    # Angles of the joints [rad], or the tool's place in the base frame [m].
    target: Float[Array, " k"]
    of_tool: bool  # whether it is the tool's place
    within: float  # how far each joint, or each coordinate of the place, may be off [rad or m]


@dataclass(frozen=True, eq=False)
class Cone:
    """Directions in which an axis of the tool may, or may not, point."""

    axis: Float[Array, " 3"]  # of the tool's frame, a unit vector
    towards: Float[Array, " 3"]  # in the base frame, a unit vector
    angle: float  # half of the cone's opening [rad]
    allowed: bool  # whether the axis stays inside; else it stays outside


@dataclass(frozen=True, eq=False)
class WayRules:
    """All that a scene file asks of the way."""

    frame: str | None = None  # the tool's frame; the arm's tip frame if None
    speed: float | None = None  # largest speed of its origin [m/s]; None for any
    # How far it may be off the straight line from start to goal [m]; None where it need not be
    # straight.
    straight: float | None = None
    turning: float = math.radians(0.5)  # how far its turn may be off an even one on that line [rad]
    cones: tuple[Cone, ...] = ()  # where its axes may point
    vias: tuple[ViaPoint, ...] = ()  # via points that must be passed, in this order

    @property
    def given(self) -> bool:
        """Whether anything is asked for."""
        if self.frame is not None or self.speed is not None or self.straight is not None:
            return True
        return bool(self.cones or self.vias)
