"""Exact signed distances and their gradients of a scene's shapes, by Coal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import coal
import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, Int
from ident.robot.arm import ArmModel
from plan.dynamics.rigid import slopes_of_points
from plan.geometry.solids import Box

# Coal's own default of 1e-6 leaves noise of 0.1 µm in distances, which spoils their derivatives.
TOLERANCE = 1e-10


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
        self._geometry = pin.GeometryModel()
        for i, part in enumerate(self._parts):
            placement = pin.SE3(np.array(part.rotation), np.array(part.centre))
            shape = pin.GeometryObject(f"{i}:{part.name}", part.joint, placement, part.solid.for_coal())
            self._geometry.addGeometryObject(shape)
        for a, b in self._sides:
            self._geometry.addCollisionPair(pin.CollisionPair(int(a), int(b)))
        self._data = self._model.createData()
        self._geometry_data = self._geometry.createData()
        self._request = coal.DistanceRequest()
        for request in (self._request, *self._geometry_data.distanceRequests):
            request.enable_signed_distance = True
            request.gjk_tolerance = TOLERANCE
            request.gjk_max_iterations = 500
        self._radius = np.array([part.solid.radius for part in self._parts])
        self._joints = np.array([box.joint for box in boxes], dtype=np.int64)
        self._half = np.array([part.half for part in self._parts]).reshape(-1, 3)
        # Coal knows the points of a cloud; their radius is taken off the distances of its pairs.
        grown = np.array([box.solid.grown for box in boxes])
        self._grown = grown[pairs[:, 0]][self._owner]

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
        self, q: Float[Array, " n"], beyond: Float[Array, " P"], known: Float[Array, " P"]
    ) -> Float[Array, " P"]:
        """Signed distance of the pairs that may be nearer than a given distance, a lower bound of the others' [m].

        Args:
            q: Position [rad].
            beyond: That distance, for each pair [m].
            known: Lower bounds that are known from elsewhere [m].
        """
        pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._geometry_data, np.asarray(q, dtype=float)
        )
        found = np.maximum(self._bounds(np.arange(len(self._sides))), known[self._owner])
        for which in np.flatnonzero(found < beyond[self._owner]):
            pin.computeDistance(self._geometry, self._geometry_data, int(which))
            found[which] = self._geometry_data.distanceResults[int(which)].min_distance - self._grown[which]
        return self._least(found)

    def gradients(
        self, q: Float[Array, "m n"], pairs: Int[Array, " m"], pieces: Mapping[int, Box]
    ) -> Float[Array, "m n"]:
        """Derivatives of some pairs' signed distances by the joints [m/rad], each at its own position.

        The distance along the normal n from the first shape to the second changes by nᵀ(J₂ − J₁), each Jacobian taken
        at its witness point.

        Args:
            q: Position for each pair [rad].
            pairs: The pairs.
            pieces: Of a shape of many bodies the nearest, by the pair's place in `pairs`: it is looked at in its place.
        """
        points, normals = np.zeros((len(q), 2, 3)), np.zeros((len(q), 3))
        q = np.ascontiguousarray(q, dtype=float)
        moved = np.append(True, np.any(q[1:] != q[:-1], axis=1))
        for row, pair in enumerate(pairs):
            if moved[row]:
                pin.updateGeometryPlacements(self._model, self._data, self._geometry, self._geometry_data, q[row])
            found = self._nearest(int(pair), pieces.get(row))
            points[row] = found.getNearestPoint1(), found.getNearestPoint2()
            normals[row] = found.normal
        joints = self._joints[self._pairs[np.asarray(pairs, dtype=np.int64)]]
        return np.asarray(slopes_of_points(self._chain, q, joints, points, normals))

    def _nearest(self, pair: int, piece: Box | None) -> coal.DistanceResult:
        """Nearest points of a pair's nearest two parts, or of a piece and its second shape, where the arm is now."""
        both = self._first[pair] + np.arange(self._counts[pair])
        bounds = self._bounds(both) if len(both) > 1 and piece is None else np.full(len(both), -np.inf)
        best = None
        for k in np.argsort(bounds):
            if best is not None and bounds[k] > best.min_distance:
                break
            found = self._distance(int(both[k]), piece)
            if best is None or found.min_distance < best.min_distance:
                best = found
        return best

    def _distance(self, which: int, piece: Box | None) -> coal.DistanceResult:
        """Of a pair of parts; the first of them replaced by a piece, if there is one."""
        if piece is None:
            pin.computeDistance(self._geometry, self._geometry_data, which)
            return self._geometry_data.distanceResults[which]
        second, result = int(self._sides[which][1]), coal.DistanceResult()
        place = self._geometry_data.oMg[second]
        sides = (piece.solid.for_coal(), coal.Transform3s(np.array(piece.rotation), np.array(piece.centre)))
        there = coal.Transform3s(place.rotation, place.translation)
        coal.distance(*sides, self._geometry.geometryObjects[second].geometry, there, self._request, result)
        return result
