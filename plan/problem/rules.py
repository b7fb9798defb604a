"""What a scene file asks of a motion's way beside limits and clearance, and of its end as a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ident.arrays import Array, Float, freeze
from plan.problem.scene_keys import SceneTable


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
        InputError: A key is missing, unknown or of the wrong kind.
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
        cones=tuple(
            Cone(table["axis"], table["towards"], table[given], given == "allowed_deg")
            for table in tool.tables("cone")
            for given in [table.one_of("allowed_deg", "keep_out_deg")]
        ),
        vias=tuple(
            ViaPoint(freeze(table[kind]), kind == "xyz_m", table["within_m" if kind == "xyz_m" else "within_deg"])
            for table in top.tables("pass")
            for kind in [table.one_of("deg", "xyz_m")]
        ),
    )


def read_poses(task: SceneTable) -> list[Pose]:
    """The goal's pose, or the poses of which any will do; none where the goal is given by its joint angles.

    Raises:
        InputError: A key is missing, unknown or of the wrong kind.
    """
    poses, name = task.entry.get("goal_pose", []), task.path("goal_pose")
    tables = [SceneTable(task.file, name, one) for one in (poses if isinstance(poses, list) else [poses])]
    return [
        Pose(one["frame"], freeze(one["xyz_m"]), one["rpy_rad"] if "rpy_rad" in one else one["quaternion_xyzw"])
        for one in tables
    ]
