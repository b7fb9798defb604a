"""A goal as the pose of a frame: `[task.goal_pose]` of a scene file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.urdf import rpy_to_matrix
from plan.errors import SceneError
from plan.problem.scene_keys import SceneTable

POSE_KEYS = {"frame", "xyz_m", "rpy_rad", "quaternion_xyzw"}
# A quaternion whose length is farther from one than this is a slip of the pen, not rounding.
ROUNDED = 0.01
# No arm reaches farther: millimetres were meant, or nothing at all [m].
FARTHEST = 100.0


@dataclass(frozen=True, eq=False)
class Pose:
    """Where a frame is to be.

    Attributes:
        frame: Its name; the arm's last link if None.
        place: In the base frame [m].
        rotation: Its axes in the base frame; None where any will do.
    """

    frame: str | None
    place: Float[Array, " 3"]
    rotation: Float[Array, "3 3"] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "place", freeze(self.place))
        if self.rotation is not None:
            object.__setattr__(self, "rotation", freeze(self.rotation))


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
    return [
        _pose(SceneTable(task.file, name, one, POSE_KEYS)) for one in (poses if isinstance(poses, list) else [poses])
    ]


def _pose(table: SceneTable) -> Pose:
    frame, place = table.text("frame") if "frame" in table else None, table.numbers("xyz_m", 3)
    if np.abs(place).max() > FARTHEST:
        raise table.fault("xyz_m", f"lies {np.abs(place).max():.3g} m away", "give metres from the base")
    if "rpy_rad" in table and "quaternion_xyzw" in table:
        raise SceneError(table.file, f"{table.name} has both rpy_rad and quaternion_xyzw", "give one of them")
    if "rpy_rad" in table:
        return Pose(frame, place, rpy_to_matrix(table.numbers("rpy_rad", 3)))
    if "quaternion_xyzw" not in table:
        return Pose(frame, place)
    given = table.numbers("quaternion_xyzw", 4)
    length = float(np.linalg.norm(given))
    if abs(length - 1.0) > ROUNDED:
        remedy = "give x, y, z, w of a unit quaternion"
        raise table.fault("quaternion_xyzw", f"has length {length:.3g}, not 1", remedy)
    return Pose(frame, place, pin.Quaternion(given / length).toRotationMatrix())
