"""The scene: the arm's shapes, the obstacles' shapes, and which pairs of them must stay apart."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.records import as_record
from ident.robot.arm import ArmModel
from ident.robot.chain import compute_joint_poses
from plan.dynamics.rigid import random_positions
from plan.geometry.arm_shapes import ArmShapes, arm_shapes
from plan.geometry.compiled import CompiledScene, compile_scene
from plan.geometry.obstacle_files import holds
from plan.geometry.pairs import FLOOR, OVERLAP, Unchecked, choose_pairs
from plan.geometry.proximity import Proximity
from plan.geometry.solids import Box, Solid
from plan.geometry.sweep import ALL, gaps_of_states, nearest_of_states, sweep
from plan.geometry.tool import Carried, place_carried
from plan.spline import Splines

# Compiled gaps fall short of the distance by some millimetres: so far beyond a target Coal is asked
# [m].
SHARP = 0.01
# Links with no more joints between them than this are beside one another.
BESIDE = 2
# The share of so many positions in which "hardly ever" is meant.
HARDLY = 0.95
DRAWN = 200
# The gap of links beside one another beyond which it does not matter [m].
WIDE = 0.1


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes of an arm and of obstacles."""

    arm: ArmModel
    boxes: tuple[Box, ...]  # links first, then obstacles
    # Numbers of the two shapes of each pair that is checked, the one nearer to the base first.
    pairs: Int[Array, "P 2"]
    # Pairs of links that can move against each other and are left out, each with the reason.
    unchecked: tuple[Unchecked, ...]
    shapes: ArmShapes  # where the links' shapes come from

    @classmethod
    def build(
        cls,
        arm: ArmModel,
        obstacles: Sequence[Box] = (),
        stand_in: str | None = None,
        carried: Sequence[Carried] = (),
        disabled: Mapping[frozenset[str], str] | None = None,
    ) -> Scene:
        """Sets up the pairs: link against link unless they are neighbours, and every link against
        every obstacle.

        Args:
            arm: The arm.
            obstacles: Shapes fixed to the world.
            stand_in: What stands in for links that the URDF gives no shape.
            carried: What the arm carries.
            disabled: Pairs of links to leave out, by name, with the reason.

        Raises:
            RobotError: A link has no shape and nothing stands in.
        """
        shapes = arm_shapes(arm, stand_in)
        links = place_carried(arm, shapes.boxes, carried)
        left_out = dict(disabled or {})
        for shape in carried:
            for name in shape.touches:
                left_out[frozenset((shape.box.name, name))] = "it may touch what is carried"
        chosen, unchecked = choose_pairs(arm, links, obstacles, left_out)
        pairs = np.array(chosen, dtype=np.int64).reshape(-1, 2)
        pairs.setflags(write=False)
        return cls(arm, (*links, *obstacles), pairs, unchecked, shapes)

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Shapes of the obstacles."""
        return tuple(box for box in self.boxes if box.body < 0)

    @property
    def coarser(self) -> tuple[str, ...]:
        """Obstacles that are larger here than in their files, because these hold too much.

        Returns:
            One line each, "NAME: by how much"; empty where all are as in their files.
        """
        noted = [box for box in self.obstacles if box.solid.note]
        return tuple(f"{box.name}: {box.solid.note}" for box in noted)

    @property
    def limits_of_proof(self) -> list[str]:
        """What a proof does not speak of, a line each.

        Shapes that stand in or hold more, pairs left out.
        """
        lines = []
        if self.shapes.issue is not None:
            lines.append(f"not the arm's own shape: {self.shapes.issue.evidence}")
        if self.shapes.coarser:
            lines.append(self.shapes.coarser)
        lines += [f"larger than its file says: {obstacle}" for obstacle in self.coarser]
        reasons: dict[str, list[str]] = {}
        for pair in self.unchecked:
            reasons.setdefault(pair.reason, []).append(" and ".join(pair.links))
        for reason, pairs in reasons.items():
            warning = "warning: " if reason == OVERLAP else ""
            lines.append(f"{warning}not checked ({reason}): {'; '.join(pairs)}")
        return lines

    def to_dict(self) -> dict[str, Any]:
        """Its record: pairs left out, stand-ins of links, and the convex parts of meshes.

        Returns:
            "unchecked_pairs", and what `ArmShapes.to_dict` gives.
        """
        return {"unchecked_pairs": as_record(self.unchecked), **self.shapes.to_dict()}

    @property
    def in_the_way(self) -> tuple[Box, ...]:
        """The obstacles that a way leads round: all but the floor, which has no sides."""
        return tuple(box for box in self.obstacles if box.name != FLOOR)

    def names_of(self, pair: int) -> tuple[str, str]:
        """Names of the two shapes of a pair, the one farther from the base first."""
        first, second = self.pairs[pair]
        return self.boxes[second].name, self.boxes[first].name

    def pair_name(self, pair: int) -> str:
        """The two shapes of a pair, in words."""
        return " and ".join(self.names_of(pair))

    # Compiled: gaps that are never above the distance, thousands of positions at a time.

    def gaps(
        self,
        q: Float[Array, "T n"],
        beyond: float = 1e9,
        wanted: Bool[Array, "T P"] | None = None,
        pairs: Int[Array, "P 2"] | None = None,
    ) -> Float[Array, "T P"]:
        """Signed separation of every pair [m].

        At most the distance, equal to it, or nearly, under 5 cm.

        Args:
            q: Positions [rad].
            beyond: Gap that may stand for any larger: far pairs then cost next to nothing [m].
            wanted: Which pairs to look at, position by position, if not all; `beyond` stands for
                the others.
            pairs: Other pairs than all that are checked.
        """
        if pairs is None:
            pairs = self.pairs
        if wanted is None:
            wanted = ALL
        if len(pairs) == 0:
            return np.empty((len(q), 0))
        # Read-only, whoever asks: loops are compiled anew for what may be written.
        q = freeze(np.ascontiguousarray(q, dtype=float))
        pairs = pairs.view()
        pairs.setflags(write=False)
        return np.asarray(gaps_of_states(self._world, pairs, q, beyond, wanted))

    def separation(
        self,
        q: Float[Array, "T n"],
        margins: Float[Array, " P"] | float = 0.0,
        most: float = 1.0,
    ) -> Float[Array, " T"]:
        """Smallest gap at each position beyond its pair's margin [m].

        `most` where nothing is nearer than that.

        Args:
            q: Joint positions [rad, of a slider m].
            margins: What each pair has to keep [m], or all of them.
            most: Gaps beyond the margin are looked at up to this [m].
        """
        beyond = most + float(np.max(margins, initial=0.0))
        clear = self.gaps(q, beyond) - margins
        return np.asarray(clear.min(axis=1, initial=most))

    def sweep(
        self, splines: Splines, margins: Float[Array, " P"] | float
    ) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
        """Smallest gap along each trajectory beyond its pair's margin, and the mean shortfall [m].

        Skips ahead where shapes are far apart; where a gap is at its margin, no step changes it by
        more than 2 mm.
        """
        if len(self.pairs) == 0:
            return np.ones(len(splines.points)), np.zeros(len(splines.points))
        between, moving, levers = self._swept
        # Of the pairs of links, then for each moving link the least of its pairs with the world.
        of_pairs = np.broadcast_to(margins, len(self.pairs))
        of_world = np.full(len(moving), np.inf)
        links = np.searchsorted(moving, self.pairs[~self.own, 1])
        np.minimum.at(of_world, links, of_pairs[~self.own])
        least = np.concatenate([of_pairs[self.own], of_world])
        motion = (splines.points, splines.slopes, splines.durations)
        swept = sweep(self._world, between, moving, levers, motion, least)
        return np.minimum(swept[:, 0], 1.0), swept[:, 1]

    # Exact: by Coal, one position at a time.

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Exact signed distance of every pair at a position [m].

        Negative inside a closed mesh too.
        """
        distances = self.proximity.distances(q)
        for pair in self._pieced:
            closed = self.boxes[self.pairs[pair, 0]].solid.kind == "surface"
            if closed and distances[pair] > 0.0 and self._engulfed(q, pair):
                distances[pair] = -distances[pair]
        return distances

    def near_distances(
        self, q: Float[Array, " n"], target: float | Array, near: float
    ) -> Float[Array, " P"]:
        """Exact signed distance of the pairs near a target, lower bounds of the others' [m].

        What has thousands of pieces takes Coal milliseconds. There the compiled gap, which is never
        above the distance, is looked at first, and Coal asked only where that comes close to the
        target.

        Args:
            q: Position [rad].
            target: Distance that is asked about, of all pairs or of each; minus infinity for those
                not of interest [m].
            near: How far beyond it exact distances are wanted [m].
        """
        known = np.full(len(self.pairs), -np.inf)
        beyond = np.zeros(len(self.pairs)) + target + near
        if len(self._pieced):
            farthest = float(np.max(beyond))
            gaps = self.gaps(q[None], farthest, None, self.pairs[self._pieced])
            known[self._pieced] = gaps[0]
            beyond[self._pieced] += min(near, SHARP) - near
        return self.proximity.near_distances(q, beyond, known)

    def gradients(self, q: Float[Array, "m n"], pairs: Int[Array, " m"]) -> Float[Array, "m n"]:
        """Derivatives of pairs' signed distances by the joints [m/rad].

        Args:
            q: One position for each of `pairs`.
            pairs: Numbers of the pairs; one may come more than once.
        """
        pieces: dict[int, Box] = {}
        rows = np.flatnonzero(np.isin(pairs, self._pieced))
        if len(rows):
            bodies = nearest_of_states(self._world, self.pairs[pairs[rows]], q[rows])
            for row, body in zip(rows.tolist(), bodies, strict=True):
                pieces[row] = self._piece(body)
        return self.proximity.gradients(q, pairs, pieces)

    def _piece(self, number: int) -> Box:
        """A body of what stands in the world as a shape by itself."""
        bodies = self._world.bodies
        body = bodies.each[number]
        name = self.boxes[body["owner"]].name
        count = body["number"]
        if count > 0:
            first = body["first"]
            corners = bodies.corners[first : first + count]
            solid = Solid.surface(corners, np.array([[0, 1, 2]]))
        else:
            solid = Solid.simple("sphere", body["radius"])
        return Box(name, 0, body["rot"], body["at"], solid)

    def _engulfed(self, q: Array, pair: int) -> bool:
        """Whether a link that touches no triangle of a mesh lies inside it.

        Then any of its points does.
        """
        first, second = self.pairs[pair]
        mesh = self.boxes[first]
        link = self.boxes[second]
        poses = compute_joint_poses(self.arm.chain, q[None], [link.joint])
        rotations, origins = poses[link.joint]
        corner = np.zeros(3)
        if len(link.solid.points):
            corner = link.solid.points[0]
        point = origins[0] + rotations[0] @ (link.centre + link.rotation @ corner)
        return holds(mesh.solid, mesh.rotation.T @ (point - mesh.centre))

    # What is worked out once.

    @cached_property
    def own(self) -> Bool[Array, " P"]:
        """Which pairs are of the arm itself and what it carries; the others are with the world."""
        return np.asarray(self.pairs[:, 0] < self._links)

    @cached_property
    def widest(self) -> Float[Array, " P"]:
        """Gap that links beside one another hardly ever exceed, whatever the position [m].

        Infinite for other pairs.
        """
        joint = np.array([box.joint for box in self.boxes])
        inner, outer = self.pairs.T
        beside = self.own & (joint[outer] - joint[inner] <= BESIDE)
        q = random_positions(self.arm, DRAWN)
        gaps = self.gaps(q, WIDE, np.repeat(beside[None], DRAWN, axis=0))
        usual = np.quantile(gaps, HARDLY, axis=0)
        limited = beside & (usual > 0.0) & (usual < WIDE)
        return freeze(np.where(limited, usual, np.inf))

    @cached_property
    def levers(self) -> Float[Array, "P n"]:
        """Most that a pair's gap can change for a unit of each joint [m/rad, or m/m].

        No point of the outer shape is farther from a joint's axis than the links between reach,
        stretched out.
        """
        chain = self.arm.chain
        slides = chain.sliding > 0
        farthest = np.maximum(np.abs(self.arm.lower), np.abs(self.arm.upper))
        stroke = np.where(slides, farthest, 0.0)
        lengths = np.linalg.norm(chain.offsets, axis=1) + stroke
        ends = np.cumsum(np.append(0.0, lengths))
        joints = np.array([box.joint for box in self.boxes], dtype=np.int64)
        far = np.array([box.farthest for box in self.boxes])
        inner, outer = self.pairs.T
        reach = (far + ends[joints])[outer][:, None] - ends[1:]
        joint = np.arange(self.arm.n)
        moved = (joints[inner][:, None] <= joint) & (joint < joints[outer][:, None])
        lever = np.where(slides, 1.0, reach)
        return freeze(np.where(moved, lever, 0.0))

    @cached_property
    def proximity(self) -> Proximity:
        """Exact distances of the same shapes and pairs, by Coal."""
        return Proximity(self.arm, self.boxes, self.pairs)

    @cached_property
    def _swept(self) -> tuple[Int[Array, "p 2"], Int[Array, " m"], Float[Array, "c n"]]:
        """Pairs of links, links that are checked against the world, and the levers of both."""
        moving, first = np.unique(self.pairs[~self.own, 1], return_index=True)
        of_world = self.levers[~self.own][first]
        levers = np.concatenate([self.levers[self.own], of_world])
        return np.ascontiguousarray(self.pairs[self.own]), moving, levers

    @cached_property
    def _pieced(self) -> Int[Array, " s"]:
        """Pairs whose first shape is many bodies: a closed mesh or a cloud."""
        pieced = []
        for number, (first, _) in enumerate(self.pairs):
            if self.boxes[first].solid.kind in ("surface", "cloud"):
                pieced.append(number)
        return np.array(pieced, dtype=np.int64)

    @cached_property
    def _links(self) -> int:
        """Number of the arm's shapes, which come first."""
        return sum(box.body >= 0 for box in self.boxes)

    @cached_property
    def _world(self) -> CompiledScene:
        """For compiled loops."""
        return compile_scene(self.arm.chain, self.boxes, self._links)
