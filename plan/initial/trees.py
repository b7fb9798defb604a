"""Ways round what stands between two positions: random trees, and the nine seeds of section 3.1 of the paper.

Bi-directional rapidly-exploring random trees grow between the positions, and their paths are pruned. For the seeds a
midplane stands on the middle of the line between the start and the goal of the arm's tip. The obstacles' corners are
projected onto it; round their hull, widened by the arm's girth, eight points 45° apart and the middle of the line are
the places through which the tip may go. Trees lead from the start to each of them and on to the goal.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from plan.geometry.scene import Scene
from plan.geometry.solids import Box
from plan.initial.inverse_kinematics import PoseSolver
from plan.problem.problem import PlanningProblem
from plan.problem.rules import Pose

# Gaps beyond their margins by more than this are all the same to a tree [m].
NEAR = 0.01
# Longest edge, and distance at which edges are looked at, by the largest joint difference [rad]; the final motion is
# checked without gaps.
STEP, RESOLUTION = 0.35, 0.04
# Initial positions from which the arm is brought to a point, and how near to it is there [m].
TRIES, THERE = 12, 1e-3
# Trees look near their ends first, then half a turn around them: reach beyond the ends [rad] and nodes.
RANGES = ((0.7, 600), (np.pi, 4000))


def endless() -> float:
    """Time without end [s]."""
    return math.inf


@dataclass(frozen=True, eq=False)
class Trees:
    """What trees need to look for ways."""

    scene: Scene  # what to keep clear of
    lower: Float[Array, " n"]  # position limits [rad]
    upper: Float[Array, " n"]
    rng: np.random.Generator  # source of randomness
    margins: Float[Array, " P"] | float = 0.0  # clearance that every node and edge keeps, of each pair or of all [m]
    left: Callable[[], float] = endless  # processor time that is left, at which trees end [s]

    @classmethod
    def of(cls, problem: PlanningProblem, rng: np.random.Generator, left: Callable[[], float] = endless) -> Trees:
        """For a task's scene, limits and margins."""
        return cls(problem.scene, problem.limits.lower, problem.limits.upper, rng, problem.margins, left)

    def is_free(self, q: Float[Array, "T n"]) -> bool:
        """Whether all positions keep the margins."""
        return bool(self.scene.separation(q, self.margins, NEAR).min() > 0.0)

    def edge_is_free(self, a: Float[Array, " n"], b: Float[Array, " n"], resolution: float = RESOLUTION) -> bool:
        """Whether the straight line between two positions keeps the margin, at a resolution."""
        count = int(np.ceil(np.abs(b - a).max() / resolution)) + 1
        share = np.linspace(0.0, 1.0, count + 1)[1:, None]
        return self.is_free(a + share * (b - a))

    def connect(
        self, start: Float[Array, " n"], goal: Float[Array, " n"], nodes: int, reach: float
    ) -> Float[Array, "k n"] | str:
        """Grows a tree from each end, each new branch pulling the other tree towards itself.

        Args:
            start, goal: Ends [rad].
            nodes: Most nodes of both trees, and most positions that are drawn.
            reach: How far beyond the ends positions are drawn, within the limits [rad].

        Returns:
            Positions from start to goal; or why there are none.
        """
        for name, q in (("start", start), ("target", goal)):
            if not self.is_free(q[None]):
                return f"the {name} of this search is in collision"
        if self.edge_is_free(start, goal):
            return np.array([start, goal])
        low = np.maximum(self.lower, np.minimum(start, goal) - reach)
        high = np.minimum(self.upper, np.maximum(start, goal) + reach)
        near, far = _Tree(self, start, nodes), _Tree(self, goal, nodes)
        for turn in range(nodes):
            if near.size + far.size >= nodes or self.left() <= 0.0:
                break
            grown = near.extend(self.rng.uniform(low, high))
            met = None if grown is None else far.pull(near.points[grown])
            if grown is not None and met is not None:
                points = np.array([*near.branch(grown)[::-1], *far.branch(met)[1:]])
                return points[::-1] if turn % 2 else points
            near, far = far, near
        return f"no way found with {nodes} nodes"

    def prune(self, points: Float[Array, "k n"]) -> Float[Array, "m n"]:
        """Takes out nodes without which the path is shorter and still free, from the start on, until none can go.

        By the triangle inequality a path without a node is never longer. Source: paper, section 3.1.
        """
        kept, before = list(points), 0
        while len(kept) != before:
            before, i = len(kept), 1
            while i < len(kept) - 1:
                if self.edge_is_free(kept[i - 1], kept[i + 1]):
                    del kept[i]
                else:
                    i += 1
        return np.array(kept)

    def vias(
        self, start: Float[Array, " n"], goal: Float[Array, " n"], nodes: int, reach: float
    ) -> Float[Array, "V n"] | None:
        """Via points of a pruned way between two positions; None where so many nodes find none."""
        found = self.connect(start, goal, nodes, reach)
        return None if isinstance(found, str) else self.prune(found)[1:-1]

    def reach(self, target: Array, tip: PoseSolver, middle: Float[Array, " n"]) -> Float[Array, " n"] | str:
        """A free position with the tip at a point, the nearest to one in the middle; or why there is none."""
        found, blocked, outside = [], 0, 0
        for attempt in range(TRIES):
            guess = middle + (self.rng.normal(size=len(middle)) * 0.15 * attempt if attempt else 0.0)
            q, missed = tip.descend(Pose(None, target), np.clip(guess, self.lower, self.upper))
            if missed[0] > THERE:
                continue
            if np.any(q < self.lower) or np.any(q > self.upper):
                outside += 1
            elif not self.is_free(q[None]):
                blocked += 1
            else:
                found.append(q)
        if found:
            return min(found, key=lambda q: float(np.abs(q - middle).max()))
        if blocked:
            return "the arm collides when its tip is there"
        return "joint limits keep the tip from it" if outside else "out of the arm's reach"

    def through(
        self, target: Array, tip: PoseSolver, ends: Float[Array, "2 n"], most: int
    ) -> Float[Array, "V n"] | str:
        """Via points of a way between two ends on which the tip passes a point; or why there is none."""
        start, goal = ends
        reached = self.reach(target, tip, (start + goal) / 2)
        if isinstance(reached, str):
            return reached
        halves: list[Array] = []
        for a, b, name in ((start, reached, "from the start"), (reached, goal, "to the goal")):
            for reach, nodes in RANGES:  # ways near the ends are shorter
                path = self.connect(a, b, min(nodes, most), reach)
                if not isinstance(path, str):
                    break
            if isinstance(path, str):
                return f"{name}: {path}"
            halves.append(path)
        return self.prune(np.concatenate([halves[0], halves[1][1:]]))[1:-1]


class _Tree:
    """Positions and their parents; nearest neighbours by a scan, which for some thousand nodes is quick enough."""

    def __init__(self, of: Trees, root: Array, capacity: int) -> None:
        self.of, self.capacity, self.size = of, capacity, 1
        self.points, self.parents = np.empty((capacity + 1, len(root))), np.zeros(capacity + 1, dtype=int)
        self.points[0] = root

    def extend(self, towards: Array) -> int | None:
        """One step from the nearest node; the new node's number, or None if it is blocked."""
        difference = self.points[: self.size] - towards
        nearest = int(np.argmin(np.einsum("ij,ij->i", difference, difference)))
        origin = self.points[nearest]
        reach = float(np.abs(towards - origin).max())
        target = origin + (towards - origin) * min(1.0, STEP / max(reach, 1e-12))
        if not self.of.edge_is_free(origin, target):
            return None
        self.points[self.size], self.parents[self.size] = target, nearest
        self.size += 1
        return self.size - 1

    def pull(self, target: Array) -> int | None:
        """Steps towards a position until it is reached (its number) or the way is blocked (None)."""
        while self.size < self.capacity:
            node = self.extend(target)
            if node is None or np.abs(self.points[node] - target).max() < 1e-9:
                return node
        return None

    def branch(self, node: int) -> list[Array]:
        """Positions from a node to the root."""
        found = [self.points[node]]
        while node != 0:
            node = int(self.parents[node])
            found.append(self.points[node])
        return found


DIRECTIONS = 8
# A point where the arm collides is moved outwards by so many girths in all before it is given up.
INFLATIONS = (1.0, 2.0, 3.0)


@dataclass(frozen=True, eq=False)
class Seed:
    """One initial trajectory, or why there is none."""

    label: str  # which of the nine points it goes through
    target: Float[Array, " 3"]  # that point in the base frame [m]
    # Via points between start and goal [rad]; empty if it failed.
    vias: Float[Array, "V n"] = field(default_factory=lambda: np.empty((0, 0)))
    reason: str = ""  # why it failed; empty if it did not


def midplane_targets(
    start: Float[Array, " 3"], goal: Float[Array, " 3"], obstacles: Sequence[Box], inflation: float
) -> list[tuple[str, Float[Array, " 3"]]]:
    """The middle of the line, and eight points round the obstacles' hull on the midplane.

    Args:
        start, goal: Ends of the tip's way [m].
        obstacles: Boxes.
        inflation: How far outside the hull the points lie [m].

    Returns:
        Names and points in the base frame.
    """
    middle, along = (start + goal) / 2, goal - start
    length = np.linalg.norm(along)
    found = [("midpoint", middle)]
    if not obstacles:
        return found
    normal = along / length if length > 1e-9 else np.array([1.0, 0.0, 0.0])
    # Two unit vectors of the plane: the first level where that is possible, the second upwards.
    level = np.cross([0.0, 0.0, 1.0], normal)
    level = level / np.linalg.norm(level) if np.linalg.norm(level) >= 1e-6 else np.array([1.0, 0.0, 0.0])
    axes = np.array([level, np.cross(normal, level)])
    flat = (np.concatenate([box.corners for box in obstacles]) - middle) @ axes.T
    try:
        hull = ConvexHull(flat)
    except QhullError:  # they have no area, seen from there
        hull = ConvexHull(flat, qhull_options="QJ")
    centre = flat[hull.vertices].mean(axis=0)
    room = -(hull.equations[:, :2] @ centre + hull.equations[:, 2])
    for i in range(DIRECTIONS):
        angle = 2 * np.pi * i / DIRECTIONS
        ray = np.array([np.cos(angle), np.sin(angle)])
        outward = hull.equations[:, :2] @ ray
        exit_ = float((room / np.where(outward > 1e-12, outward, np.nan))[outward > 1e-12].min())
        found.append((f"{round(np.degrees(angle))} deg", middle + (centre + (exit_ + inflation) * ray) @ axes))
    return found


def find_seeds(problem: PlanningProblem, rng: np.random.Generator, seconds: float = np.inf) -> list[Seed]:
    """Looks for the nine ways, for so much processor time at most [s]; those that fail say why."""
    end = time.process_time() + seconds
    return list(iterate_seeds(problem, Trees.of(problem, rng, lambda: end - time.process_time())))


def iterate_seeds(problem: PlanningProblem, trees: Trees, most: int = RANGES[-1][1]) -> Iterator[Seed]:
    """The nine ways one by one, each looked for when it is asked for.

    Args:
        problem: Task; its scene's obstacles shape the midplane.
        trees: Look for ways, as long as they have time.
        most: Most nodes of trees.
    """
    arm, scene = problem.scene.arm, problem.scene
    tip = tip_solver(arm)
    # Half the thickness of the arm's thickest moving box: how far the tip's way must stay outside.
    girth = max((np.sort(box.half)[1] for box in scene.boxes if box.joint > 0 and box.body >= 0), default=0.0)
    ends = tip.place(problem.start), tip.place(problem.goal)
    for rays in zip(*(midplane_targets(*ends, scene.in_the_way, share * girth) for share in INFLATIONS), strict=True):
        seed = Seed(rays[0][0], rays[0][1], reason="no time was left to look for it")
        for label, target in rays if trees.left() > 0.0 else ():
            found = trees.through(target, tip, problem.ends, most)
            seed = Seed(label, target, reason=found) if isinstance(found, str) else Seed(label, target, found)
            if not seed.reason or label == "midpoint":
                break
        yield seed


def tip_solver(arm: ArmModel) -> PoseSolver:
    """Of the arm's tip: the last frame that the last joint moves."""
    return PoseSolver(arm, [frame.name for frame in arm.model.frames if frame.parentJoint == arm.n][-1])
