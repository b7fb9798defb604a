"""What a motion has to keep on its way beside limits and clearance: via points that it passes, the tool's rules."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array, Float, freeze
from plan.errors import SceneError

if TYPE_CHECKING:
    from plan.problem.task_file import Reader

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


def read_rules(reader: Reader, document: Mapping[str, Any], joints: int) -> WayRules:
    """The tables `[tool]`, `[[tool.cone]]` and `[[pass]]` of a scene file.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind.
    """
    tool = document.get("tool", {})
    straight = reader.flag(tool, "tool.straight")
    for key in ("within_m", "within_deg"):
        if key in tool and not straight:
            raise SceneError(reader.file, f"tool.{key} has nothing to be off from", "add straight = true, or drop it")
    return WayRules(
        frame=reader.text(tool, "frame") if "frame" in tool else None,
        speed=reader.number(tool, "tool.speed_m_s", least=1e-4) if "speed_m_s" in tool else None,
        straight=reader.number(tool, "tool.within_m", OFF_M, least=1e-5) if straight else None,
        turning=math.radians(reader.number(tool, "tool.within_deg", OFF_DEG, least=0.01)),
        cones=tuple(_cone(reader, *item) for item in reader.tables(tool, "cone", "tool.cone")),
        vias=tuple(_via(reader, *item, joints) for item in reader.tables(document, "pass", "pass")),
    )


def _cone(reader: Reader, entry: Mapping[str, Any], name: str) -> Cone:
    reader.known("tool.cone", entry, name)
    given = [key for key in ("allowed_deg", "keep_out_deg") if key in entry]
    if len(given) != 1:
        raise SceneError(
            reader.file,
            f"{name} has {' and '.join(given) or 'no angle'}",
            "give one of them: allowed_deg, keep_out_deg",
        )
    angle = reader.number(entry, f"{name}.{given[0]}", least=0.1)
    if angle > 179.0:
        raise SceneError(reader.file, f"{name}.{given[0]} is {angle:g}", "give 0.1 to 179 degrees")
    axes = [_direction(reader, entry, f"{name}.{key}", default) for key, default in (("axis", 1.0), ("towards", -1.0))]
    return Cone(axes[0], axes[1], math.radians(angle), given[0] == "allowed_deg")


def _direction(reader: Reader, entry: Mapping[str, Any], key: str, z: float) -> Float[Array, " 3"]:
    found = reader.numbers(entry, key, 3, np.array([0.0, 0.0, z]))
    length = float(np.linalg.norm(found))
    if length < 1e-6:
        raise SceneError(reader.file, f"{key} is {found.tolist()}, no direction", "give a vector that is not nought")
    return freeze(found / length)


def _via(reader: Reader, entry: Mapping[str, Any], name: str, joints: int) -> ViaPoint:
    reader.known("pass", entry, name)
    if ("deg" in entry) == ("xyz_m" in entry):
        both = "both deg and xyz_m" if "deg" in entry else "neither deg nor xyz_m"
        raise SceneError(reader.file, f"{name} has {both}", "give the joints' angles, or the tool's place")
    of_tool = "xyz_m" in entry
    other = "within_deg" if of_tool else "within_m"
    if other in entry:
        kind = "place: within_m" if of_tool else "joint angles: within_deg"
        raise SceneError(reader.file, f"{name}.{other} goes with the other kind of via point", f"this one is of {kind}")
    if of_tool:
        within = reader.number(entry, f"{name}.within_m", THROUGH_M, least=1e-5)
        return ViaPoint(reader.numbers(entry, f"{name}.xyz_m", 3), True, within)
    within = math.radians(reader.number(entry, f"{name}.within_deg", THROUGH_DEG, least=0.01))
    return ViaPoint(np.radians(reader.numbers(entry, f"{name}.deg", joints)), False, within)
