"""Shapes of the arm's links and of obstacles: what each is exactly, and the box around it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import coal
import numpy as np

from ident.arrays import Array, Float, Int, freeze

Kind = Literal["box", "sphere", "capsule", "cylinder", "hull", "surface", "cloud"]
NO_TRIANGLES = np.empty((0, 3), dtype=np.int64)
# Corners of a cube of edge length 2 about its middle.
CORNERS = freeze(np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, 8).T)
# Thickness of points in a plane, to either side [m].
THICKNESS = 1e-6


@dataclass(frozen=True, eq=False)
class Solid:
    """A shape in the axes of its box, about the box's centre."""

    kind: Kind  # what it is
    # Half edge lengths of a box; radius of a sphere; radius and half length (along z) of a capsule,
    # whose half length leaves its caps out, and of a cylinder; radius of a cloud's balls; empty for
    # the others [m].
    size: Float[Array, " s"]
    points: Float[Array, "k 3"]  # corners of a hull or a surface, middles of a cloud's balls [m]
    # Corners of each triangle of a surface, by number, seen from outside against the clock.
    triangles: Int[Array, "m 3"]
    note: str = ""  # what of the file that it comes from was made coarser; empty for nothing
    # Corners of the convex bodies of which a hull is the hull, if it is not one itself [m].
    parts: tuple[Float[Array, "p 3"], ...] = ()

    @classmethod
    def simple(cls, kind: Kind, *size: float) -> Solid:
        """A box, a sphere, a capsule or a cylinder, with `size` as its kind has it [m]."""
        return cls(kind, freeze(np.array(size)), np.empty((0, 3)), NO_TRIANGLES)

    @classmethod
    def hull(cls, points: Float[Array, "k 3"], parts: Sequence[Float[Array, "p 3"]] = ()) -> Solid:
        """The smallest convex body that holds some points.

        Flat sets are given a thickness of a micrometre.

        Args:
            points: Any points [m]; only corners of their hull are kept.
            parts: Corners of the convex parts that it stands for; empty if it is one by itself.
        """
        corners = freeze(hull_points(points))
        corners_of_parts = tuple(freeze(piece) for piece in parts)
        return cls("hull", np.empty(0), corners, NO_TRIANGLES, parts=corners_of_parts)

    @classmethod
    def surface(cls, points: Float[Array, "k 3"], triangles: Int[Array, "m 3"]) -> Solid:
        """A surface of triangles.

        Args:
            points: Corners [m].
            triangles: Three numbers of points each.
        """
        numbers = np.array(triangles, dtype=np.int64)
        return cls("surface", np.empty(0), freeze(points), numbers)

    @classmethod
    def cloud(cls, points: Float[Array, "k 3"], radius: float, note: str = "") -> Solid:
        """Balls of one radius [m] about some points [m].

        Args:
            points: The balls' centres.
            radius: Of them all.
            note: By how much this is larger than what it stands for, in words; "" if it isn't.
        """
        return cls("cloud", freeze(np.array([radius])), freeze(points), NO_TRIANGLES, note)

    @property
    def grown(self) -> float:
        """By which the points that Coal knows have to be grown [m]."""
        return float(self.size[0]) if self.kind == "cloud" else 0.0

    @property
    def half(self) -> Float[Array, " 3"]:
        """Half edge lengths of the box around it [m]."""
        if self.kind == "box":
            return self.size
        if self.kind == "sphere":
            return np.full(3, self.size[0])
        if self.kind in ("capsule", "cylinder"):
            radius, length = self.size
            cap = radius if self.kind == "capsule" else 0.0
            return np.array([radius, radius, length + cap])
        return np.abs(self.points).max(axis=0) + self.grown

    @property
    def radius(self) -> float:
        """Radius of the ball about the box's centre that holds it [m]."""
        if self.kind in ("sphere", "capsule"):
            return float(self.size.sum())
        if self.kind == "cylinder":
            return math.hypot(*self.size)
        corners = self.half if self.kind == "box" else self.points
        return float(np.linalg.norm(corners, axis=-1).max()) + self.grown

    def for_coal(self) -> coal.CollisionGeometry:
        """The shape as Coal knows it.

        Of a cloud the points alone, as triangles that are no larger.
        """
        if self.kind == "box":
            return coal.Box(*(2.0 * self.size))
        if self.kind == "sphere":
            return coal.Sphere(float(self.size[0]))
        if self.kind in ("capsule", "cylinder"):
            radius, length = self.size
            make = coal.Capsule if self.kind == "capsule" else coal.Cylinder
            return make(float(radius), 2.0 * float(length))
        if self.kind == "hull":
            points = coal.StdVec_Vec3s()
            points.extend(np.array(point) for point in self.points)
            return coal.ConvexBase.convexHull(points, True, "Qt")
        triangles = self.triangles
        if self.kind == "cloud":
            triangles = np.repeat(np.arange(len(self.points))[:, None], 3, axis=1)
        model = coal.BVHModelOBBRSS()
        model.beginModel(len(triangles), len(self.points))
        model.addVertices(np.array(self.points))
        model.addTriangles(triangles.astype(np.int32))
        model.endModel()
        return model


def hull_points(points: Float[Array, "k 3"]) -> Float[Array, "m 3"]:
    """Corners of the convex hull of some points.

    Of points in a plane, those of the plane grown by a micrometre.
    """
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and boxes need none of it

    points = np.asarray(points, dtype=float)
    try:
        return points[ConvexHull(points).vertices]
    except (QhullError, ValueError):
        thick = THICKNESS * CORNERS
        grown = (points[:, None] + thick).reshape(-1, 3)
        return grown[ConvexHull(grown).vertices]


def mesh_triangles(model: coal.BVHModelBase) -> Int[Array, "m 3"]:
    """Corners of a mesh's triangles, by number."""
    corners = []
    for number in range(model.num_tris):
        triangle = model.tri_indices(number)
        corners.append((triangle[0], triangle[1], triangle[2]))
    return np.array(corners, dtype=np.int64).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class Box:
    """A shape fixed to a joint of the arm, or to the world, by the box around it."""

    name: str  # name of the link or obstacle
    joint: int  # number of the joint that carries it, 1 to n; 0 for the world
    rotation: Float[Array, "3 3"]  # its axes in the joint frame
    centre: Float[Array, " 3"]  # its centre in the joint frame [m]
    solid: Solid  # what it is exactly; of a box its half edge lengths may be given [m]
    body: int = -1  # order of its link along the arm; -1 for an obstacle

    def __post_init__(self) -> None:
        for field in ("rotation", "centre"):
            values = np.asarray(getattr(self, field), dtype=float)
            object.__setattr__(self, field, freeze(values))
        if not isinstance(self.solid, Solid):
            object.__setattr__(self, "solid", Solid.simple("box", *self.solid))

    @cached_property
    def half(self) -> Float[Array, " 3"]:
        """Half edge lengths [m]."""
        return freeze(self.solid.half)

    @classmethod
    def around_parts(
        cls,
        name: str,
        parts: Sequence[Float[Array, "k 3"]],
        joint: int,
        rotation: Array,
        centre: Array,
        body: int,
    ) -> Box:
        """Convex parts by their corners.

        These are given in axes of their own, placed in the joint frame like the other arguments.
        """
        points = np.concatenate(parts)
        middle = (points.min(axis=0) + points.max(axis=0)) / 2
        pieces = []
        if len(parts) > 1:
            pieces = [piece - middle for piece in parts]
        solid = Solid.hull(points - middle, pieces)
        return cls(name, joint, rotation, centre + rotation @ middle, solid, body)

    @cached_property
    def parts(self) -> tuple[Box, ...]:
        """Its convex parts, each a shape by itself; itself alone if it has none."""
        if not self.solid.parts:
            return (self,)
        pieces = []
        for corners in self.solid.parts:
            piece = Box.around_parts(
                self.name, [corners], self.joint, self.rotation, self.centre, self.body
            )
            pieces.append(piece)
        return tuple(pieces)

    @property
    def corners(self) -> Float[Array, "8 3"]:
        """Corners in the joint frame [m]."""
        return self.centre + (CORNERS * self.half) @ self.rotation.T

    @property
    def farthest(self) -> float:
        """Farthest that a point of it can be from the joint frame's origin [m]."""
        ball = float(np.linalg.norm(self.centre)) + self.solid.radius
        corner = float(np.linalg.norm(self.corners, axis=1).max())
        return min(ball, corner)
