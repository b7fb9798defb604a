"""Oriented boxes: of the arm's links, from its collision geometry, and of obstacles."""

from __future__ import annotations

from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel


@dataclass(frozen=True, eq=False)
class Box:
    """A box fixed to a joint of the arm, or to the world.

    Attributes:
        name: Name of the link or obstacle.
        joint: Number of the joint that carries it, 1 to n; 0 for the world.
        rotation: Its axes in the joint frame.
        centre: Its centre in the joint frame [m].
        half: Half edge lengths [m].
        body: Order of its link along the arm; -1 for an obstacle.
    """

    name: str
    joint: int
    rotation: Float[Array, "3 3"]
    centre: Float[Array, " 3"]
    half: Float[Array, " 3"]
    body: int = -1

    def __post_init__(self) -> None:
        for field in ("rotation", "centre", "half"):
            object.__setattr__(self, field, freeze(np.asarray(getattr(self, field), dtype=float)))

    @property
    def corners(self) -> Float[Array, "8 3"]:
        """Corners in the joint frame [m]."""
        signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        return self.centre + (signs * self.half) @ self.rotation.T


def link_boxes(arm: ArmModel) -> list[Box]:
    """One box a collision shape of the arm; a shape that is no box gets the box along its own axes.

    Shapes that one link has several of (a hand's parts) are kept apart: a common box would be far too large.
    """
    bodies = _geometry_bodies(arm)
    boxes = []
    for shape in arm.geometry.geometryObjects:
        half, middle = _enclosing(shape)
        centre = shape.placement.translation + shape.placement.rotation @ middle
        body = bodies.index(shape.parentFrame)
        boxes.append(
            Box(_link_name(arm, shape), shape.parentJoint, shape.placement.rotation.copy(), centre, half, body)
        )
    return boxes


def _geometry_bodies(arm: ArmModel) -> list[int]:
    """Frames of the links that have a shape, base to tip: Pinocchio lists frames in that order."""
    return sorted({shape.parentFrame for shape in arm.geometry.geometryObjects})


def _link_name(arm: ArmModel, shape: pin.GeometryObject) -> str:
    return str(arm.model.frames[shape.parentFrame].name)


def _enclosing(shape: pin.GeometryObject) -> tuple[Array, Array]:
    """Half lengths and middle of the box around a shape, in the shape's axes [m]."""
    geometry = shape.geometry
    if isinstance(geometry, coal.Box):
        return np.array(geometry.halfSide), np.zeros(3)
    geometry.computeLocalAABB()
    low, high = np.array(geometry.aabb_local.min_), np.array(geometry.aabb_local.max_)
    return (high - low) / 2, (high + low) / 2
