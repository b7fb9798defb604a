"""What a motion has to keep on its way beside limits and clearance: via points that it passes, the tool's rules."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, freeze
from plan.errors import SceneError
from plan.problem.scene_keys import SceneTable

# How near to a via point is "through" it, if nothing else is asked for: of each joint [deg], of the tool's place [m].
THROUGH_DEG, THROUGH_M = 0.1, 1e-3
# How far the tool may be off a straight line [m], and its turn off an even one [deg].
OFF_M, OFF_DEG = 1e-3, 0.5


@dataclass(frozen=True, eq=False)
class ViaPoint:
    """A via point that must be passed.

    Attributes:
        target: Angles of the joints [rad], or the tool's place in the base frame [m].
        of_tool: Whether it is the tool's place.
        within: How far each joint, or each coordinate of the place, may be off [rad or m].
    """

    target: Float[Array, " k"]
    of_tool: bool
    within: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "target", freeze(self.target))


@dataclass(frozen=True, eq=False)
class Cone:
    """Directions in which an axis of the tool may, or may not, point.

    Attributes:
        axis: Of the tool's frame, a unit vector.
        towards: In the base frame, a unit vector.
        angle: Half of the cone's opening [rad].
        allowed: Whether the axis stays inside; else it stays outside.
    """

    axis: Float[Array, " 3"]
    towards: Float[Array, " 3"]
    angle: float
    allowed: bool


@dataclass(frozen=True, eq=False)
class WayRules:
    """All that a scene file asks of the way.

    Attributes:
        frame: The tool's frame; the arm's tip frame if None.
        speed: Largest speed of its origin [m/s]; None for any.
        straight: How far it may be off the straight line from start to goal [m]; None where it need not be straight.
        turning: How far its turn may be off an even one on that line [rad].
        cones: Where its axes may point.
        vias: Via points that must be passed, in this order.
    """

    frame: str | None = None
    speed: float | None = None
    straight: float | None = None
    turning: float = math.radians(OFF_DEG)
    cones: tuple[Cone, ...] = ()
    vias: tuple[ViaPoint, ...] = ()

    @property
    def given(self) -> bool:
        """Whether anything is asked for."""
        own = self.frame, self.speed, self.straight
        return any(part is not None for part in own) or bool(self.cones or self.vias)


def read_rules(top: SceneTable, joints: int) -> WayRules:
    """The tables `[tool]`, `[[tool.cone]]` and `[[pass]]` of a scene file.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind.
    """
    tool = top.table("tool")
    straight = tool.flag("straight")
    for key in ("within_m", "within_deg"):
        if key in tool and not straight:
            raise tool.fault(key, "has nothing to be off from", "add straight = true, or drop it")
    return WayRules(
        frame=tool.text("frame") if "frame" in tool else None,
        speed=tool.number("speed_m_s", least=1e-4) if "speed_m_s" in tool else None,
        straight=tool.number("within_m", OFF_M, least=1e-5) if straight else None,
        turning=math.radians(tool.number("within_deg", OFF_DEG, least=0.01)),
        cones=tuple(_cone(table) for table in tool.tables("cone")),
        vias=tuple(_via(table, joints) for table in top.tables("pass")),
    )


def _cone(table: SceneTable) -> Cone:
    given = [key for key in ("allowed_deg", "keep_out_deg") if key in table]
    if len(given) != 1:
        what = f"{table.name} has {' and '.join(given) or 'no angle'}"
        raise SceneError(table.file, what, "give one of them: allowed_deg, keep_out_deg")
    angle, axes = table.number(given[0], least=0.1), []
    if angle > 179.0:
        raise table.fault(given[0], f"is {angle:g}", "give 0.1 to 179 degrees")
    for key, z in (("axis", 1.0), ("towards", -1.0)):
        found = table.numbers(key, 3, np.array([0.0, 0.0, z]))
        length = float(np.linalg.norm(found))
        if length < 1e-6:
            raise table.fault(key, f"is {found.tolist()}, no direction", "give a vector that is not nought")
        axes.append(freeze(found / length))
    return Cone(axes[0], axes[1], math.radians(angle), given[0] == "allowed_deg")


def _via(table: SceneTable, joints: int) -> ViaPoint:
    of_tool = "xyz_m" in table
    if ("deg" in table) == of_tool:
        what = f"{table.name} has {'both deg and xyz_m' if of_tool else 'neither deg nor xyz_m'}"
        raise SceneError(table.file, what, "give the joints' angles, or the tool's place")
    own, other = ("within_m", "within_deg") if of_tool else ("within_deg", "within_m")
    if other in table:
        kind = f"{'place' if of_tool else 'joint angles'}: {own}"
        raise table.fault(other, "goes with the other kind of via point", f"this one is of {kind}")
    if of_tool:
        return ViaPoint(table.numbers("xyz_m", 3), True, table.number(own, THROUGH_M, least=1e-5))
    within = math.radians(table.number(own, THROUGH_DEG, least=0.01))
    return ViaPoint(np.radians(table.numbers("deg", joints)), False, within)
