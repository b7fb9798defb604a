"""The scene: the arm's shapes, the obstacles' shapes, and which pairs of them must stay apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float, Int, freeze
from ident.robot.arm import ArmModel
from plan.dynamics.chain import Chain
from plan.geometry.arm_shapes import NO_SHAPES, ArmShapes, StandIn, arm_shapes
from plan.geometry.boxes import Box
from plan.geometry.proximity import Proximity
from plan.geometry.separation import gaps_of_states, sweep
from plan.spline import Splines

# A pair of links that overlaps in most positions is an overlap of the shapes, not of the arm.
ALWAYS = 0.5
PROBES = 500
# Joints closer than this meet in one point [m].
HUB = 1e-6


@dataclass(frozen=True)
class Unchecked:
    """Two links whose clearance is not looked at.

    Attributes:
        links: Their names.
        reason: Why.
    """

    links: tuple[str, str]
    reason: str

    def to_dict(self) -> dict[str, object]:
        return {"links": list(self.links), "reason": self.reason}


def limits_of_proof(shapes: ArmShapes, unchecked: Sequence[Unchecked]) -> list[str]:
    """What a proof of clearance does not speak of, a line each: shapes that stand in, pairs left out."""
    lines = [] if shapes.issue is None else [f"not the arm's own shape: {shapes.issue.evidence}"]
    reasons: dict[str, list[str]] = {}
    for pair in unchecked:
        reasons.setdefault(pair.reason, []).append(" and ".join(pair.links))
    return lines + [f"not checked ({reason}): {'; '.join(pairs)}" for reason, pairs in reasons.items()]


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
        stand_in: StandIn | None = None,
    ) -> Scene:
        """Sets up the pairs: link against link unless they are neighbours, and every link against every obstacle.

        Args:
            arm: The arm.
            obstacles: Shapes fixed to the world.
            self_collision: Whether link pairs are checked.
            stand_in: What stands in for links that the URDF gives no shape.

        Raises:
            RobotError: A link has no shape and nothing stands in.
        """
        shapes = arm_shapes(arm, stand_in)
        links = shapes.boxes
        pairs, unchecked = _link_pairs(arm, links)
        if not self_collision:
            unchecked += [_unchecked(links, pair, "self-collision is not asked for") for pair in pairs]
            pairs = []
        kept, always = _drop_always(arm, links, pairs)
        unchecked += [_unchecked(links, pair, "their shapes overlap in most positions") for pair in always]
        moving = [i for i, box in enumerate(links) if box.joint > 0]
        outside = [(len(links) + k, i) for k in range(len(obstacles)) for i in moving]
        every = np.array([*kept, *outside], dtype=np.int64).reshape(-1, 2)
        every.setflags(write=False)
        return cls(arm, (*links, *obstacles), every, tuple(dict.fromkeys(unchecked)), shapes)

    @property
    def obstacles(self) -> tuple[Box, ...]:
        """Shapes of the obstacles."""
        return tuple(box for box in self.boxes if box.body < 0)

    def pair_name(self, pair: int) -> str:
        """The two shapes of a pair, in words."""
        first, second = self.pairs[pair]
        return f"{self.boxes[second].name} and {self.boxes[first].name}"

    def gaps(self, q: Float[Array, "T n"]) -> Float[Array, "T P"]:
        """Signed separation of every pair, by separating axes [m]; at most the distance, equal under 5 cm."""
        return gaps_of_states(*self._arrays, self.pairs, np.ascontiguousarray(q, dtype=float))  # type: ignore[call-arg]

    def separation(self, q: Float[Array, "T n"]) -> Float[Array, " T"]:
        """Smallest gap at each position [m]; a metre where there is nothing to hit."""
        return np.min(self.gaps(q), axis=1, initial=1.0)

    def sweep(self, splines: Splines, margin: float) -> tuple[Float[Array, " B"], Float[Array, " B"]]:
        """Smallest gap along each trajectory and the mean shortfall from the margin, both [m].

        Skips ahead where boxes are far apart; where a gap is at the margin, no step changes it by more than 2 mm.
        """
        if len(self.pairs) == 0:
            return np.ones(len(splines.points)), np.zeros(len(splines.points))
        parts = (splines.points, splines.slopes, splines.durations, splines.section_speeds)
        found = sweep(*self._arrays, self.pairs, self.levers, *parts, float(margin))  # type: ignore[call-arg]
        return np.minimum(found[:, 0], 1.0), found[:, 1]

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
    def chain(self) -> Chain:
        """The arm as arrays."""
        return Chain.from_arm(self.arm)

    @cached_property
    def _arrays(self) -> tuple[Array, ...]:
        return (*self.chain.kinematics, *box_arrays(self.boxes))


def box_arrays(boxes: Sequence[Box]) -> tuple[Array, Array, Array, Array]:
    """Carrying joints, rotations, centres and half lengths of boxes, as arrays."""
    return (
        np.array([box.joint for box in boxes], dtype=np.int64),
        np.array([box.rotation for box in boxes]).reshape(-1, 3, 3),
        np.array([box.centre for box in boxes]).reshape(-1, 3),
        np.array([box.half for box in boxes]).reshape(-1, 3),
    )


def _link_pairs(arm: ArmModel, links: Sequence[Box]) -> tuple[list[tuple[int, int]], list[Unchecked]]:
    """Pairs of links that can move against each other, parted into those to check and neighbours along the arm.

    Links whose joints meet in one point, as a shoulder's two, are neighbours too: the boxes round such a hub overlap
    where the rounded castings do not.
    """
    lengths = np.linalg.norm(Chain.from_arm(arm).offsets, axis=1)
    pairs, unchecked = [], []
    for i, a in enumerate(links):
        for k, b in enumerate(links[i + 1 :], start=i + 1):
            if a.joint == b.joint:
                continue
            if b.body - a.body <= 1:
                unchecked.append(_unchecked(links, (i, k), "neighbours along the arm"))
            elif lengths[a.joint + 1 : b.joint].sum() < HUB and b.joint - a.joint > 1:
                unchecked.append(_unchecked(links, (i, k), "their joints meet in one point"))
            else:
                pairs.append((i, k))
    return pairs, unchecked


def _unchecked(links: Sequence[Box], pair: tuple[int, int], reason: str) -> Unchecked:
    return Unchecked((links[pair[0]].name, links[pair[1]].name), reason)


def _drop_always(
    arm: ArmModel, links: Sequence[Box], pairs: list[tuple[int, int]]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Parts the pairs into those to check and those whose shapes overlap in half of 500 fixed positions."""
    if not pairs:
        return [], []
    rng = np.random.default_rng(0)  # fixed: which pairs are checked must not depend on the run's seed
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = rng.uniform(low, high, (PROBES, arm.n))
    arrays = (*Chain.from_arm(arm).kinematics, *box_arrays(links))
    share = (gaps_of_states(*arrays, np.array(pairs, dtype=np.int64), q) < 0).mean(axis=0)
    kept = [pair for pair, often in zip(pairs, share, strict=True) if often < ALWAYS]
    return kept, [pair for pair, often in zip(pairs, share, strict=True) if often >= ALWAYS]


def _reaches(arm: ArmModel, boxes: Sequence[Box]) -> Float[Array, "M n"]:
    """Farthest that a point of each shape can be from each joint's axis [m]; 1 for a sliding joint."""
    chain = Chain.from_arm(arm)
    stroke = np.where(chain.sliding > 0, np.maximum(np.abs(arm.lower), np.abs(arm.upper)), 0.0)
    lengths = np.linalg.norm(chain.offsets, axis=1) + stroke
    out = np.zeros((len(boxes), arm.n))
    for i, box in enumerate(boxes):
        far = box.farthest
        for j in range(box.joint):
            out[i, j] = 1.0 if chain.sliding[j] else far + lengths[j + 1 : box.joint].sum()
    return out
