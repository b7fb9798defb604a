"""Exact signed distances, witness points, gradients and batch checks of a scene's shapes, by Coal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, Int
from ident.robot.arm import ArmModel
from plan.geometry.boxes import Box
from plan.geometry.placement import slopes_of_points

THREADS = 2
# Coal's own default of 1e-6 leaves noise of 0.1 µm in distances, which spoils their derivatives.
TOLERANCE = 1e-10


@dataclass(frozen=True)
class Witness:
    """Nearest points of one pair of shapes.

    Attributes:
        distance: Signed distance [m].
        first, second: Nearest points, or deepest ones, of the two shapes in the base frame [m].
        normal: Unit vector along which the second shape leaves the first.
        parts: The convex parts on which these points lie.
    """

    distance: float
    first: Float[Array, " 3"]
    second: Float[Array, " 3"]
    normal: Float[Array, " 3"]
    parts: tuple[Box, Box]


class Proximity:
    """Coal's view of a scene, every shape by its convex parts. Holds Coal's buffers: for one thread at a time."""

    def __init__(self, arm: ArmModel, boxes: Sequence[Box], pairs: Array) -> None:
        self._model, self._chain, self._pairs = arm.model, arm.chain, pairs
        self._parts = [part for box in boxes for part in box.parts]
        own = np.cumsum([0, *(len(box.parts) for box in boxes)])
        # Each pair of shapes is as many pairs of parts, which follow each other.
        self._counts = [len(boxes[a].parts) * len(boxes[b].parts) for a, b in pairs]
        self._first, self._owner = np.cumsum([0, *self._counts])[:-1], np.repeat(np.arange(len(pairs)), self._counts)
        ranges = [(range(own[a], own[a + 1]), range(own[b], own[b + 1])) for a, b in pairs]
        both = [(i, k) for first, second in ranges for i in first for k in second]
        self._sides = np.array(both, dtype=np.int64).reshape(-1, 2)
        self._geometry = _geometry_model(self._parts, self._sides)
        self._shapes = [shape.geometry for shape in self._geometry.geometryObjects]
        self._data = self._model.createData()
        self._geometry_data = self._geometry.createData()
        self._request = coal.DistanceRequest()
        for request in (self._request, *self._geometry_data.distanceRequests):
            request.enable_signed_distance = True
            request.gjk_tolerance = TOLERANCE
            request.gjk_max_iterations = 500
        self._pool: pin.GeometryPool | None = None
        self._radius = np.array([part.solid.radius for part in self._parts])
        self._joints = np.array([box.joint for box in boxes], dtype=np.int64)
        self._half = np.array([part.half for part in self._parts]).reshape(-1, 3)
        # Coal knows the points of a cloud; their radius is taken off the distances of its pairs.
        grown = np.array([box.solid.grown for box in boxes])
        self._grown = grown[pairs[:, 0]][self._owner]

    @property
    def geometry(self) -> pin.GeometryModel:
        """The parts and their pairs as a Pinocchio geometry model."""
        return self._geometry

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Signed distance of every pair at one position [m]."""
        pin.computeDistances(self._model, self._data, self._geometry, self._geometry_data, np.asarray(q, dtype=float))
        found = np.array([result.min_distance for result in self._geometry_data.distanceResults]) - self._grown
        return self._least(found)

    def _least(self, found: Float[Array, " e"]) -> Float[Array, " P"]:
        """Smallest distance of each pair's parts [m]."""
        return np.asarray(np.minimum.reduceat(found, self._first)) if len(self._pairs) else np.empty(0)

    def _bounds(self, which: Int[Array, " m"]) -> Float[Array, " m"]:
        """Lower bounds of the distances of pairs of parts [m]: the ball round the second from the first one's box."""
        used, place = np.unique(self._sides[which], return_inverse=True)
        places = [self._geometry_data.oMg[int(i)] for i in used]
        rotation = np.array([one.rotation for one in places]).reshape(-1, 3, 3)
        centre = np.array([one.translation for one in places]).reshape(-1, 3)
        a, b = place.reshape(-1, 2).T
        first, second = self._sides[which].T
        local = np.einsum("pji,pj->pi", rotation[a], centre[b] - centre[a])
        outside = np.maximum(np.abs(local) - self._half[first], 0.0)
        return np.linalg.norm(outside, axis=1) - self._radius[second]

    def near_distances(
        self, q: Float[Array, " n"], beyond: float | Array, known: Float[Array, " P"] | None = None
    ) -> Float[Array, " P"]:
        """Signed distance of the pairs that may be nearer than a given distance, a lower bound of the others' [m].

        Args:
            q: Position [rad].
            beyond: That distance, for all pairs or for each [m].
            known: Lower bounds that are known from elsewhere [m].
        """
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._geometry_data, np.asarray(q, dtype=float)
        )
        far = np.broadcast_to(np.asarray(beyond), len(self._pairs))[self._owner]
        found = self._bounds(np.arange(len(self._sides)))
        if known is not None:
            found = np.maximum(found, known[self._owner])
        for which in np.flatnonzero(found < far):
            pin.computeDistance(self._geometry, self._geometry_data, int(which))
            found[which] = self._geometry_data.distanceResults[int(which)].min_distance - self._grown[which]
        return self._least(found)

    def clearance(self, q: Float[Array, " n"]) -> float:
        """Smallest signed distance at one position [m]; a metre where there is nothing to hit."""
        return float(min(self.distances(q), default=1.0))

    def witness(self, q: Float[Array, " n"], pair: int, piece: Box | None = None) -> Witness:
        """Nearest points of one pair at one position.

        Args:
            q: Position [rad].
            pair: Number of the pair.
            piece: The piece in place of the pair's first shape, if that has pieces.
        """
        pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, q)
        return self._witness(pair, piece)

    def gradients(
        self, q: Float[Array, "m n"], pairs: Int[Array, " m"], pieces: Sequence[Box | None]
    ) -> Float[Array, "m n"]:
        """Derivatives of some pairs' signed distances by the joints [m/rad], each at its own position.

        The distance along the normal n from the first shape to the second changes by nᵀ(J₂ − J₁), each Jacobian taken
        at its witness point.
        """
        points, normals = np.zeros((len(q), 2, 3)), np.zeros((len(q), 3))
        q = np.ascontiguousarray(q, dtype=float)
        moved = np.append(True, np.any(q[1:] != q[:-1], axis=1))
        for row, (pair, piece) in enumerate(zip(pairs, pieces, strict=True)):
            if moved[row]:
                pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, q[row])
            found = self._witness(int(pair), piece)
            points[row], normals[row] = (found.first, found.second), found.normal
        joints = self._joints[self._pairs[np.asarray(pairs, dtype=np.int64)]]
        return np.asarray(slopes_of_points(self._chain, q, joints, points, normals))

    def _witness(self, pair: int, piece: Box | None) -> Witness:
        """Of the nearest two parts of a pair; where the arm is stands in the data."""
        both = self._first[pair] + np.arange(self._counts[pair])
        bounds = self._bounds(both) if len(both) > 1 and piece is None else np.full(len(both), -np.inf)
        best, nearest = coal.DistanceResult(), -1
        for k in np.argsort(bounds):
            if nearest >= 0 and bounds[k] > best.min_distance:
                break
            found = self._distance(int(both[k]), piece)
            if nearest < 0 or found.min_distance < best.min_distance:
                best, nearest = found, int(both[k])
        points = np.array(best.getNearestPoint1()), np.array(best.getNearestPoint2())
        first, second = (self._parts[int(side)] for side in self._sides[nearest])
        return Witness(float(best.min_distance), *points, np.array(best.normal), (piece or first, second))

    def _distance(self, which: int, piece: Box | None) -> coal.DistanceResult:
        """Of a pair of parts; the first of them replaced by a piece, if there is one."""
        if piece is None:
            pin.computeDistance(self._geometry, self._geometry_data, which)
            return self._geometry_data.distanceResults[which]
        second, result = int(self._sides[which][1]), coal.DistanceResult()
        place = self._geometry_data.oMg[second]
        sides = (piece.solid.for_coal(), coal.Transform3s(np.array(piece.rotation), np.array(piece.centre)))
        there = coal.Transform3s(place.rotation, place.translation)
        coal.distance(*sides, self._shapes[second], there, self._request, result)
        return result

    def collides(self, q: Float[Array, "T n"]) -> Bool[Array, " T"]:
        """Whether any pair overlaps, for a batch of positions at once."""
        if len(self._pairs) == 0:
            return np.zeros(len(q), dtype=bool)
        if self._grown.any():
            return np.array([bool(self.distances(row).min() < 0.0) for row in q])
        if self._pool is None:
            self._pool = pin.GeometryPool(self._model, self._geometry, THREADS)
        columns = np.asfortranarray(np.asarray(q, dtype=float).T)
        return np.asarray(pin.computeCollisionsInParallel(THREADS, self._pool, columns, True)).reshape(-1) > 0


def _geometry_model(boxes: Sequence[Box], pairs: Array) -> pin.GeometryModel:
    geometry = pin.GeometryModel()
    for i, box in enumerate(boxes):
        placement = pin.SE3(np.array(box.rotation), np.array(box.centre))
        geometry.addGeometryObject(pin.GeometryObject(f"{i}:{box.name}", box.joint, placement, box.solid.for_coal()))
    for a, b in pairs:
        geometry.addCollisionPair(pin.CollisionPair(int(a), int(b)))
    return geometry
