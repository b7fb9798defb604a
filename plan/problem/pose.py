"""A goal as the pose of a frame: `[task.goal_pose]` of a scene file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.robot.urdf import rpy_to_matrix
from plan.errors import SceneError

if TYPE_CHECKING:
    from plan.problem.task_file import Reader

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


def read_poses(reader: Reader, task: Mapping[str, Any]) -> list[Pose]:
    """The goal's pose, or the poses of which any will do; none where the goal is given by its joint angles.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind, or both kinds of goal are given.
    """
    tables = task.get("goal_pose", [])
    for key in ("goal_deg", "goals_deg"):
        if key in task and tables:
            raise SceneError(reader.file, f"task has both {key} and goal_pose", "give one of them")
    return [_pose(reader, table) for table in (tables if isinstance(tables, list) else [tables])]


def _pose(reader: Reader, table: Any) -> Pose:
    if not isinstance(table, dict):
        raise SceneError(reader.file, "task.goal_pose is not a table", "write [task.goal_pose] and its keys")
    reader.only(table, POSE_KEYS, "task.goal_pose")
    frame = reader.text(table, "frame") if "frame" in table else None
    place = reader.numbers(table, "task.goal_pose.xyz_m", 3)
    if np.abs(place).max() > FARTHEST:
        what = f"task.goal_pose.xyz_m lies {np.abs(place).max():.3g} m away"
        raise SceneError(reader.file, what, "give metres from the base")
    return Pose(frame, place, _rotation(reader, table))


def _rotation(reader: Reader, table: Mapping[str, Any]) -> Float[Array, "3 3"] | None:
    if "rpy_rad" in table and "quaternion_xyzw" in table:
        raise SceneError(reader.file, "task.goal_pose has both rpy_rad and quaternion_xyzw", "give one of them")
    if "rpy_rad" in table:
        return rpy_to_matrix(reader.numbers(table, "task.goal_pose.rpy_rad", 3))
    if "quaternion_xyzw" not in table:
        return None
    given = reader.numbers(table, "task.goal_pose.quaternion_xyzw", 4)
    length = float(np.linalg.norm(given))
    if abs(length - 1.0) > ROUNDED:
        what = f"task.goal_pose.quaternion_xyzw has length {length:.3g}, not 1"
        raise SceneError(reader.file, what, "give x, y, z, w of a unit quaternion")
    x, y, z, w = given / length
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
