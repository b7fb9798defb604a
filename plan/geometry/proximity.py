"""Exact signed distances, witness points, gradients and batch checks of a scene's shapes, by Coal."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, Int
from ident.robot.arm import ArmModel
from plan.dynamics.chain import Chain
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
    """

    distance: float
    first: Float[Array, " 3"]
    second: Float[Array, " 3"]
    normal: Float[Array, " 3"]


class Proximity:
    """Coal's view of a scene. Holds Coal's buffers, so one thread at a time may use it."""

    def __init__(self, arm: ArmModel, boxes: Sequence[Box], pairs: Array) -> None:
        self._model, self._chain = arm.model, Chain.from_arm(arm)
        self._boxes, self._pairs = tuple(boxes), pairs
        self._geometry = _geometry_model(boxes, pairs)
        self._shapes = [shape.geometry for shape in self._geometry.geometryObjects]
        self._data = self._model.createData()
        self._geometry_data = self._geometry.createData()
        self._request = coal.DistanceRequest()
        for request in (self._request, *self._geometry_data.distanceRequests):
            request.enable_signed_distance = True
            request.gjk_tolerance = TOLERANCE
            request.gjk_max_iterations = 500
        self._pool: pin.GeometryPool | None = None
        self._radius = np.array([box.solid.radius for box in self._boxes])
        self._joints = np.array([box.joint for box in self._boxes], dtype=np.int64)
        self._half = np.array([box.half for box in self._boxes]).reshape(-1, 3)
        # Coal knows the points of a cloud; their radius is taken off the distances of its pairs.
        grown = np.array([box.solid.grown for box in self._boxes])
        self._grown = grown[pairs[:, 0]]

    @property
    def geometry(self) -> pin.GeometryModel:
        """The shapes and pairs as a Pinocchio geometry model."""
        return self._geometry

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Signed distance of every pair at one position [m]."""
        pin.computeDistances(self._model, self._data, self._geometry, self._geometry_data, np.asarray(q, dtype=float))
        return np.array([result.min_distance for result in self._geometry_data.distanceResults]) - self._grown

    def bounds(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Lower bounds of the distances [m]: of the ball round the second shape of a pair from the first one's box."""
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._geometry_data, np.asarray(q, dtype=float)
        )
        places = [self._geometry_data.oMg[i] for i in range(len(self._boxes))]
        rotation = np.array([place.rotation for place in places]).reshape(-1, 3, 3)
        centre = np.array([place.translation for place in places]).reshape(-1, 3)
        first, second = self._pairs.T
        local = np.einsum("pji,pj->pi", rotation[first], centre[second] - centre[first])
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
        found = self.bounds(q)
        if known is not None:
            found = np.maximum(found, known)
        for pair in np.flatnonzero(found < beyond):
            pin.computeDistance(self._geometry, self._geometry_data, int(pair))
            found[pair] = self._geometry_data.distanceResults[int(pair)].min_distance - self._grown[pair]
        return found

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
        pin.forwardKinematics(self._model, self._data, np.asarray(q, dtype=float))
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
            if piece is not None:
                found = self._witness(int(pair), piece)
                points[row], normals[row] = (found.first, found.second), found.normal
                continue
            pin.computeDistance(self._geometry, self._geometry_data, int(pair))
            result = self._geometry_data.distanceResults[int(pair)]
            points[row, 0], points[row, 1] = result.getNearestPoint1(), result.getNearestPoint2()
            normals[row] = result.normal
        joints = self._joints[self._pairs[np.asarray(pairs, dtype=np.int64)]]
        return np.asarray(slopes_of_points(self._chain.kinematics, q, joints, points, normals))

    def _witness(self, pair: int, piece: Box | None) -> Witness:
        """Of two shapes alone, so that the others cost nothing; where the arm is stands in the data."""
        first, second = (self._boxes[i] for i in self._pairs[pair])
        result = coal.DistanceResult()
        sides = [*self._placed(piece or first, piece is None, pair, 0), *self._placed(second, True, pair, 1)]
        coal.distance(*sides, self._request, result)
        points = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        return Witness(float(result.min_distance), *points, np.array(result.normal))

    def _placed(self, box: Box, whole: bool, pair: int, side: int) -> tuple[coal.CollisionGeometry, coal.Transform3s]:
        """A shape as Coal knows it, and its place in the base frame."""
        shape = self._shapes[int(self._pairs[pair][side])] if whole else box.solid.for_coal()
        if box.joint == 0:
            return shape, coal.Transform3s(np.array(box.rotation), np.array(box.centre))
        joint = self._data.oMi[box.joint]
        turn = joint.rotation
        return shape, coal.Transform3s(turn @ box.rotation, turn @ box.centre + joint.translation)

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
