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

# Compiled gaps fall short of the distance by some millimetres: so far beyond a target Coal is asked [m].
SHARP = 0.01
# Links with no more joints between them than this, the share of so many positions in which "hardly ever" is meant, and
# the gap beyond which it does not matter [m].
BESIDE, HARDLY, DRAWN, WIDE = 2, 0.95, 200, 0.1


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes of an arm and of obstacles."""

    arm: ArmModel
    boxes: tuple[Box, ...]  # links first, then obstacles
    # Numbers of the two shapes of each pair that is checked; the first is the one nearer to the base.
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
        """Sets up the pairs: link against link unless they are neighbours, and every link against every obstacle.

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
        links, left_out = place_carried(arm, shapes.boxes, carried), dict(disabled or {})
        for one in carried:
            left_out |= {frozenset((one.box.name, name)): "it may touch what is carried" for name in one.touches}
        pairs, unchecked = choose_pairs(arm, links, obstacles, left_out)
        every = np.array(pairs, dtype=np.int64).reshape(-1, 2)
        every.setflags(write=False)
        return cls(arm, (*links, *obstacles), every, unchecked, shapes)

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Shapes of the obstacles."""
        return tuple(box for box in self.boxes if box.body < 0)

    @property
    def coarser(self) -> tuple[str, ...]:
        """Obstacles that are larger here than in their files, because these hold too much; and by how much."""
        return tuple(f"{box.name}: {box.solid.note}" for box in self.obstacles if box.solid.note)

    @property
    def limits_of_proof(self) -> list[str]:
        """What a proof does not speak of, a line each: shapes that stand in or hold more, pairs left out."""
        issue, meshes = self.shapes.issue, self.shapes.coarser
        lines = [] if issue is None else [f"not the arm's own shape: {issue.evidence}"]
        lines += [meshes] * bool(meshes) + [f"larger than its file says: {one}" for one in self.coarser]
        reasons: dict[str, list[str]] = {}
        for pair in self.unchecked:
            reasons.setdefault(pair.reason, []).append(" and ".join(pair.links))
        return lines + [
            f"{'warning: ' * (reason == OVERLAP)}not checked ({reason}): {'; '.join(pairs)}"
            for reason, pairs in reasons.items()
        ]

    def to_dict(self) -> dict[str, Any]:
        """The same for results: pairs left out, what stands in for which links, and the convex parts of meshes."""
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
        """Signed separation of every pair [m]; at most the distance, equal to it, or nearly, under 5 cm.

        Args:
            q: Positions [rad].
            beyond: Gap that may stand for any larger one: far pairs then cost next to nothing [m].
            wanted: Which pairs to look at, position by position, if not all; `beyond` stands for the others.
            pairs: Other pairs than all that are checked.
        """
        pairs, q = self.pairs if pairs is None else pairs, np.ascontiguousarray(q, dtype=float)
        if len(pairs) == 0:
            return np.empty((len(q), 0))
        return np.asarray(gaps_of_states(self._world, pairs, q, beyond, ALL if wanted is None else wanted))

    def separation(
        self, q: Float[Array, "T n"], margins: Float[Array, " P"] | float = 0.0, most: float = 1.0
    ) -> Float[Array, " T"]:
        """Smallest gap at each position beyond its pair's margin [m]; `most` where nothing is nearer than that."""
        beyond = most + float(np.max(margins, initial=0.0))
        return np.asarray((self.gaps(q, beyond) - margins).min(axis=1, initial=most))

    def sweep(
        self, splines: Splines, margins: Float[Array, " P"] | float
    ) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
        """Smallest gap along each trajectory beyond its pair's margin, and the mean shortfall from it, both [m].

        Skips ahead where shapes are far apart; where a gap is at its margin, no step changes it by more than 2 mm.
        """
        if len(self.pairs) == 0:
            return np.ones(len(splines.points)), np.zeros(len(splines.points))
        between, moving, levers = self._swept
        # Of the pairs of links, then for each moving link the least of its pairs with the world.
        pairs, world = np.broadcast_to(margins, len(self.pairs)), np.full(len(moving), np.inf)
        np.minimum.at(world, np.searchsorted(moving, self.pairs[~self.own, 1]), pairs[~self.own])
        kept = np.concatenate([pairs[self.own], world])
        parts = (splines.points, splines.slopes, splines.durations)
        found = sweep(self._world, between, moving, levers, parts, kept)
        return np.minimum(found[:, 0], 1.0), found[:, 1]

    # Exact: by Coal, one position at a time.

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Exact signed distance of every pair at one position [m]; negative inside a closed mesh too."""
        found = self.proximity.distances(q)
        for pair in self._pieced:
            closed = self.boxes[self.pairs[pair, 0]].solid.kind == "surface"
            if closed and found[pair] > 0.0 and self._engulfed(q, pair):
                found[pair] = -found[pair]
        return found

    def near_distances(self, q: Float[Array, " n"], target: float | Array, near: float) -> Float[Array, " P"]:
        """Exact signed distance of the pairs near a target, lower bounds of the others' [m].

        What has thousands of pieces takes Coal milliseconds. There the compiled gap, which is never above the distance,
        is looked at first, and Coal asked only where that comes close to the target.

        Args:
            q: Position [rad].
            target: Distance that is asked about, of all pairs or of each; minus infinity for those not of interest [m].
            near: How far beyond it exact distances are wanted [m].
        """
        known, beyond = np.full(len(self.pairs), -np.inf), np.zeros(len(self.pairs)) + target + near
        if len(self._pieced):
            known[self._pieced] = self.gaps(q[None], float(np.max(beyond)), None, self.pairs[self._pieced])[0]
            beyond[self._pieced] += min(near, SHARP) - near
        return self.proximity.near_distances(q, beyond, known)

    def gradients(self, q: Float[Array, "m n"], pairs: Int[Array, " m"]) -> Float[Array, "m n"]:
        """Derivatives of some pairs' signed distances by the joints, each at its own position [m/rad]."""
        rows = np.flatnonzero(np.isin(pairs, self._pieced))
        bodies = nearest_of_states(self._world, self.pairs[pairs[rows]], q[rows]) if len(rows) else ()
        return self.proximity.gradients(q, pairs, dict(zip(rows, map(self._piece, bodies), strict=True)))

    def _piece(self, number: int) -> Box:
        """A body of what stands in the world as a shape by itself."""
        bodies = self._world.bodies
        solid = Solid.simple("sphere", bodies.radius[number])
        if bodies.number[number] > 0:
            corners = bodies.corners[bodies.first[number] :][: bodies.number[number]]
            solid = Solid.surface(corners, np.array([[0, 1, 2]]))
        return Box(self.boxes[bodies.owner[number]].name, 0, bodies.rot[number], bodies.at[number], solid)

    def _engulfed(self, q: Array, pair: int) -> bool:
        """Whether a link that touches no triangle of a mesh lies inside it: then any of its points does."""
        mesh, link = (self.boxes[i] for i in self.pairs[pair])
        rotation, at = (part[0] for part in compute_joint_poses(self.arm.chain, q[None], [link.joint])[link.joint])
        corner = link.solid.points[0] if len(link.solid.points) else np.zeros(3)
        point = at + rotation @ (link.centre + link.rotation @ corner)
        return holds(mesh.solid, mesh.rotation.T @ (point - mesh.centre))

    # What is worked out once.

    @cached_property
    def own(self) -> Bool[Array, " P"]:
        """Which pairs are of the arm itself and what it carries; the others are with the world."""
        return np.asarray(self.pairs[:, 0] < self._links)

    @cached_property
    def widest(self) -> Float[Array, " P"]:
        """Gap that links beside one another hardly ever exceed, whatever the position [m]; infinite for other pairs."""
        joint = np.array([box.joint for box in self.boxes])
        beside = self.own & (joint[self.pairs[:, 1]] - joint[self.pairs[:, 0]] <= BESIDE)
        q = random_positions(self.arm, DRAWN)
        found = self.gaps(q, WIDE, np.repeat(beside[None], DRAWN, axis=0))
        usual = np.quantile(found, HARDLY, axis=0)
        return freeze(np.where(beside & (usual > 0.0) & (usual < WIDE), usual, np.inf))

    @cached_property
    def levers(self) -> Float[Array, "P n"]:
        """Most that a pair's gap can change for a unit of each joint [m/rad, or m/m].

        No point of the outer shape is farther from a joint's axis than the links between reach, stretched out.
        """
        chain, (inner, outer) = self.arm.chain, self.pairs.T
        stroke = np.where(chain.sliding > 0, np.maximum(np.abs(self.arm.lower), np.abs(self.arm.upper)), 0.0)
        ends = np.cumsum(np.append(0.0, np.linalg.norm(chain.offsets, axis=1) + stroke))
        joints = np.array([box.joint for box in self.boxes], dtype=np.int64)
        far = np.array([box.farthest for box in self.boxes])
        reach = (far + ends[joints])[outer][:, None] - ends[1:]
        each = np.arange(self.arm.n)
        moved = (joints[inner][:, None] <= each) & (each < joints[outer][:, None])
        return freeze(np.where(moved, np.where(chain.sliding > 0, 1.0, reach), 0.0))

    @cached_property
    def proximity(self) -> Proximity:
        """Exact distances of the same shapes and pairs, by Coal."""
        return Proximity(self.arm, self.boxes, self.pairs)

    @cached_property
    def _swept(self) -> tuple[Int[Array, "p 2"], Int[Array, " m"], Float[Array, "c n"]]:
        """Pairs of links, links that are checked against the world, and the levers of the ones and of the others."""
        moving, first = np.unique(self.pairs[~self.own, 1], return_index=True)
        levers = np.concatenate([self.levers[self.own], self.levers[~self.own][first]])
        return np.ascontiguousarray(self.pairs[self.own]), moving, levers

    @cached_property
    def _pieced(self) -> Int[Array, " s"]:
        """Pairs whose first shape is many bodies: a closed mesh or a cloud."""
        kinds = [self.boxes[first].solid.kind for first, _ in self.pairs]
        return np.array([i for i, kind in enumerate(kinds) if kind in ("surface", "cloud")], dtype=np.int64)

    @cached_property
    def _links(self) -> int:
        """Number of the arm's shapes, which come first."""
        return sum(box.body >= 0 for box in self.boxes)

    @cached_property
    def _world(self) -> CompiledScene:
        """For compiled loops."""
        return compile_scene(self.arm.chain, self.boxes, self._links)
