"""Poses of a scene file: where a frame is to be, in place of the joints' angles."""

from __future__ import annotations

from ident.arrays import freeze
from plan.problem.rules import Pose
from plan.problem.scene_keys import KEYS, SceneTable

# The table whose keys a pose has, wherever it stands.
POSE_TABLE = "task.goal_pose"


def read_poses(table: SceneTable, key: str) -> list[Pose]:
    """The pose under a key, or the poses of which any will do.

    None where the key is left out.

    Raises:
        InputError: A key is missing, unknown or of the wrong kind.
    """
    entries = table.entry.get(key, [])
    if not isinstance(entries, list):
        entries = [entries]
    poses = []
    for entry in entries:
        pose = SceneTable(table.file, table.path(key), entry, KEYS[POSE_TABLE])
        rotation = pose["rpy_rad"] if "rpy_rad" in pose else pose["quaternion_xyzw"]
        poses.append(Pose(pose["frame"], freeze(pose["xyz_m"]), rotation))
    return poses
