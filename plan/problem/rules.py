"""What a scene file asks of a motion's way beside limits and clearance, and of its end as a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.urdf import rpy_to_matrix
from plan.errors import SceneError
from plan.problem.scene_keys import SceneTable

# A quaternion whose length is farther from one than this is a slip of the pen, not rounding.
ROUNDED = 0.01
# No arm reaches farther: millimetres were meant, or nothing at all [m].
FARTHEST = 100.0


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is to be."""

    frame: str | None  # its name; the arm's last link if None
    place: Float[Array, " 3"]  # in the base frame [m]
    rotation: Float[Array, "3 3"] | None = None  # its axes in the base frame; None where any will do


@dataclass(frozen=True, eq=False)
class ViaPoint:
    """A via point that must be passed."""

    target: Float[Array, " k"]  # angles of the joints [rad], or the tool's place in the base frame [m]
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
    # How far it may be off the straight line from start to goal [m]; None where it need not be straight.
    straight: float | None = None
    turning: float = math.radians(0.5)  # how far its turn may be off an even one on that line [rad]
    cones: tuple[Cone, ...] = ()  # where its axes may point
    vias: tuple[ViaPoint, ...] = ()  # via points that must be passed, in this order

    @property
    def given(self) -> bool:
        """Whether anything is asked for."""
        own = self.frame, self.speed, self.straight
        return any(part is not None for part in own) or bool(self.cones or self.vias)


def read_rules(top: SceneTable) -> WayRules:
    """The tables `[tool]`, `[[tool.cone]]` and `[[pass]]` of a scene file.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind.
    """
    tool = top.table("tool")
    for key in ("within_m", "within_deg"):
        if key in tool and not tool["straight"]:
            raise tool.fault(key, "has nothing to be off from", "add straight = true, or drop it")
    return WayRules(
        frame=tool["frame"],
        speed=tool["speed_m_s"],
        straight=tool["within_m"] if tool["straight"] else None,
        turning=tool["within_deg"],
        cones=tuple(_cone(table) for table in tool.tables("cone")),
        vias=tuple(_via(table) for table in top.tables("pass")),
    )


def _cone(table: SceneTable) -> Cone:
    given = [key for key in ("allowed_deg", "keep_out_deg") if key in table]
    if len(given) != 1:
        what = f"{table.name} has {' and '.join(given) or 'no angle'}"
        raise SceneError(table.file, what, "give one of them: allowed_deg, keep_out_deg")
    angle, axes = table[given[0]], []
    if angle > 179.0:
        raise table.fault(given[0], f"is {angle:g}", "give 0.1 to 179 degrees")
    for key in ("axis", "towards"):
        found = table[key]
        length = float(np.linalg.norm(found))
        if length < 1e-6:
            raise table.fault(key, f"is {found.tolist()}, no direction", "give a vector that is not nought")
        axes.append(freeze(found / length))
    return Cone(axes[0], axes[1], math.radians(angle), given[0] == "allowed_deg")


def _via(table: SceneTable) -> ViaPoint:
    of_tool = "xyz_m" in table
    if ("deg" in table) == of_tool:
        what = f"{table.name} has {'both deg and xyz_m' if of_tool else 'neither deg nor xyz_m'}"
        raise SceneError(table.file, what, "give the joints' angles, or the tool's place")
    own, other = ("within_m", "within_deg") if of_tool else ("within_deg", "within_m")
    if other in table:
        kind = f"{'place' if of_tool else 'joint angles'}: {own}"
        raise table.fault(other, "goes with the other kind of via point", f"this one is of {kind}")
    return ViaPoint(freeze(table["xyz_m" if of_tool else "deg"]), of_tool, table[own])


def read_poses(task: SceneTable) -> list[Pose]:
    """The goal's pose, or the poses of which any will do; none where the goal is given by its joint angles.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind, or both kinds of goal are given.
    """
    poses = task.entry.get("goal_pose", [])
    for key in ("goal_deg", "goals_deg"):
        if key in task and poses:
            raise SceneError(task.file, f"task has both {key} and goal_pose", "give one of them")
    name = task.path("goal_pose")
    return [_pose(SceneTable(task.file, name, one)) for one in (poses if isinstance(poses, list) else [poses])]


def _pose(table: SceneTable) -> Pose:
    place, rpy, given = freeze(table["xyz_m"]), table["rpy_rad"], table["quaternion_xyzw"]
    if np.abs(place).max() > FARTHEST:
        raise table.fault("xyz_m", f"lies {np.abs(place).max():.3g} m away", "give metres from the base")
    if given is None:
        return Pose(table["frame"], place, None if rpy is None else freeze(rpy_to_matrix(rpy)))
    if rpy is not None:
        raise SceneError(table.file, f"{table.name} has both rpy_rad and quaternion_xyzw", "give one of them")
    length = float(np.linalg.norm(given))
    if abs(length - 1.0) > ROUNDED:
        raise table.fault("quaternion_xyzw", f"has length {length:.3g}, not 1", "give x, y, z, w of a unit quaternion")
    return Pose(table["frame"], place, freeze(pin.Quaternion(given / length).toRotationMatrix()))
