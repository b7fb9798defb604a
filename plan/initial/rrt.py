"""Bi-directional rapidly-exploring random trees between two positions, and the paper's pruning of their paths."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from plan.geometry.margins import Margins
from plan.geometry.scene import Scene

# Gaps beyond their margins by more than this are all the same to a tree [m].
NEAR = 0.01


def endless() -> float:
    """Time without end [s]."""
    return math.inf


@dataclass(frozen=True, eq=False)
class TreeOptions:
    """How the trees grow.

    Attributes:
        step: Longest edge, by the largest joint difference [rad].
        resolution: Distance at which edges are checked [rad]; the final motion is checked without gaps.
        nodes: Most nodes of both trees, and most positions that are drawn.
        margins: Clearance that every node and edge keeps, of each pair or of all [m].
        left: Processor time that is left, at which trees end [s].
    """

    step: float = 0.35
    resolution: float = 0.04
    nodes: int = 4000
    margins: Margins | float = 0.0
    left: Callable[[], float] = endless


@dataclass(frozen=True)
class Path:
    """What a search between two positions gave.

    Attributes:
        points: Positions from start to goal, shape (k, n) [rad]; empty if none was found.
        nodes: Nodes grown.
        reason: Why none was found; empty if one was.
    """

    points: Float[Array, "k n"]
    nodes: int
    reason: str = ""

    @property
    def found(self) -> bool:
        """Whether a path was found."""
        return not self.reason


class _Tree:
    """Positions and their parents; nearest neighbours by a scan, which for some thousand nodes is quick enough."""

    def __init__(self, root: Array, capacity: int) -> None:
        self.points = np.empty((capacity + 1, len(root)))
        self.points[0] = root
        self.parents = np.zeros(capacity + 1, dtype=int)
        self.size = 1

    def nearest(self, q: Array) -> int:
        difference = self.points[: self.size] - q
        return int(np.argmin(np.einsum("ij,ij->i", difference, difference)))

    def add(self, q: Array, parent: int) -> int:
        self.points[self.size], self.parents[self.size] = q, parent
        self.size += 1
        return self.size - 1

    def branch(self, node: int) -> list[Array]:
        """Positions from a node to the root."""
        found = [self.points[node]]
        while node != 0:
            node = int(self.parents[node])
            found.append(self.points[node])
        return found


def is_free(scene: Scene, q: Float[Array, "T n"], margins: Margins | float) -> bool:
    """Whether all positions keep the margins."""
    return bool(scene.separation(q, margins, NEAR).min() > 0.0)


def edge_is_free(scene: Scene, a: Float[Array, " n"], b: Float[Array, " n"], options: TreeOptions) -> bool:
    """Whether the straight line between two positions keeps the margin, at the given resolution."""
    count = int(np.ceil(np.abs(b - a).max() / options.resolution)) + 1
    share = np.linspace(0.0, 1.0, count + 1)[1:, None]
    return is_free(scene, a + share * (b - a), options.margins)


def connect(
    scene: Scene,
    start: Float[Array, " n"],
    goal: Float[Array, " n"],
    low: Float[Array, " n"],
    high: Float[Array, " n"],
    options: TreeOptions,
    rng: np.random.Generator,
) -> Path:
    """Grows a tree from each end, each new branch pulling the other tree towards itself.

    Args:
        scene: What to keep clear of.
        start, goal: Ends [rad].
        low, high: Where random positions are drawn [rad].
        options: How the trees grow.
        rng: Source of randomness.
    """
    for name, q in (("start", start), ("target", goal)):
        if not is_free(scene, q[None], options.margins):
            return Path(np.empty((0, len(start))), 0, f"the {name} of this search is in collision")
    trees = _Tree(start, options.nodes), _Tree(goal, options.nodes)
    swapped = False
    if edge_is_free(scene, start, goal, options):
        return Path(np.array([start, goal]), 2)
    for _ in range(options.nodes):
        if trees[0].size + trees[1].size >= options.nodes or options.left() <= 0.0:
            break
        near, far = trees if not swapped else trees[::-1]
        grown = _extend(scene, near, rng.uniform(low, high), options)
        if grown is not None:
            met = _pull(scene, far, near.points[grown], options)
            if met is not None:
                halves = near.branch(grown)[::-1], far.branch(met)[1:]
                points = np.array([*halves[0], *halves[1]])
                return Path(points[::-1] if swapped else points, near.size + far.size)
        swapped = not swapped
    return Path(np.empty((0, len(start))), options.nodes, f"no way found with {options.nodes} nodes")


def _extend(scene: Scene, tree: _Tree, towards: Array, options: TreeOptions) -> int | None:
    """One step from the nearest node; the new node's number, or None if it is blocked."""
    nearest = tree.nearest(towards)
    origin = tree.points[nearest]
    reach = float(np.abs(towards - origin).max())
    target = origin + (towards - origin) * min(1.0, options.step / max(reach, 1e-12))
    return tree.add(target, nearest) if edge_is_free(scene, origin, target, options) else None


def _pull(scene: Scene, tree: _Tree, target: Array, options: TreeOptions) -> int | None:
    """Steps towards a position until it is reached (its number) or the way is blocked (None)."""
    while tree.size < options.nodes:
        node = _extend(scene, tree, target, options)
        if node is None:
            return None
        if np.abs(tree.points[node] - target).max() < 1e-9:
            return node
    return None


def prune(scene: Scene, points: Float[Array, "k n"], options: TreeOptions) -> Float[Array, "m n"]:
    """Takes out nodes without which the path is shorter and still free, from the start on, until none can go.

    By the triangle inequality a path without a node is never longer. Source: paper, section 3.1.
    """
    kept = list(points)
    changed = True
    while changed:
        changed = False
        i = 1
        while i < len(kept) - 1:
            if edge_is_free(scene, kept[i - 1], kept[i + 1], options):
                del kept[i]
                changed = True
            else:
                i += 1
    return np.array(kept)
