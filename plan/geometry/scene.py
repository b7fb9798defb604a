"""The scene: the arm's shapes, the obstacles' shapes, and which pairs of them must stay apart."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.robot.arm import ArmModel
from ident.robot.chain import Chain
from plan.geometry.arm_shapes import NO_SHAPES, ArmShapes, arm_shapes
from plan.geometry.boxes import Box
from plan.geometry.compiled import CompiledBodies, Tree, build_tree, compile_bodies
from plan.geometry.link_pairs import (
    FLOOR,
    Unchecked,
    drop_always,
    find_standing,
    link_pairs,
    names_of_pair,
    unchecked_pair,
)
from plan.geometry.margins import Margins
from plan.geometry.mesh_obstacles import holds
from plan.geometry.proximity import Proximity
from plan.geometry.solids import CLOSED, Solid
from plan.geometry.sweep import ALL, gaps_of_states, nearest_of_states, sweep
from plan.geometry.tool import Carried, allowed_touches, place_carried
from plan.spline import Splines

# Why a pair is dropped that could hit: the shapes, as they are known here, do so nearly everywhere.
OVERLAP = "their shapes overlap in most positions"
# Compiled gaps fall short of the distance by some millimetres: so far beyond a target Coal is asked [m].
SHARP = 0.01
# Links with no more joints between them than this, the share of so many positions in which "hardly ever" is meant, and
# the gap beyond which it does not matter [m].
BESIDE, HARDLY, DRAWN, WIDE = 2, 0.95, 200, 0.1


def limits_of_proof(shapes: ArmShapes, unchecked: Sequence[Unchecked], coarser: Sequence[str] = ()) -> list[str]:
    """What a proof of clearance does not speak of, a line each: shapes that stand in or hold more, pairs left out."""
    lines = [] if shapes.issue is None else [f"not the arm's own shape: {shapes.issue.evidence}"]
    lines += [shapes.coarser] * bool(shapes.coarser) + [f"larger than its file says: {one}" for one in coarser]
    reasons: dict[str, list[str]] = {}
    for pair in unchecked:
        reasons.setdefault(pair.reason, []).append(" and ".join(pair.links))
    return lines + [
        f"{'warning: ' * (reason == OVERLAP)}not checked ({reason}): {'; '.join(pairs)}"
        for reason, pairs in reasons.items()
    ]


@dataclass(frozen=True, eq=False)
class Scene:
    """Shapes of an arm and of obstacles.

    Attributes:
        arm: The arm.
        boxes: Links first, then obstacles.
        pairs: Numbers of the two shapes of each pair that is checked; the first is the one nearer to the base.
        unchecked: Pairs of links that can move against each other and are left out, each with the reason.
        shapes: Where the links' shapes come from.
    """

    arm: ArmModel
    boxes: tuple[Box, ...]
    pairs: Int[Array, "P 2"]
    unchecked: tuple[Unchecked, ...] = ()
    shapes: ArmShapes = NO_SHAPES

    @classmethod
    def build(
        cls,
        arm: ArmModel,
        obstacles: Sequence[Box] = (),
        self_collision: bool = True,
        stand_in: str | None = None,
        carried: Sequence[Carried] = (),
        disabled: Mapping[frozenset[str], str] | None = None,
    ) -> Scene:
        """Sets up the pairs: link against link unless they are neighbours, and every link against every obstacle.

        Args:
            arm: The arm.
            obstacles: Shapes fixed to the world.
            self_collision: Whether link pairs are checked.
            stand_in: What stands in for links that the URDF gives no shape.
            carried: What the arm carries.
            disabled: Pairs of links to leave out, by name, with the reason.

        Raises:
            RobotError: A link has no shape and nothing stands in.
        """
        shapes = arm_shapes(arm, stand_in)
        links = place_carried(arm, shapes.boxes, carried)
        pairs, unchecked = link_pairs(arm, links)
        left_out = {**(disabled or {}), **allowed_touches(carried)}
        unchecked += [
            unchecked_pair(links, pair, left_out[k]) for pair in pairs if (k := names_of_pair(links, pair)) in left_out
        ]
        pairs = [pair for pair in pairs if names_of_pair(links, pair) not in left_out]
        if not self_collision:
            unchecked += [unchecked_pair(links, pair, "self-collision is not asked for") for pair in pairs]
            pairs = []
        kept, always = drop_always(arm, links, pairs)
        unchecked += [unchecked_pair(links, pair, OVERLAP) for pair in always]
        moving = [i for i, box in enumerate(links) if box.joint > 0]
        standing = find_standing(arm, links, obstacles)
        unchecked += [Unchecked((links[i].name, obstacles[k].name), "it stands there") for k, i in standing]
        outside = [(len(links) + k, i) for k in range(len(obstacles)) for i in moving if (k, i) not in standing]
        every = np.array([*kept, *outside], dtype=np.int64).reshape(-1, 2)
        every.setflags(write=False)
        return cls(arm, (*links, *obstacles), every, tuple(dict.fromkeys(unchecked)), shapes)

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Shapes of the obstacles."""
        return tuple(box for box in self.boxes if box.body < 0)

    @property
    def coarser(self) -> tuple[str, ...]:
        """Obstacles that are larger here than in their files, because these hold too much; and by how much."""
        return tuple(f"{box.name}: {box.solid.note}" for box in self.obstacles if box.solid.note)

    @property
    def in_the_way(self) -> tuple[Box, ...]:
        """The obstacles that a way leads round: all but the floor, which has no sides."""
        return tuple(box for box in self.obstacles if box.name != FLOOR)

    def pair_name(self, pair: int) -> str:
        """The two shapes of a pair, in words."""
        return " and ".join(self.names_of(pair))

    def names_of(self, pair: int) -> tuple[str, str]:
        """Names of the two shapes of a pair, the one farther from the base first."""
        first, second = self.pairs[pair]
        return self.boxes[second].name, self.boxes[first].name

    def gaps(
        self, q: Float[Array, "T n"], beyond: float = 1e9, wanted: Bool[Array, "T P"] | None = None
    ) -> Float[Array, "T P"]:
        """Signed separation of every pair [m]; at most the distance, equal to it, or nearly, under 5 cm.

        Args:
            q: Positions [rad].
            beyond: Gap that may stand for any larger one: far pairs then cost next to nothing [m].
            wanted: Which pairs to look at, position by position, if not all; `beyond` stands for the others.
        """
        which = ALL if wanted is None else wanted
        return np.asarray(gaps_of_states(*self._world, self.pairs, self._tree, _rows(q), beyond, which))

    def gradients(self, q: Float[Array, "m n"], pairs: Int[Array, " m"]) -> Float[Array, "m n"]:
        """Derivatives of some pairs' signed distances by the joints, each at its own position [m/rad]."""
        pieces: list[Box | None] = [None] * len(pairs)
        rows = np.flatnonzero(np.isin(pairs, self._pieced))
        for row, piece in zip(rows, self._pieces(q[rows], pairs[rows]), strict=True):
            pieces[row] = piece
        return self.proximity.gradients(q, pairs, pieces)

    @cached_property
    def own(self) -> Bool[Array, " P"]:
        """Which pairs are of the arm itself and what it carries; the others are with the world."""
        return np.asarray(self.pairs[:, 0] < self._links)

    @cached_property
    def widest(self) -> Float[Array, " P"]:
        """Gap that links beside one another hardly ever exceed, whatever the position [m]; infinite for other pairs."""
        joint = np.array([box.joint for box in self.boxes])
        beside = self.own & (joint[self.pairs[:, 1]] - joint[self.pairs[:, 0]] <= BESIDE)
        low, high = np.maximum(self.arm.lower, -np.pi), np.minimum(self.arm.upper, np.pi)
        q = np.random.default_rng(0).uniform(low, high, (DRAWN, self.arm.n))  # fixed: a property of the arm
        found = self.gaps(q, WIDE, np.repeat(beside[None], DRAWN, axis=0))
        usual = np.quantile(found, HARDLY, axis=0)
        return freeze(np.where(beside & (usual > 0.0) & (usual < WIDE), usual, np.inf))

    def by_body(self, pairs: Float[Array, " P"]) -> Float[Array, " c"]:
        """Numbers of the pairs of links, then for each moving link the least of its pairs with the world."""
        world = np.full(len(self._moving), np.inf)
        np.minimum.at(world, np.searchsorted(self._moving, self.pairs[~self.own, 1]), pairs[~self.own])
        return np.concatenate([pairs[self.own], world])

    def separation(
        self, q: Float[Array, "T n"], margins: Margins | float = 0.0, most: float = 1.0
    ) -> Float[Array, " T"]:
        """Smallest gap at each position beyond its pair's margin [m]; `most` where nothing is nearer than that."""
        kept = margins.pairs if isinstance(margins, Margins) else margins
        beyond = most + float(np.max(kept, initial=0.0))
        return np.asarray((self.gaps(q, beyond) - kept).min(axis=1, initial=most))

    def sweep(self, splines: Splines, margins: Margins | float) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
        """Smallest gap along each trajectory beyond its pair's margin, and the mean shortfall from it, both [m].

        Skips ahead where shapes are far apart; where a gap is at its margin, no step changes it by more than 2 mm.
        """
        if len(self.pairs) == 0:
            return np.ones(len(splines.points)), np.zeros(len(splines.points))
        parts = (splines.points, splines.slopes, splines.durations)
        bodies = self._between, self._moving, self._tree, self._sweep_levers
        count = len(self._between) + len(self._moving)
        kept = margins.bodies if isinstance(margins, Margins) else np.full(count, float(margins))
        found = sweep(*self._world, *bodies, parts, kept)
        return np.minimum(found[:, 0], 1.0), found[:, 1]

    def distances(self, q: Float[Array, " n"]) -> Float[Array, " P"]:
        """Exact signed distance of every pair at one position [m]; negative inside a closed mesh too."""
        found = self.proximity.distances(q)
        for pair in self._pieced:
            closed = self.boxes[self.pairs[pair, 0]].solid.kind in CLOSED
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
        if len(self._pieced) == 0:
            return self.proximity.near_distances(q, target + near)
        known, beyond = np.full(len(self.pairs), -np.inf), np.zeros(len(self.pairs)) + target + near
        pieced = self.pairs[self._pieced]
        gaps = gaps_of_states(*self._world, pieced, self._tree, _rows(q[None]), float(np.max(beyond)), ALL)[0]
        known[self._pieced], beyond[self._pieced] = gaps, beyond[self._pieced] - near + min(near, SHARP)
        return self.proximity.near_distances(q, beyond, known)

    @cached_property
    def levers(self) -> Float[Array, "P n"]:
        """Most that a pair's gap can change for a unit of each joint [m/rad, or m/m]."""
        reach = _reaches(self.arm, self.boxes)
        out = np.zeros((len(self.pairs), self.arm.n))
        for row, (a, b) in enumerate(self.pairs):
            low, high = self.boxes[a].joint, self.boxes[b].joint
            out[row, low:high] = reach[b, low:high]
        return freeze(out)

    @cached_property
    def proximity(self) -> Proximity:
        """Exact distances of the same shapes and pairs, by Coal."""
        return Proximity(self.arm, self.boxes, self.pairs)

    @cached_property
    def _pieced(self) -> Int[Array, " s"]:
        """Pairs whose first shape is many bodies: a closed mesh, a height field or a cloud."""
        kinds = (*CLOSED, "cloud")
        return np.array([i for i, (a, _) in enumerate(self.pairs) if self.boxes[a].solid.kind in kinds], dtype=np.int64)

    def _pieces(self, q: Float[Array, "m n"], pairs: Int[Array, " m"]) -> list[Box]:
        """The body of each such pair's first shape that is nearest to its link, each at its own position."""
        if len(pairs) == 0:
            return []
        bodies, rows = self._bodies, self.pairs[pairs]
        found = []
        for body in nearest_of_states(*self._world, rows, self._tree, _rows(q)):
            name, rotation, at = self.boxes[bodies.owner[body]].name, bodies.rot[body], bodies.at[body]
            solid = Solid.simple("sphere", bodies.radius[body])
            if bodies.number[body] > 0:
                corners = bodies.corners[bodies.first[body] :][: bodies.number[body]]
                flat = len(corners) == 3
                solid = Solid.surface(corners, np.array([[0, 1, 2]])) if flat else Solid.hull(corners)
            found.append(Box.around(name, solid, 0, rotation, at))
        return found

    def _engulfed(self, q: Array, pair: int) -> bool:
        """Whether a link that touches no triangle of a mesh lies inside it: then any of its points does."""
        mesh, link = (self.boxes[i] for i in self.pairs[pair])
        rotation, at = self._frame(q, link.joint)
        corner = link.solid.points[0] if len(link.solid.points) else np.zeros(3)
        point = at + rotation @ (link.centre + link.rotation @ corner)
        return holds(mesh.solid, mesh.rotation.T @ (point - mesh.centre))

    def _frame(self, q: Array, joint: int) -> tuple[Array, Array]:
        if joint == 0:
            return np.eye(3), np.zeros(3)
        data = self.arm.model.createData()
        pin.forwardKinematics(self.arm.model, data, np.asarray(q, dtype=float))
        return data.oMi[joint].rotation.copy(), data.oMi[joint].translation.copy()

    @cached_property
    def _links(self) -> int:
        """Number of the arm's shapes, which come first."""
        return sum(box.body >= 0 for box in self.boxes)

    @cached_property
    def _bodies(self) -> CompiledBodies:
        return compile_bodies(self.boxes)

    @property
    def _world(self) -> tuple[Chain, CompiledBodies, int, tuple[Array, Array]]:
        return self.arm.chain, self._bodies, self._links, self._room

    @property
    def _room(self) -> tuple[Array, Array]:
        """Room for placements, one for each thread: what stands in the world is in its place there already."""
        if not hasattr(self._rooms, "found"):
            self._rooms.found = (self._bodies.rot.copy(), self._bodies.at.copy())
        found: tuple[Array, Array] = self._rooms.found
        return found

    @cached_property
    def _rooms(self) -> threading.local:
        return threading.local()

    @cached_property
    def _tree(self) -> Tree:
        return build_tree(self._bodies, len(self.boxes), self._links)

    @cached_property
    def _between(self) -> Int[Array, "p 2"]:
        """Pairs of links."""
        return np.ascontiguousarray(self.pairs[self.pairs[:, 0] < self._links])

    @cached_property
    def _moving(self) -> Int[Array, " m"]:
        """Links that are checked against what stands in the world."""
        return np.unique(self.pairs[self.pairs[:, 0] >= self._links, 1])

    @cached_property
    def _sweep_levers(self) -> Float[Array, "c n"]:
        """Levers of the pairs of links, then of each link against the world."""
        reach = _reaches(self.arm, self.boxes)
        carrier = np.array([box.joint for box in self.boxes], dtype=np.int64)[self._moving]
        alone = np.arange(self.arm.n) < carrier[:, None]  # no joint beyond a link moves it
        return np.concatenate([self.levers[: len(self._between)], reach[self._moving] * alone])


def _rows(q: Float[Array, "T n"]) -> Float[Array, "T n"]:
    return np.ascontiguousarray(q, dtype=float)


def _reaches(arm: ArmModel, boxes: Sequence[Box]) -> Float[Array, "M n"]:
    """Farthest that a point of each shape can be from each joint's axis [m]; 1 for a sliding joint."""
    chain = arm.chain
    stroke = np.where(chain.sliding > 0, np.maximum(np.abs(arm.lower), np.abs(arm.upper)), 0.0)
    lengths = np.linalg.norm(chain.offsets, axis=1) + stroke
    out = np.zeros((len(boxes), arm.n))
    for i, box in enumerate(boxes):
        far = box.farthest
        for j in range(box.joint):
            out[i, j] = 1.0 if chain.sliding[j] else far + lengths[j + 1 : box.joint].sum()
    return out
