"""The arm as boxes: one transform a link, its collision geometry's bounding boxes fixed to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class LinkBoxes:
    """The boxes of one link, in its frame.

    Attributes:
        link: Name of the link.
        centres: Centres [m].
        half_sizes: Half edge lengths [m].
        rotations: Orientations as quaternions (x, y, z, w).
    """

    link: str
    centres: Float[np.ndarray, "b 3"]
    half_sizes: Float[np.ndarray, "b 3"]
    rotations: Float[np.ndarray, "b 4"]


def link_boxes(arm: ArmModel) -> tuple[LinkBoxes, ...]:
    """Bounding boxes of the collision geometry, link by link; none where its meshes are not there.

    Boxes are shown as they are; cylinders, spheres and meshes by the box around them.
    """
    try:
        objects = arm.geometry.geometryObjects
    except RobotError:
        return ()
    found: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
    for body in objects:
        frame = arm.model.frames[body.parentFrame]
        body.geometry.computeLocalAABB()
        box = body.geometry.aabb_local
        # Placements are given from the joint, poses are known of the link.
        pose = np.linalg.inv(frame.placement.homogeneous) @ body.placement.homogeneous
        pose[:3, 3] += pose[:3, :3] @ ((box.min_ + box.max_) / 2)
        found.setdefault(frame.name, []).append((pose, (box.max_ - box.min_) / 2))
    return tuple(
        LinkBoxes(
            link,
            np.array([pose[:3, 3] for pose, _ in boxes]),
            np.array([half for _, half in boxes]),
            Rotation.from_matrix(np.array([pose[:3, :3] for pose, _ in boxes])).as_quat(),
        )
        for link, boxes in found.items()
    )


def link_poses(
    arm: ArmModel, q: Float[np.ndarray, "T n"], links: tuple[str, ...]
) -> dict[str, tuple[Float[np.ndarray, "T 3"], Float[np.ndarray, "T 4"]]]:
    """Position [m] and quaternion (x, y, z, w) of links in the base frame over time."""
    poses = arm.link_poses(q, links)
    return {link: (place, Rotation.from_matrix(turn).as_quat()) for link, (turn, place) in poses.items()}


def arm_reach(arm: ArmModel) -> float:
    """Length of the chain of link frames [m]: the arm stays within this distance of its base."""
    poses = list(arm.forward_kinematics(arm.neutral).values())
    places = np.array([pose[:3, 3] for pose in poses])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())
