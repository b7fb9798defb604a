"""Exact signed distances and their gradients of a scene's shapes, by Coal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, Int
from ident.robot.arm import ArmModel
from plan.dynamics.rigid import joint_rows, slopes_of_points
from plan.geometry.solids import Box

# Coal's own default of 1e-6 leaves noise of 0.1 µm in distances, which spoils their derivatives.
TOLERANCE = 1e-10
# Steps of Coal's search for nearest points, at most.
ITERATIONS = 500


class Proximity:
    """Coal's view of a scene, every shape by its convex parts.

    Holds Coal's buffers: for one thread at a time.
    """

    def __init__(self, arm: ArmModel, boxes: Sequence[Box], pairs: Array) -> None:
        self._model = arm.model
        self._rows = joint_rows(arm.chain)
        self._pairs = pairs
        self._parts = [piece for box in boxes for piece in box.parts]
        # Each pair of shapes is as many pairs of parts, which follow each other.
        self._counts = [len(boxes[a].parts) * len(boxes[b].parts) for a, b in pairs]
        self._first = np.cumsum([0, *self._counts])[:-1]
        self._owner = np.repeat(np.arange(len(pairs)), self._counts)
        self._sides = _pairs_of_parts(boxes, pairs)
        self._geometry = _coal_model(self._parts, self._sides)
        self._data = self._model.createData()
        self._geometry_data = self._geometry.createData()
        self._request = coal.DistanceRequest()
        for request in (self._request, *self._geometry_data.distanceRequests):
            request.enable_signed_distance = True
            request.gjk_tolerance = TOLERANCE
            request.gjk_max_iterations = ITERATIONS
        self._radius = np.array([piece.solid.radius for piece in self._parts])
        self._joints = np.array([box.joint for box in boxes], dtype=np.int64)
        self._half = np.array([piece.half for piece in self._parts]).reshape(-1, 3)
        # Coal knows the points of a cloud; their radius is taken off the distances of its pairs.
        grown = np.array([box.solid.grown for box in boxes])
        self._grown = grown[pairs[:, 0]][self._owner]

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Signed distance of every pair at one position [m]."""
        position = np.asarray(q, dtype=float)
        pin.computeDistances(self._model, self._data, self._geometry, self._geometry_data, position)
        results = self._geometry_data.distanceResults
        distances = np.array([result.min_distance for result in results])
        return self._least(distances - self._grown)

    def near_distances(
        self, q: Float[Array, " n"], beyond: Float[Array, " P"], known: Float[Array, " P"]
    ) -> Float[Array, " P"]:
        """Signed distance of the pairs that may be nearer than a given distance [m].

        Of the others a lower bound.

        Args:
            q: Position [rad].
            beyond: That distance, for each pair [m]; minus infinity where none is asked for.
            known: Lower bounds that are known from elsewhere [m].
        """
        self._place(np.asarray(q, dtype=float))
        asked = np.flatnonzero(beyond[self._owner] > -np.inf)
        distances = known[self._owner]
        distances[asked] = np.maximum(self._bounds(asked), distances[asked])
        for which in np.flatnonzero(distances < beyond[self._owner]):
            pin.computeDistance(self._geometry, self._geometry_data, int(which))
            result = self._geometry_data.distanceResults[int(which)]
            distances[which] = result.min_distance - self._grown[which]
        return self._least(distances)

    def gradients(
        self, q: Float[Array, "m n"], pairs: Int[Array, " m"], pieces: Mapping[int, Box]
    ) -> Float[Array, "m n"]:
        """Derivatives of some pairs' signed distances by the joints [m/rad].

        Each is taken at its own position. The distance along the normal n from the first shape to
        the second changes by nᵀ(J₂ − J₁), each Jacobian taken at its witness point.

        Args:
            q: Position for each pair [rad].
            pairs: The pairs.
            pieces: Of a shape of many bodies the nearest, by the pair's place in `pairs`: it is
                looked at in its place.
        """
        points = np.zeros((len(q), 2, 3))
        normals = np.zeros((len(q), 3))
        q = np.ascontiguousarray(q, dtype=float)
        moved = np.append(True, np.any(q[1:] != q[:-1], axis=1))
        for row, pair in enumerate(pairs):
            if moved[row]:
                self._place(q[row])
            nearest = self._nearest(int(pair), pieces.get(row))
            points[row, 0] = nearest.getNearestPoint1()
            points[row, 1] = nearest.getNearestPoint2()
            normals[row] = nearest.normal
        joints = self._joints[self._pairs[np.asarray(pairs, dtype=np.int64)]]
        return np.asarray(slopes_of_points(self._rows, q, joints, points, normals))

    def _place(self, q: Float[Array, " n"]) -> None:
        """Brings all shapes to where they are at a position."""
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._geometry_data, q
        )

    def _least(self, distances: Float[Array, " e"]) -> Float[Array, " P"]:
        """Smallest distance of each pair's parts [m]."""
        if len(self._pairs) == 0:
            return np.empty(0)
        return np.asarray(np.minimum.reduceat(distances, self._first))

    def _bounds(self, which: Int[Array, " m"]) -> Float[Array, " m"]:
        """Lower bounds of the distances of pairs of parts [m].

        They are those of the ball round the second from the first one's box.
        """
        used, place = np.unique(self._sides[which], return_inverse=True)
        placements = [self._geometry_data.oMg[int(number)] for number in used]
        rotations = np.array([placement.rotation for placement in placements]).reshape(-1, 3, 3)
        centres = np.array([placement.translation for placement in placements]).reshape(-1, 3)
        first_place, second_place = place.reshape(-1, 2).T
        first, second = self._sides[which].T
        away = centres[second_place] - centres[first_place]
        local = np.einsum("pji,pj->pi", rotations[first_place], away)
        outside = np.maximum(np.abs(local) - self._half[first], 0.0)
        return np.linalg.norm(outside, axis=1) - self._radius[second]

    def _nearest(self, pair: int, piece: Box | None) -> coal.DistanceResult:
        """Nearest points of a pair's nearest two parts where the arm is now.

        Or, if there is a piece, of that and the pair's second shape.
        """
        candidates = self._first[pair] + np.arange(self._counts[pair])
        bounds = np.full(len(candidates), -np.inf)
        if len(candidates) > 1 and piece is None:
            bounds = self._bounds(candidates)
        nearest = None
        for k in np.argsort(bounds):
            if nearest is not None and bounds[k] > nearest.min_distance:
                break
            result = self._distance(int(candidates[k]), piece)
            if nearest is None or result.min_distance < nearest.min_distance:
                nearest = result
        return nearest

    def _distance(self, which: int, piece: Box | None) -> coal.DistanceResult:
        """Of a pair of parts; the first of them replaced by a piece, if there is one."""
        if piece is None:
            pin.computeDistance(self._geometry, self._geometry_data, which)
            return self._geometry_data.distanceResults[which]
        second = int(self._sides[which][1])
        placement = self._geometry_data.oMg[second]
        there = coal.Transform3s(placement.rotation, placement.translation)
        here = coal.Transform3s(np.array(piece.rotation), np.array(piece.centre))
        shape = self._geometry.geometryObjects[second].geometry
        result = coal.DistanceResult()
        coal.distance(piece.solid.for_coal(), here, shape, there, self._request, result)
        return result


def _pairs_of_parts(boxes: Sequence[Box], pairs: Int[Array, "P 2"]) -> Int[Array, "e 2"]:
    """Numbers of the two parts of each pair of parts, pair of shapes by pair of shapes."""
    begin = np.cumsum([0, *(len(box.parts) for box in boxes)])
    sides = []
    for a, b in pairs:
        for first in range(begin[a], begin[a + 1]):
            sides += [(first, second) for second in range(begin[b], begin[b + 1])]
    return np.array(sides, dtype=np.int64).reshape(-1, 2)


def _coal_model(parts: Sequence[Box], sides: Int[Array, "e 2"]) -> pin.GeometryModel:
    """Convex parts and the pairs of them that are looked at, as Pinocchio hands them to Coal."""
    geometry = pin.GeometryModel()
    for number, box in enumerate(parts):
        placement = pin.SE3(np.array(box.rotation), np.array(box.centre))
        name = f"{number}:{box.name}"
        shape = pin.GeometryObject(name, box.joint, placement, box.solid.for_coal())
        geometry.addGeometryObject(shape)
    for first, second in sides:
        geometry.addCollisionPair(pin.CollisionPair(int(first), int(second)))
    return geometry
