"""Shapes as the arrays that compiled loops read: bodies, and a tree of the ones that stand still."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ident.arrays import Array
from plan.geometry.boxes import Box
from plan.geometry.simplex import simplex_gap
from plan.geometry.solids import Solid

# Hulls of so many corners are searched as they are; of larger ones at most so many corners, or as many as it takes
# until the others stand out by less than this [m], which a radius makes up for.
FEW_CORNERS, MOST_CORNERS, STANDING_OUT = 32, 128, 2e-3
# Sides of the prism round a cylinder: its corners stand out by 0.5 % of the radius.
SIDES = 32


class CompiledBodies(NamedTuple):
    """Convex bodies; a surface is as many as it has triangles.

    Attributes:
        carrier: Number of the joint that carries each, 0 for the world.
        rot, at: Axes and centre in the joint frame.
        half: Half lengths of the box around each [m].
        core: Half lengths of its core, for those that are boxes, rods or points with a radius [m].
        radius: By which the core is grown [m].
        ball: Radius of the ball around it [m].
        first, number: Place and number of its corners; no corners for the simple ones.
        corners: Corners in the bodies' axes, from their centres [m].
        owner: Number of the shape that each belongs to.
    """

    carrier: Array
    rot: Array
    at: Array
    half: Array
    core: Array
    radius: Array
    ball: Array
    first: Array
    number: Array
    corners: Array
    owner: Array


class Points(NamedTuple):
    """As much of `CompiledBodies` as it takes to find a farthest point."""

    core: Array
    first: Array
    number: Array
    corners: Array


class Tree(NamedTuple):
    """Boxes along the base frame's axes, one inside the other, round the bodies of the world.

    Attributes:
        low, high: Of each node [m].
        left, right: Its children; -1 for a leaf.
        body: The body of a leaf.
        root: Node of each shape that stands in the world, in order; the last one is the root of all, -1 if none.
    """

    low: Array
    high: Array
    left: Array
    right: Array
    body: Array
    root: Array


def compile_bodies(boxes: Sequence[Box]) -> CompiledBodies:
    """The shapes' bodies, in the shapes' order."""
    parts = [piece for number, box in enumerate(boxes) for piece in _pieces(box, number)]
    count = np.array([len(part["corners"]) for part in parts], dtype=np.int64)
    corners = [part["corners"] for part in parts if len(part["corners"])]

    def column(name: str, *shape: int) -> Array:
        return np.ascontiguousarray(np.array([part[name] for part in parts], dtype=float).reshape(len(parts), *shape))

    def whole(name: str) -> Array:
        return np.array([part[name] for part in parts], dtype=np.int64)

    return CompiledBodies(
        carrier=whole("carrier"),
        rot=column("rot", 3, 3),
        at=column("at", 3),
        half=column("half", 3),
        core=column("core", 3),
        radius=column("radius"),
        ball=column("ball"),
        first=np.concatenate([[0], np.cumsum(count)[:-1]]).astype(np.int64) if len(parts) else whole("carrier"),
        number=count,
        corners=np.ascontiguousarray(np.concatenate(corners)) if corners else np.zeros((1, 3)),
        owner=whole("owner"),
    )


def _pieces(box: Box, number: int) -> list[dict[str, Any]]:
    solid = box.solid
    common = {"carrier": box.joint, "rot": box.rotation, "owner": number}
    if solid.kind == "surface":
        return [{**common, **_triangle(box, corners)} for corners in solid.points[solid.triangles]]
    core, radius, corners = _core(solid)
    place = {"at": box.centre, "half": box.half, "ball": solid.radius + (radius if len(corners) else 0.0)}
    grown = {**place, "half": box.half + (radius if len(corners) else 0.0)}
    return [{**common, **grown, "core": core, "radius": radius, "corners": corners}]


def _triangle(box: Box, corners: Array) -> dict[str, Any]:
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, half = (low + high) / 2, (high - low) / 2
    ball = float(np.linalg.norm(corners - middle, axis=1).max())
    at = box.centre + box.rotation @ middle
    return {"at": at, "half": half, "ball": ball, "core": half, "radius": 0.0, "corners": corners - middle}


def _core(solid: Solid) -> tuple[Array, float, Array]:
    """Half lengths of the core, radius, and corners: a simple body has no corners, any other nothing else."""
    none = np.empty((0, 3))
    if solid.kind == "box":
        return solid.size, 0.0, none
    if solid.kind == "sphere":
        return np.zeros(3), float(solid.size[0]), none
    if solid.kind == "capsule":
        return np.array([0.0, 0.0, solid.size[1]]), float(solid.size[0]), none
    if solid.kind == "cylinder":
        angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
        outer = solid.size[0] / np.cos(np.pi / SIDES)
        ring = np.column_stack([outer * np.cos(angle), outer * np.sin(angle)])
        ends = [np.column_stack([ring, np.full(SIDES, z)]) for z in (-solid.size[1], solid.size[1])]
        return solid.half, 0.0, np.concatenate(ends)
    kept, radius = thin_corners(solid.points)
    return solid.half, radius, kept


def thin_corners(corners: Array) -> tuple[Array, float]:
    """The corners of a hull that stand out most, and how far the others stand out of these ones' hull [m]."""
    if len(corners) <= FEW_CORNERS:
        return corners, 0.0
    # Directions spread evenly over the sphere, by the golden angle.
    k = np.arange(FEW_CORNERS) + 0.5
    z, turn = 1.0 - 2.0 * k / FEW_CORNERS, np.pi * (1.0 + np.sqrt(5.0)) * k
    side = np.sqrt(1.0 - z**2)
    directions = np.column_stack([side * np.cos(turn), side * np.sin(turn), z])
    chosen = np.unique(np.argmax(corners @ directions.T, axis=0))
    return _grown(np.ascontiguousarray(corners), chosen, MOST_CORNERS, STANDING_OUT)


@njit(cache=True, nogil=True)
def _grown(corners, chosen, most, small):  # type: ignore[no-untyped-def]
    """Adds the corner that stands out most until all stand out little, or until there are too many."""
    count, number = len(corners), len(chosen)
    kept = np.empty((max(most, number), 3))
    for k in range(number):
        kept[k] = corners[chosen[k]]
    bound = np.full(count, 1e9)  # a corner never stands out more from a larger hull
    axes, places = np.zeros((2, 3, 3)), np.zeros((2, 3))
    axes[0] = axes[1] = np.eye(3)
    core = np.zeros((2, 3))
    while True:
        worst, which = 0.0, -1
        pair = Points(core, np.array([0, number]), np.array([number, 1]), np.empty((number + 1, 3)))
        pair.corners[:number] = kept[:number]
        for k in range(count):
            if bound[k] > worst:
                pair.corners[number] = corners[k]
                bound[k] = max(simplex_gap(0, 1, axes, places, pair, 1e9, np.zeros(3)), 0.0)
                if bound[k] > worst:
                    worst, which = bound[k], k
        if worst <= small or number >= most:
            return kept[:number].copy(), worst
        kept[number] = corners[which]
        number += 1


def build_tree(bodies: CompiledBodies, shapes: int, first: int) -> Tree:
    """The tree of the bodies of the shapes from number `first` on, all of which stand in the world."""
    extent = np.einsum("bij,bj->bi", np.abs(bodies.rot), bodies.half)
    low, high = bodies.at - extent, bodies.at + extent
    nodes: list[tuple[Array, Array, int, int, int]] = []

    def add(a: Array, b: Array, left: int, right: int, body: int) -> int:
        nodes.append((a, b, left, right, body))
        return len(nodes) - 1

    def join(items: list[int]) -> int:
        """Joins nodes by halves along the longest side of what holds their middles."""
        if len(items) == 1:
            return items[0]
        middles = np.array([nodes[i][0] + nodes[i][1] for i in items])
        order = np.argsort(middles[:, int(np.argmax(np.ptp(middles, axis=0)))], kind="stable")
        half = len(items) // 2
        a, b = (join([items[k] for k in part]) for part in (order[:half], order[half:]))
        return add(np.minimum(nodes[a][0], nodes[b][0]), np.maximum(nodes[a][1], nodes[b][1]), a, b, -1)

    roots = []
    for shape in range(first, shapes):
        leaves = [add(low[i], high[i], -1, -1, int(i)) for i in np.flatnonzero(bodies.owner == shape)]
        roots.append(join(leaves))
    roots.append(join(list(roots)) if roots else -1)
    if not nodes:
        add(np.zeros(3), np.zeros(3), -1, -1, -1)
    a, b, left, right, body = zip(*nodes, strict=True)
    whole = [np.array(part, dtype=np.int64) for part in (left, right, body, roots)]
    return Tree(np.array(a), np.array(b), *whole)
