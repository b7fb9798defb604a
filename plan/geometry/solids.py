"""What a shape is exactly, beside the box around it: a ball, a rod, a hull, a surface of triangles."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import coal
import numpy as np

from ident.arrays import Array, Float, Int, freeze

Kind = Literal["box", "sphere", "capsule", "cylinder", "hull", "surface"]


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape in the axes of its box, about the box's centre.

    Attributes:
        kind: What it is.
        size: Half edge lengths of a box; radius of a sphere; radius and half length (along z) of a capsule, whose
            half length leaves its caps out, and of a cylinder; empty for the others [m].
        points: Corners of a hull or a surface [m].
        triangles: Corners of each triangle of a surface, by number.
    """

    kind: Kind
    size: Float[Array, " s"]
    points: Float[Array, "k 3"]
    triangles: Int[Array, "m 3"]

    @classmethod
    def simple(cls, kind: Kind, *size: float) -> Solid:
        """A box, a sphere, a capsule or a cylinder."""
        return cls(kind, freeze(np.array(size)), np.empty((0, 3)), np.empty((0, 3), dtype=np.int64))

    @classmethod
    def hull(cls, points: Float[Array, "k 3"]) -> Solid:
        """The smallest convex body that holds some points; flat sets are given a thickness of a micrometre."""
        return cls("hull", np.empty(0), freeze(hull_points(points)), np.empty((0, 3), dtype=np.int64))

    @classmethod
    def surface(cls, points: Float[Array, "k 3"], triangles: Int[Array, "m 3"]) -> Solid:
        """A surface of triangles."""
        return cls("surface", np.empty(0), freeze(points), np.array(triangles, dtype=np.int64))

    @property
    def half(self) -> Float[Array, " 3"]:
        """Half edge lengths of the box around it [m]."""
        if self.kind == "box":
            return self.size
        if self.kind == "sphere":
            return np.full(3, self.size[0])
        if self.kind in ("capsule", "cylinder"):
            radius, length = self.size
            return np.array([radius, radius, length + (radius if self.kind == "capsule" else 0.0)])
        return np.abs(self.points).max(axis=0)

    @property
    def radius(self) -> float:
        """Radius of the ball about the box's centre that holds it [m]."""
        if self.kind in ("sphere", "capsule"):
            return float(self.size.sum())
        if self.kind == "cylinder":
            return math.hypot(*self.size)
        return float(np.linalg.norm(self.half if self.kind == "box" else self.points, axis=-1).max())

    def reach(self, direction: Float[Array, " 3"]) -> float:
        """How far it extends along a unit vector from its centre [m]."""
        if self.kind == "box":
            return float(np.abs(direction) @ self.size)
        if self.kind == "sphere":
            return float(self.size[0])
        if self.kind == "capsule":
            return float(self.size[0] + self.size[1] * abs(direction[2]))
        if self.kind == "cylinder":
            return float(self.size[0] * math.hypot(*direction[:2]) + self.size[1] * abs(direction[2]))
        return float((self.points @ direction).max())

    def for_coal(self) -> coal.CollisionGeometry:
        """The shape as Coal knows it."""
        if self.kind == "box":
            return coal.Box(*(2.0 * self.size))
        if self.kind == "sphere":
            return coal.Sphere(float(self.size[0]))
        if self.kind in ("capsule", "cylinder"):
            make = coal.Capsule if self.kind == "capsule" else coal.Cylinder
            return make(float(self.size[0]), 2.0 * float(self.size[1]))
        if self.kind == "hull":
            return coal.ConvexBase.convexHull(_vector(self.points), True, "Qt")
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(self.triangles), len(self.points))
        model.addVertices(np.array(self.points))
        model.addTriangles(self.triangles.astype(np.int32))
        model.endModel()
        return model


def hull_points(points: Float[Array, "k 3"]) -> Float[Array, "m 3"]:
    """Corners of the convex hull of some points; of points in a plane, those of the plane grown by a micrometre."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and boxes need none of it

    points = np.asarray(points, dtype=float)
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        thick = 1e-6 * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T
        grown = (points[:, None] + thick).reshape(-1, 3)
        return grown[ConvexHull(grown).vertices]


def _vector(points: Float[Array, "k 3"]) -> coal.StdVec_Vec3s:
    out = coal.StdVec_Vec3s()
    for point in points:
        out.append(np.array(point))
    return out
