"""Ways round what stands between two positions: random trees, and the nine seeds of section 3.1 of
the paper.

Bi-directional rapidly-exploring random trees grow between the positions, and their paths are
pruned. For the seeds a midplane stands on the middle of the line between the start and the goal of
the arm's tip. The obstacles' corners are projected onto it; round their hull, widened by the arm's
girth, eight points 45° apart and the middle of the line are the places through which the tip may
go. Trees lead from the start to each of them and on to the goal.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ident.arrays import Array, Float
from ident.compiled import compile_seconds
from ident.robot.arm import ArmModel
from plan.geometry.scene import Scene
from plan.geometry.solids import Box
from plan.initial.inverse_kinematics import PoseSolver
from plan.problem.problem import PlanningProblem
from plan.problem.rules import Pose

# Gaps beyond their margins by more than this are all the same to a tree [m].
NEAR = 0.01
# Longest edge, by the largest joint difference [rad].
STEP = 0.35
# Distance at which edges are looked at [rad]; the final motion is checked without gaps.
RESOLUTION = 0.04
# A position is reached where no joint is farther from it than this [rad].
REACHED = 1e-9
# Initial positions from which the arm is brought to a point, and how near to it is there [m].
TRIES = 12
THERE = 1e-3
# Standard deviation by which the second of these lies beside the middle [rad]; the third lies twice
# as far, and so on.
BESIDE = 0.15
# Trees look near their ends first, then half a turn around them: reach beyond the ends [rad] and
# nodes.
RANGES = ((0.7, 600), (np.pi, 4000))
# Points round the obstacles' hull.
DIRECTIONS = 8
# A point where the arm collides is moved outwards by so many girths in all before it is given up.
INFLATIONS = (1.0, 2.0, 3.0)


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
    # Clearance that every node and edge keeps, of each pair or of all [m].
    margins: Float[Array, " P"] | float = 0.0
    left: Callable[[], float] = endless  # processor time that is left, at which trees end [s]

    @classmethod
    def of(
        cls,
        problem: PlanningProblem,
        rng: np.random.Generator,
        left: Callable[[], float] = endless,
    ) -> Trees:
        """For a task's scene, limits and margins."""
        limits = problem.limits
        return cls(problem.scene, limits.lower, limits.upper, rng, problem.margins, left)

    def is_free(self, q: Float[Array, "T n"]) -> bool:
        """Whether all positions keep the margins."""
        return bool(self.scene.separation(q, self.margins, NEAR).min() > 0.0)

    def edge_is_free(
        self, a: Float[Array, " n"], b: Float[Array, " n"], resolution: float = RESOLUTION
    ) -> bool:
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
        near = _Tree(self, start, nodes)
        far = _Tree(self, goal, nodes)
        for turn in range(nodes):
            if near.size + far.size >= nodes or self.left() <= 0.0:
                break
            points = near.meet(far, self.rng.uniform(low, high))
            if points is not None:
                # At every other turn the tree that grows is the goal's.
                return points[::-1] if turn % 2 else points
            near, far = far, near
        return f"no way found with {nodes} nodes"

    def prune(self, points: Float[Array, "k n"]) -> Float[Array, "m n"]:
        """Takes out nodes without which the path is shorter and still free.

        From the start on, until none can go. By the triangle
        inequality a path without a node is never longer. Source: paper, section 3.1.
        """
        path = list(points)
        before = 0
        while len(path) != before:
            before = len(path)
            node = 1
            while node < len(path) - 1:
                if self.edge_is_free(path[node - 1], path[node + 1]):
                    del path[node]
                else:
                    node += 1
        return np.array(path)

    def vias(
        self, start: Float[Array, " n"], goal: Float[Array, " n"], nodes: int, reach: float
    ) -> Float[Array, "V n"] | None:
        """Via points of a pruned way between two positions; None where so many nodes find none.

        Args:
            start: Where the way begins [rad].
            goal: Where it ends [rad].
            nodes: Most nodes of both trees of the search.
            reach: How far beyond the ends positions are drawn [rad].
        """
        path = self.connect(start, goal, nodes, reach)
        if isinstance(path, str):
            return None
        return self.prune(path)[1:-1]

    def reach(
        self, target: Array, tip: PoseSolver, middle: Float[Array, " n"]
    ) -> Float[Array, " n"] | str:
        """A free position with the tip at a point, the nearest to one in the middle; or why there
        is none.

        Args:
            target: The point (3,) [m].
            tip: The solver of the frame that shall be there.
            middle: The joint position to be near to.

        Returns:
            A joint position, or a phrase that says why there is none.
        """
        free = []
        blocked = False
        outside = False
        for attempt in range(TRIES):
            guess = middle
            if attempt > 0:
                guess = middle + self.rng.normal(size=len(middle)) * BESIDE * attempt
            pose = Pose(None, target)
            q, missed = tip.descend(pose, np.clip(guess, self.lower, self.upper))
            if missed[0] > THERE:
                continue
            if np.any(q < self.lower) or np.any(q > self.upper):
                outside = True
            elif not self.is_free(q[None]):
                blocked = True
            else:
                free.append(q)
        if free:
            return min(free, key=lambda q: float(np.abs(q - middle).max()))
        if blocked:
            return "the arm collides when its tip is there"
        if outside:
            return "joint limits keep the tip from it"
        return "out of the arm's reach"

    def through(
        self, target: Array, tip: PoseSolver, ends: Float[Array, "2 n"], most: int
    ) -> Float[Array, "V n"] | str:
        """Via points of a way between two ends on which the tip passes a point; or why there is
        none.

        Args:
            target: The point (3,) [m].
            tip: The solver of the frame that shall pass it.
            ends: Start and goal.
            most: Most nodes of either half's search.

        Returns:
            Via points without the ends, or a phrase that says why there are none.
        """
        start, goal = ends
        middle = self.reach(target, tip, (start + goal) / 2)
        if isinstance(middle, str):
            return middle
        before = self._connect_soon(start, middle, most)
        if isinstance(before, str):
            return f"from the start: {before}"
        after = self._connect_soon(middle, goal, most)
        if isinstance(after, str):
            return f"to the goal: {after}"
        return self.prune(np.concatenate([before, after[1:]]))[1:-1]

    def _connect_soon(
        self, start: Float[Array, " n"], goal: Float[Array, " n"], most: int
    ) -> Float[Array, "k n"] | str:
        """As `connect`: near the ends, where ways are shorter; farther only if there is none."""
        path: Array | str = ""
        for reach, nodes in RANGES:
            path = self.connect(start, goal, min(nodes, most), reach)
            if not isinstance(path, str):
                break
        return path


class _Tree:
    """Positions and their parents.

    Nearest neighbours are found by a scan, which for some thousand nodes is quick enough.
    """

    def __init__(self, trees: Trees, root: Array, capacity: int) -> None:
        self.trees = trees
        self.capacity = capacity
        self.size = 1
        self.points = np.empty((capacity + 1, len(root)))
        self.points[0] = root
        self.parents = np.zeros(capacity + 1, dtype=int)

    def meet(self, other: _Tree, towards: Array) -> Float[Array, "k n"] | None:
        """Grows by a step and pulls another tree there; a way between their roots if they meet."""
        grown = self.extend(towards)
        if grown is None:
            return None
        met = other.pull(self.points[grown])
        if met is None:
            return None
        ours = self.branch(grown)[::-1]
        theirs = other.branch(met)[1:]
        return np.array([*ours, *theirs])

    def extend(self, towards: Array) -> int | None:
        """One step from the nearest node; the new node's number, or None if it is blocked."""
        difference = self.points[: self.size] - towards
        square = np.einsum("ij,ij->i", difference, difference)
        nearest = int(np.argmin(square))
        origin = self.points[nearest]
        reach = float(np.abs(towards - origin).max())
        share = min(1.0, STEP / max(reach, 1e-12))
        target = origin + (towards - origin) * share
        if not self.trees.edge_is_free(origin, target):
            return None
        self.points[self.size] = target
        self.parents[self.size] = nearest
        self.size += 1
        return self.size - 1

    def pull(self, target: Array) -> int | None:
        """Steps towards a position until it is reached (its number) or the way blocked (None)."""
        while self.size < self.capacity:
            node = self.extend(target)
            if node is None or np.abs(self.points[node] - target).max() < REACHED:
                return node
        return None

    def branch(self, node: int) -> list[Array]:
        """Positions from a node to the root."""
        positions = [self.points[node]]
        while node != 0:
            node = int(self.parents[node])
            positions.append(self.points[node])
        return positions


@dataclass(frozen=True, eq=False)
class Seed:
    """One initial trajectory, or why there is none."""

    label: str  # which of the nine points it goes through
    target: Float[Array, " 3"]  # that point in the base frame [m]
    # Via points between start and goal [rad]; empty if it failed.
    vias: Float[Array, "V n"] = field(default_factory=lambda: np.empty((0, 0)))
    reason: str = ""  # why it failed; empty if it did not


def midplane_targets(
    start: Float[Array, " 3"],
    goal: Float[Array, " 3"],
    obstacles: Sequence[Box],
    inflation: float,
) -> list[tuple[str, Float[Array, " 3"]]]:
    """The middle of the line, and eight points round the obstacles' hull on the midplane.

    Args:
        start, goal: Ends of the tip's way [m].
        obstacles: Boxes.
        inflation: How far outside the hull the points lie [m].

    Returns:
        Names and points in the base frame.
    """
    middle = (start + goal) / 2
    targets = [("midpoint", middle)]
    if not obstacles:
        return targets
    axes = _midplane_axes(goal - start)
    corners = np.concatenate([box.corners for box in obstacles])
    flat = (corners - middle) @ axes.T
    hull = _flat_hull(flat)
    normals = hull.equations[:, :2]
    centre = flat[hull.vertices].mean(axis=0)
    room = -(normals @ centre + hull.equations[:, 2])
    for number in range(DIRECTIONS):
        angle = 2 * np.pi * number / DIRECTIONS
        ray = np.array([np.cos(angle), np.sin(angle)])
        outward = normals @ ray
        leaving = outward > 1e-12
        exits = room / np.where(leaving, outward, np.nan)
        distance = float(exits[leaving].min()) + inflation
        target = middle + (centre + distance * ray) @ axes
        targets.append((f"{round(np.degrees(angle))} deg", target))
    return targets


def _midplane_axes(along: Float[Array, " 3"]) -> Float[Array, "2 3"]:
    """Unit vectors of the plane across a line: the first level where that is possible, the second
    upwards.
    """
    forwards = np.array([1.0, 0.0, 0.0])
    length = np.linalg.norm(along)
    normal = along / length if length > 1e-9 else forwards
    level = np.cross([0.0, 0.0, 1.0], normal)
    size = np.linalg.norm(level)
    level = level / size if size >= 1e-6 else forwards
    return np.array([level, np.cross(normal, level)])


def _flat_hull(points: Float[Array, "k 2"]) -> ConvexHull:
    """The hull of some points of a plane, also where they have no area."""
    try:
        return ConvexHull(points)
    except QhullError:
        return ConvexHull(points, qhull_options="QJ")


def find_seeds(
    problem: PlanningProblem, rng: np.random.Generator, seconds: float = np.inf
) -> list[Seed]:
    """Looks for the nine ways; those that fail say why.

    Args:
        problem: The task.
        rng: Source of randomness.
        seconds: Processor time that may be spent, at most [s].
    """

    def now() -> float:
        return time.process_time() - compile_seconds()

    end = now() + seconds
    trees = Trees.of(problem, rng, lambda: end - now())
    return list(iterate_seeds(problem, trees))


def iterate_seeds(
    problem: PlanningProblem, trees: Trees, most: int = RANGES[-1][1]
) -> Iterator[Seed]:
    """The nine ways, each looked for when it is asked for.

    Args:
        problem: Task; its scene's obstacles shape the midplane.
        trees: Look for ways, as long as they have time.
        most: Most nodes of trees.
    """
    scene = problem.scene
    tip = tip_solver(scene.arm)
    start = tip.place(problem.start)
    goal = tip.place(problem.goal)
    girth = _girth(scene)
    obstacles = scene.in_the_way
    inflated = [midplane_targets(start, goal, obstacles, share * girth) for share in INFLATIONS]
    for ray in zip(*inflated, strict=True):
        yield _seed_along(ray, problem, trees, tip, most)


def _girth(scene: Scene) -> float:
    """Half the thickness of the arm's thickest moving box [m]: how far the tip's way must stay
    outside.
    """
    moving = [box for box in scene.boxes if box.joint > 0 and box.body >= 0]
    return max((np.sort(box.half)[1] for box in moving), default=0.0)


def _seed_along(
    ray: Sequence[tuple[str, Float[Array, " 3"]]],
    problem: PlanningProblem,
    trees: Trees,
    tip: PoseSolver,
    most: int,
) -> Seed:
    """A way through the innermost point of a ray that the tip can pass, or why there is none.

    Args:
        ray: Names and places of its points, the innermost first [m].
        problem: The task.
        trees: Look for the way, as long as they have time.
        tip: Solver of the arm's tip.
        most: Most nodes of trees.
    """
    label, target = ray[0]
    seed = Seed(label, target, reason="no time was left to look for it")
    if trees.left() <= 0.0:
        return seed
    for label, target in ray:
        vias = trees.through(target, tip, problem.ends, most)
        if not isinstance(vias, str):
            return Seed(label, target, vias)
        seed = Seed(label, target, reason=vias)
        if label == "midpoint":
            break
    return seed


def tip_solver(arm: ArmModel) -> PoseSolver:
    """Of the arm's tip: the last frame that the last joint moves."""
    frames = [frame.name for frame in arm.model.frames if frame.parentJoint == arm.n]
    return PoseSolver(arm, frames[-1])
