"""Bi-directional rapidly-exploring random trees between two positions, and the paper's pruning of their paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from plan.geometry.pairs import Margins
from plan.geometry.scene import Scene
from plan.problem.problem import PlanningProblem

# Gaps beyond their margins by more than this are all the same to a tree [m].
NEAR = 0.01
# Longest edge, and distance at which edges are looked at, by the largest joint difference [rad]; the final motion is
# checked without gaps.
STEP, RESOLUTION = 0.35, 0.04


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
    margins: Margins | float = 0.0  # clearance that every node and edge keeps, of each pair or of all [m]
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
