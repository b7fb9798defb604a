"""Shapes as the arrays that compiled loops read: bodies, and a tree of the ones that stand still."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numba import njit

from ident.arrays import Array
from plan.geometry.boxes import Box
from plan.geometry.simplex import simplex_gap
from plan.geometry.solids import Solid

# Hulls of so many corners are searched as they are; of larger ones at most so many corners, or as many as it takes
# until the others stand out by less than this [m], which a radius makes up for.
FEW_CORNERS, MOST_CORNERS, STANDING_OUT = 32, 128, 2e-3
# Deepest tree that can be searched, or built.
DEEPEST = 128
# Sides of the prism round a cylinder: its corners stand out by 0.5 % of the radius.
SIDES = 32


class CompiledBodies(NamedTuple):
    """Convex bodies; a surface is as many as it has triangles, a cloud as many as it has points.

    Behind all shapes stand the parts of hulls that are not convex themselves: a hull that comes near is looked at by
    its parts.

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
        part, parts: The first of a hull's parts, and their number; no parts of what is convex.
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
    part: Array
    parts: Array


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
    shapes = [_pieces(box, number) for number, box in enumerate(boxes)]
    parted = [number for number, box in enumerate(boxes) if box.solid.parts]
    parts = [*shapes, *(_pieces(part, number) for number in parted for part in boxes[number].parts)]
    first, count = _parts_of(boxes, parted, shapes)
    number = np.concatenate([part.number for part in parts]) if parts else np.empty(0, dtype=np.int64)
    corners = [part.corners for part in parts if len(part.corners)]
    return CompiledBodies(
        carrier=_column(parts, "carrier", np.int64),
        rot=_column(parts, "rot", float, 3, 3),
        at=_column(parts, "at", float, 3),
        half=_column(parts, "half", float, 3),
        core=_column(parts, "core", float, 3),
        radius=_column(parts, "radius", float),
        ball=_column(parts, "ball", float),
        first=np.concatenate([[0], np.cumsum(number)[:-1]]).astype(np.int64) if len(number) else number,
        number=number,
        corners=np.ascontiguousarray(np.concatenate(corners)) if corners else np.zeros((1, 3)),
        owner=_column(parts, "owner", np.int64),
        part=first,
        parts=count,
    )


def _parts_of(boxes: Sequence[Box], parted: Sequence[int], shapes: Sequence[CompiledBodies]) -> tuple[Array, Array]:
    """The first of each body's parts, which stand behind the bodies of all shapes, and their number."""
    before = [len(shape.owner) for shape in shapes]
    own, begin = np.cumsum([0, *before]), sum(before)
    counts = [len(boxes[number].parts) for number in parted]
    first, count = np.zeros((2, begin + sum(counts)), dtype=np.int64)
    count[own[list(parted)]], first[own[list(parted)]] = counts, begin + np.cumsum([0, *counts])[:-1]
    return first, count


def _column(parts: Sequence[CompiledBodies], name: str, kind: type, *shape: int) -> Array:
    found: list[Array] = [np.asarray(getattr(part, name), dtype=kind) for part in parts]
    return np.ascontiguousarray(np.concatenate(found)) if found else np.empty((0, *shape), dtype=kind)


def _pieces(box: Box, number: int) -> CompiledBodies:
    """The bodies of one shape; places of corners are left out."""
    solid = box.solid
    if solid.kind == "cloud":
        points, radius = box.centre + solid.points @ box.rotation.T, float(solid.size[0])
        alike = np.full((len(points), 3), radius)
        upright = replace(box, rotation=np.eye(3))  # a ball has no axes, and its box along the base's is the smallest
        return _alike(upright, number, points, alike, np.zeros_like(alike), radius, alike[:, 0], np.empty((0, 0, 3)))
    if solid.kind in ("surface", "heights"):
        corners = solid.prisms() if solid.kind == "heights" else solid.points[solid.triangles]
        low, high = corners.min(axis=1), corners.max(axis=1)
        middle, half = (low + high) / 2, (high - low) / 2
        local = corners - middle[:, None]
        ball = np.linalg.norm(local, axis=2).max(axis=1)
        return _alike(box, number, box.centre + middle @ box.rotation.T, half, half, 0.0, ball, local)
    core, radius, corners = _core(solid)
    extra = radius if len(corners) else 0.0
    at, half, ball = box.centre[None], (box.half + extra)[None], np.array([solid.radius + extra])
    return _alike(box, number, at, half, core[None], radius, ball, corners[None])


def _alike(
    box: Box, number: int, at: Array, half: Array, core: Array, radius: float, ball: Array, corners: Array
) -> CompiledBodies:
    """Bodies of one shape, all turned as it is and with as many corners each."""
    count = len(at)
    return CompiledBodies(
        carrier=np.full(count, box.joint),
        rot=np.repeat(box.rotation[None], count, axis=0),
        at=at,
        half=half,
        core=core,
        radius=np.full(count, radius),
        ball=ball,
        first=np.empty(0),
        number=np.full(count, corners.shape[1] if len(corners) else 0, dtype=np.int64),
        corners=corners.reshape(-1, 3),
        owner=np.full(count, number),
        part=np.empty(0),
        parts=np.empty(0),
    )


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
    owned = np.flatnonzero((bodies.owner >= first) & (bodies.owner < shapes))
    count, most = len(owned), max(2 * len(owned), 1)
    low, high = np.zeros((most, 3)), np.zeros((most, 3))
    extent = np.einsum("bij,bj->bi", np.abs(bodies.rot[owned]), bodies.half[owned])
    low[:count], high[:count] = bodies.at[owned] - extent, bodies.at[owned] + extent
    links = np.full((3, most), -1, dtype=np.int64)  # left, right, body
    links[2, :count] = owned
    ends = np.searchsorted(bodies.owner[owned], np.arange(first, shapes + 1))
    roots, used = [], count
    for start, stop in itertools.pairwise(ends):
        root, used = _join(np.arange(start, stop), low, high, links, used)
        roots.append(root)
    root = -1
    if roots:
        root, used = _join(np.array(roots), low, high, links, used)
    used = max(used, 1)
    left, right, body = (np.ascontiguousarray(part[:used]) for part in links)
    return Tree(low[:used], high[:used], left, right, body, np.array([*roots, root], dtype=np.int64))


@njit(cache=True, nogil=True)
def _join(items, low, high, links, used):  # type: ignore[no-untyped-def]
    """Joins nodes by halves along the longest side of what holds their middles; returns the root and the nodes used."""
    items = items.copy()
    waiting = np.empty((DEEPEST, 4), dtype=np.int64)  # from, to, parent, which child
    waiting[0, 0], waiting[0, 1], waiting[0, 2], waiting[0, 3] = 0, len(items), -1, 0
    count, root = 1, -1
    while count > 0:
        count -= 1
        start, stop, parent, side = waiting[count]
        node = items[start]
        if stop - start > 1:
            node, used = used, used + 1
            low[node], high[node] = low[items[start]], high[items[start]]
            spread = np.empty((2, 3))
            spread[0] = spread[1] = low[items[start]] + high[items[start]]
            for i in items[start:stop]:
                for k in range(3):
                    low[node, k], high[node, k] = min(low[node, k], low[i, k]), max(high[node, k], high[i, k])
                    middle = low[i, k] + high[i, k]
                    spread[0, k], spread[1, k] = min(spread[0, k], middle), max(spread[1, k], middle)
            axis = int(np.argmax(spread[1] - spread[0]))
            middles = np.empty(stop - start)
            for m in range(stop - start):
                middles[m] = low[items[start + m], axis] + high[items[start + m], axis]
            items[start:stop] = items[start:stop][np.argsort(middles, kind="mergesort")]
            half = start + (stop - start) // 2
            for which in range(2):
                place = waiting[count + which]
                place[0], place[1] = (start, half) if which == 0 else (half, stop)
                place[2], place[3] = node, which
            count += 2
        if parent < 0:
            root = node
        else:
            links[side, parent] = node
    return root, used
