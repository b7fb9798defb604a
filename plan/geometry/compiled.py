"""A scene as the arrays that compiled loops read: bodies, a tree of the ones that stand still, and room for places."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.arrays import Array
from ident.compiled import compiled
from ident.robot.chain import Chain
from plan.geometry.separation import simplex_gap
from plan.geometry.solids import Box, Solid

# Hulls of so many corners are searched as they are; of larger ones at most so many corners, or as many as it takes
# until the others stand out by less than this [m], which a radius makes up for.
FEW_CORNERS, MOST_CORNERS, STANDING_OUT = 32, 128, 2e-3
# Deepest tree that can be searched.
DEEPEST = 128
# Sides of the prism round a cylinder: its corners stand out by 0.5 % of the radius.
SIDES = 32
NO_CORNERS = np.empty((0, 3))


class CompiledBodies(NamedTuple):
    """Convex bodies; a surface is as many as it has triangles, a cloud as many as it has points.

    Behind all shapes stand the parts of hulls that are not convex themselves: a hull that comes near is looked at by
    its parts.
    """

    carrier: Array  # number of the joint that carries each, 0 for the world
    rot: Array  # axes and centre in the joint frame
    at: Array
    placed_rot: Array  # the same in the base frame; those of links are room that loops write into
    placed_at: Array
    half: Array  # half lengths of the box around each [m]
    core: Array  # half lengths of its core, for those that are boxes, rods or points with a radius [m]
    radius: Array  # by which the core is grown [m]
    ball: Array  # radius of the ball around it [m]
    first: Array  # place and number of its corners; no corners for the simple ones
    number: Array
    corners: Array  # corners in the bodies' axes, from their centres [m]
    owner: Array  # number of the shape that each belongs to
    part: Array  # the first of a hull's parts, and their number; no parts of what is convex
    parts: Array


class Points(NamedTuple):
    """As much of `CompiledBodies` as it takes to find a farthest point."""

    placed_rot: Array
    placed_at: Array
    core: Array
    first: Array
    number: Array
    corners: Array


class Tree(NamedTuple):
    """Boxes along the base frame's axes, one inside the other, round the bodies of the world."""

    low: Array  # of each node [m]
    high: Array
    left: Array  # its children; -1 for a leaf
    right: Array
    body: Array  # the body of a leaf
    root: Array  # node of each shape that stands in the world, in order; the last one is the root of all, -1 if none


class CompiledScene(NamedTuple):
    """A scene for compiled loops."""

    chain: Chain  # the arm's kinematics
    links: int  # number of the arm's shapes, each of them one body, which come first
    bodies: CompiledBodies  # of all shapes
    tree: Tree  # of those that stand in the world
    frame_rot: Array  # room for axes and origins of the joint frames; frame 0 is the world
    frame_at: Array
    reach: Array  # room for a number of each joint


def compile_scene(chain: Chain, boxes: Sequence[Box], links: int) -> CompiledScene:
    """Shapes for compiled loops, the arm's first; with room to write into, so for one thread at a time."""
    bodies, n = compile_bodies(boxes), len(chain.masses)
    # The tree of what stands in the world: the bodies of all shapes behind the links.
    owned = np.flatnonzero((bodies.owner >= links) & (bodies.owner < len(boxes)))
    extent = np.einsum("bij,bj->bi", np.abs(bodies.rot[owned]), bodies.half[owned])
    room = np.zeros((len(owned) + 1, 3))  # of which a root of nothing at all takes one
    low, high = (np.concatenate([bodies.at[owned] + sign * extent, room]) for sign in (-1.0, 1.0))
    nodes = np.full((3, len(low)), -1, dtype=np.int64)  # left, right, body
    nodes[2, : len(owned)] = owned
    roots, used = [], len(owned)
    for start, stop in itertools.pairwise(np.searchsorted(bodies.owner[owned], np.arange(links, len(boxes) + 1))):
        root, used = _join(np.arange(start, stop), low, high, nodes, used)
        roots.append(root)
    whole = _join(np.array(roots), low, high, nodes, used)[0] if roots else -1
    tree = Tree(low, high, nodes[0], nodes[1], nodes[2], np.array([*roots, whole], dtype=np.int64))
    placed = bodies._replace(placed_rot=bodies.rot.copy(), placed_at=bodies.at.copy())
    return CompiledScene(chain, links, placed, tree, np.empty((n + 1, 3, 3)), np.empty((n + 1, 3)), np.empty(n))


def compile_bodies(boxes: Sequence[Box]) -> CompiledBodies:
    """The bodies of some shapes, in their order, and the parts of hulls behind them."""
    parted = [number for number, box in enumerate(boxes) if box.solid.parts]
    behind = [len(boxes[number].parts) for number in parted]
    shapes = [*boxes, *(part for number in parted for part in boxes[number].parts)]
    axes, at, half, core, radius, ball, corners = zip(*map(_bodies_of, shapes), strict=True)
    counts = [len(one) for one in at]
    begin, number = np.cumsum([0, *counts]), np.repeat([one.shape[1] for one in corners], counts)
    part, parts = np.zeros((2, begin[-1]), dtype=np.int64)
    parts[begin[parted]], part[begin[parted]] = behind, begin[len(boxes)] + np.cumsum([0, *behind])[:-1]
    rot, centres = np.repeat(axes, counts, axis=0), np.concatenate(at)
    return CompiledBodies(
        carrier=np.repeat([one.joint for one in shapes], counts),
        rot=rot,
        at=centres,
        placed_rot=rot,
        placed_at=centres,
        half=np.concatenate(half),
        core=np.concatenate(core),
        radius=np.repeat(radius, counts),
        ball=np.concatenate(ball),
        first=1 + np.cumsum(number) - number,
        number=number,
        corners=np.concatenate([np.zeros((1, 3)), *(one.reshape(-1, 3) for one in corners)]),
        owner=np.repeat([*range(len(boxes)), *np.repeat(parted, behind)], counts).astype(np.int64),
        part=part,
        parts=parts,
    )


def _bodies_of(box: Box) -> tuple[Array, Array, Array, Array, float, Array, Array]:
    """Axes, centres, half lengths, cores, radius, balls and corners of a shape's bodies, which are all turned alike."""
    solid = box.solid
    if solid.kind == "cloud":
        at, radius = box.centre + solid.points @ box.rotation.T, float(solid.size[0])
        half = np.full((len(at), 3), radius)
        # A ball has no axes, and its box along the base's is the smallest.
        return np.eye(3), at, half, np.zeros_like(half), radius, half[:, 0], np.empty((len(at), 0, 3))
    if solid.kind == "surface":
        corners = solid.points[solid.triangles]
        low, high = corners.min(axis=1), corners.max(axis=1)
        middle, half = (low + high) / 2, (high - low) / 2
        local = corners - middle[:, None]
        ball = np.linalg.norm(local, axis=2).max(axis=1)
        return box.rotation, box.centre + middle @ box.rotation.T, half, half, 0.0, ball, local
    core, radius, corners = _core(solid)
    extra = radius if len(corners) else 0.0
    half, ball = (box.half + extra)[None], np.array([solid.radius + extra])
    return box.rotation, box.centre[None], half, core[None], radius, ball, corners[None]


def _core(solid: Solid) -> tuple[Array, float, Array]:
    """Half lengths of the core, radius, and corners: a simple body has no corners, any other nothing else."""
    if solid.kind == "box":
        return solid.size, 0.0, NO_CORNERS
    if solid.kind == "sphere":
        return np.zeros(3), float(solid.size[0]), NO_CORNERS
    if solid.kind == "capsule":
        return np.array([0.0, 0.0, solid.size[1]]), float(solid.size[0]), NO_CORNERS
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


@compiled(nogil=True)
def _grown(corners, chosen, most, small):  # type: ignore[no-untyped-def]
    """Adds the corner that stands out most until all stand out little, or until there are too many."""
    count, number = len(corners), len(chosen)
    kept = np.empty((max(most, number), 3))
    for k in range(number):
        kept[k] = corners[chosen[k]]
    bound = np.full(count, 1e9)  # a corner never stands out more from a larger hull
    axes, zero = np.zeros((2, 3, 3)), np.zeros((2, 3))
    axes[0] = axes[1] = np.eye(3)
    while True:
        worst, which = 0.0, -1
        pair = Points(axes, zero, zero, np.array([0, number]), np.array([number, 1]), np.empty((number + 1, 3)))
        pair.corners[:number] = kept[:number]
        for k in range(count):
            if bound[k] > worst:
                pair.corners[number] = corners[k]
                bound[k] = max(simplex_gap(0, 1, pair, 1e9, np.zeros(3)), 0.0)
                if bound[k] > worst:
                    worst, which = bound[k], k
        if worst <= small or number >= most:
            return kept[:number].copy(), worst
        kept[number] = corners[which]
        number += 1


@compiled(nogil=True)
def _join(items, low, high, links, used):  # type: ignore[no-untyped-def]
    """Joins nodes by halves along the longest side of what holds their middles; returns the root and the nodes used."""
    if len(items) == 1:
        return items[0], used
    middles, node = low[items] + high[items], used
    sides = np.array([middles[:, k].max() - middles[:, k].min() for k in range(3)])
    items = items[np.argsort(middles[:, np.argmax(sides)], kind="mergesort")]
    left, used = _join(items[: len(items) // 2], low, high, links, node + 1)
    right, used = _join(items[len(items) // 2 :], low, high, links, used)
    links[0, node], links[1, node] = left, right
    low[node], high[node] = np.minimum(low[left], low[right]), np.maximum(high[left], high[right])
    return node, used
