"""A scene as the arrays that compiled loops read.

Bodies, a tree of the ones that stand still, and room for places.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float, Int, freeze
from ident.compiled import compiled
from ident.robot.chain import Chain
from plan.dynamics.rigid import joint_rows
from plan.geometry.simplex import simplex_gap
from plan.geometry.solids import Box, Solid

# Hulls of so many corners are searched as they are.
FEW_CORNERS = 32
# Of larger ones at most so many corners, or as many as it takes until the others stand out by less
# than this [m], which a radius makes up for.
MOST_CORNERS = 128
STANDING_OUT = 2e-3
# Deepest tree that can be searched.
DEEPEST = 128
# Sides of the prism round a cylinder: its corners stand out by 0.5 % of the radius.
SIDES = 32
NO_CORNERS = np.empty((0, 3))


# What loops read of a body. A row is one argument where a column each would be fifteen: that halves
# what a loop takes to compile.
BODY = np.dtype(
    [
        ("carrier", np.int64),  # number of the joint that carries it, 0 for the world
        ("rot", np.float64, (3, 3)),  # axes and centre in the joint frame
        ("at", np.float64, (3,)),
        ("placed_rot", np.float64, (3, 3)),  # the same in the base frame; loops write a link's
        ("placed_at", np.float64, (3,)),
        ("half", np.float64, (3,)),  # half lengths of the box around it [m]
        # Half lengths of its core, where that is a box, a rod or a point with a radius [m].
        ("core", np.float64, (3,)),
        ("radius", np.float64),  # by which the core is grown [m]
        ("ball", np.float64),  # radius of the ball around it [m]
        ("first", np.int64),  # place and number of its corners; no corners for the simple ones
        ("number", np.int64),
        ("owner", np.int64),  # number of the shape that it belongs to
        ("part", np.int64),  # the first of a hull's parts, and their number; no parts if convex
        ("parts", np.int64),
    ],
    align=True,
)
# A node of a tree: a box along the base frame's axes [m], the numbers of its children and of a
# leaf's body, -1 for none.
NODE = np.dtype(
    [
        ("low", np.float64, (3,)),
        ("high", np.float64, (3,)),
        ("left", np.int64),
        ("right", np.int64),
        ("body", np.int64),
    ],
    align=True,
)


class CompiledBodies(NamedTuple):
    """Convex bodies; a surface is as many as it has triangles, a cloud as many as it has points.

    Behind all shapes stand the parts of hulls that are not convex themselves: a hull that comes
    near is looked at by its parts.
    """

    each: Array  # a row of `BODY` for each
    corners: Array  # corners in the bodies' axes, from their centres [m]


class Tree(NamedTuple):
    """Boxes along the base frame's axes, one inside the other, round the bodies of the world."""

    nodes: Array  # a row of `NODE` for each
    # Node of each shape that stands in the world, in order, and the root of all, -1 if none.
    root: Array


class CompiledScene(NamedTuple):
    """A scene for compiled loops."""

    chain: Array  # the arm's joints, see `joint_rows`
    links: int  # number of the arm's shapes, each of them one body, which come first
    bodies: CompiledBodies  # of all shapes
    tree: Tree  # of those that stand in the world
    frame_rot: Array  # room for axes and origins of the joint frames; frame 0 is the world
    frame_at: Array
    reach: Array  # room for a number of each joint


def compile_scene(chain: Chain, boxes: Sequence[Box], links: int) -> CompiledScene:
    """Shapes for compiled loops, the arm's first.

    With room to write into, so for a single thread.

    Args:
        chain: The arm's kinematics.
        boxes: All shapes, those of the arm first.
        links: How many of them are the arm's.
    """
    bodies = compile_bodies(boxes)
    tree = _build_tree(bodies, links, len(boxes))
    n = len(chain.masses)
    return CompiledScene(
        chain=joint_rows(chain),
        links=links,
        bodies=bodies,
        tree=tree,
        frame_rot=np.empty((n + 1, 3, 3)),
        frame_at=np.empty((n + 1, 3)),
        reach=np.empty(n),
    )


def _build_tree(bodies: CompiledBodies, links: int, shapes: int) -> Tree:
    """The tree of what stands in the world: the bodies of all shapes behind the links.

    Args:
        bodies: Of all shapes.
        links: Number of the arm's shapes.
        shapes: Number of all.
    """
    owner = bodies.each["owner"]
    standing = np.flatnonzero((owner >= links) & (owner < shapes))
    rows = bodies.each[standing]
    extent = np.einsum("bij,bj->bi", np.abs(rows["rot"]), rows["half"])
    room = np.zeros((len(standing) + 1, 3))  # of which a root of nothing at all takes a row
    low = np.concatenate([rows["at"] - extent, room])
    high = np.concatenate([rows["at"] + extent, room])
    nodes = np.full((3, len(low)), -1, dtype=np.int64)  # left, right, body
    nodes[2, : len(standing)] = standing
    begins = np.searchsorted(rows["owner"], np.arange(links, shapes + 1))
    used = len(standing)
    roots = []
    for start, stop in itertools.pairwise(begins):
        root, used = _join(np.arange(start, stop), low, high, nodes, used)
        roots.append(root)
    whole = -1
    if roots:
        whole, used = _join(np.array(roots), low, high, nodes, used)
    columns = (low, high, *nodes)
    tree = np.empty(len(low), NODE)
    for name, column in zip(NODE.names or (), columns, strict=True):
        tree[name] = column
    return Tree(tree, np.array([*roots, whole], dtype=np.int64))


class ShapeBodies(NamedTuple):
    """The bodies of a shape, which are all turned alike."""

    rotation: Array  # axes in the joint frame
    centres: Array  # in the joint frame [m]
    half: Array  # half lengths of the box around each [m]
    core: Array  # half lengths of each one's core [m]
    radius: float  # by which the cores are grown [m]
    ball: Array  # radius of the ball around each [m]
    corners: Array  # corners of each, from its centre [m]


def compile_bodies(boxes: Sequence[Box]) -> CompiledBodies:
    """The bodies of some shapes, in their order, and the parts of hulls behind them."""
    parted = [number for number, box in enumerate(boxes) if box.solid.parts]
    pieces = [len(boxes[number].parts) for number in parted]
    shapes = list(boxes)
    owners = list(range(len(boxes)))
    for number in parted:
        shapes += boxes[number].parts
        owners += [number] * len(boxes[number].parts)
    shape_bodies = [_bodies_of(shape) for shape in shapes]
    counts = [len(bodies.centres) for bodies in shape_bodies]
    begin = np.cumsum([0, *counts])
    first_piece = np.zeros(begin[-1], dtype=np.int64)
    pieces_of = np.zeros(begin[-1], dtype=np.int64)
    first_piece[begin[parted]] = begin[len(boxes)] + np.cumsum([0, *pieces])[:-1]
    pieces_of[begin[parted]] = pieces
    rotations = np.repeat([bodies.rotation for bodies in shape_bodies], counts, axis=0)
    centres = np.concatenate([bodies.centres for bodies in shape_bodies])
    corner_counts = np.repeat([bodies.corners.shape[1] for bodies in shape_bodies], counts)
    corners = [bodies.corners.reshape(-1, 3) for bodies in shape_bodies]
    each = np.zeros(begin[-1], BODY)
    each["carrier"] = np.repeat([shape.joint for shape in shapes], counts)
    for axes in ("rot", "placed_rot"):
        each[axes] = rotations
    for place in ("at", "placed_at"):
        each[place] = centres
    for name in ("half", "core", "ball"):
        each[name] = np.concatenate([getattr(bodies, name) for bodies in shape_bodies])
    each["radius"] = np.repeat([bodies.radius for bodies in shape_bodies], counts)
    each["first"] = 1 + np.cumsum(corner_counts) - corner_counts
    each["number"] = corner_counts
    each["owner"] = np.repeat(owners, counts)
    each["part"] = first_piece
    each["parts"] = pieces_of
    return CompiledBodies(each, np.concatenate([np.zeros((1, 3)), *corners]))


def _bodies_of(box: Box) -> ShapeBodies:
    """A shape's bodies."""
    if box.solid.kind == "cloud":
        return _bodies_of_cloud(box)
    if box.solid.kind == "surface":
        return _bodies_of_surface(box)
    core, radius, corners = _core(box.solid)
    extra = radius if len(corners) else 0.0
    return ShapeBodies(
        rotation=box.rotation,
        centres=box.centre[None],
        half=(box.half + extra)[None],
        core=core[None],
        radius=radius,
        ball=np.array([box.solid.radius + extra]),
        corners=corners[None],
    )


def _bodies_of_cloud(box: Box) -> ShapeBodies:
    """A ball for each point."""
    centres = box.centre + box.solid.points @ box.rotation.T
    radius = float(box.solid.size[0])
    half = np.full((len(centres), 3), radius)
    return ShapeBodies(
        # A ball has no axes, and its box along the base's is the smallest.
        rotation=np.eye(3),
        centres=centres,
        half=half,
        core=np.zeros_like(half),
        radius=radius,
        ball=half[:, 0],
        corners=np.empty((len(centres), 0, 3)),
    )


def _bodies_of_surface(box: Box) -> ShapeBodies:
    """A body for each triangle."""
    corners = box.solid.points[box.solid.triangles]
    low = corners.min(axis=1)
    high = corners.max(axis=1)
    middle = (low + high) / 2
    half = (high - low) / 2
    local = corners - middle[:, None]
    return ShapeBodies(
        rotation=box.rotation,
        centres=box.centre + middle @ box.rotation.T,
        half=half,
        core=half,
        radius=0.0,
        ball=np.linalg.norm(local, axis=2).max(axis=1),
        corners=local,
    )


def _core(solid: Solid) -> tuple[Array, float, Array]:
    """Half lengths of the core, radius, and corners.

    A simple body has no corners, any other nothing else.
    """
    if solid.kind == "box":
        return solid.size, 0.0, NO_CORNERS
    if solid.kind == "sphere":
        return np.zeros(3), float(solid.size[0]), NO_CORNERS
    if solid.kind == "capsule":
        radius, length = solid.size
        return np.array([0.0, 0.0, length]), float(radius), NO_CORNERS
    if solid.kind == "cylinder":
        return solid.half, 0.0, _prism(solid)
    corners, radius = thin_corners(solid.points)
    return solid.half, radius, corners


def _prism(cylinder: Solid) -> Float[Array, "k 3"]:
    """Corners of the prism round a cylinder [m]."""
    radius, length = cylinder.size
    angle = 2.0 * np.pi * np.arange(SIDES) / SIDES
    outer = radius / np.cos(np.pi / SIDES)
    ring = np.column_stack([outer * np.cos(angle), outer * np.sin(angle)])
    ends = [np.column_stack([ring, np.full(SIDES, z)]) for z in (-length, length)]
    return np.concatenate(ends)


def thin_corners(corners: Array) -> tuple[Array, float]:
    """The corners of a hull that stand out most, and how far the others stand out of these [m].

    Args:
        corners: The hull's (k, 3) [m].

    Returns:
        Those kept, and the distance [m]; all of them and 0 where they are few.
    """
    if len(corners) <= FEW_CORNERS:
        return corners, 0.0
    directions = _spread_directions(FEW_CORNERS)
    chosen = np.unique(np.argmax(corners @ directions.T, axis=0))
    return _grown(corners, chosen, MOST_CORNERS, STANDING_OUT)


def _spread_directions(count: int) -> Float[Array, "{count} 3"]:
    """Directions spread evenly over the sphere, by the golden angle."""
    number = np.arange(count) + 0.5
    height = 1.0 - 2.0 * number / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - height**2)
    return np.column_stack([level * np.cos(turn), level * np.sin(turn), height])


def _grown(
    corners: Array, chosen: Int[Array, " k"], most: int, small: float
) -> tuple[Array, float]:
    """Adds the corner that stands out most until all stand out little, or there are too many."""
    number = len(chosen)
    room = np.zeros((max(most, number) + 1, 3))  # the hull's corners, and the one looked at
    room[:number] = corners[chosen]
    pair = CompiledBodies(np.zeros(2, BODY), room)
    pair.each["placed_rot"] = np.eye(3)
    pair.each["first"][1] = len(room) - 1
    pair.each["number"] = number, 1
    pair.each["owner"] = 0, 1
    worst = _grow(freeze(np.ascontiguousarray(corners)), pair, most, small)
    return room[: pair.each["number"][0]].copy(), worst


@compiled(nogil=True, error_model="numpy")
def _grow(corners, pair, most, small):  # type: ignore[no-untyped-def]
    """Adds corners to the first of two bodies; by how much the others stand out then [m].

    Args:
        corners: All that may be added, shape (k, 3) [m].
        pair: The hull, with room for more corners, and a body of one corner behind that room. Their
            numbers are read from it, as numbers that are written here are compiled apart.
        most: Corners of the hull, at the most.
        small: What may stand out [m].
    """
    hull = pair.each.owner[0]
    point = pair.each.owner[1]
    place = pair.each.first[point]
    warm = np.empty(3)
    bound = np.empty(corners.shape[0])  # a corner never stands out more from a larger hull
    bound[:] = np.inf
    while True:
        worst = 0.0
        which = -1
        for k in range(corners.shape[0]):
            if bound[k] > worst:
                for m in range(3):
                    pair.corners[place, m] = corners[k, m]
                    warm[m] = 0.0
                bound[k] = max(simplex_gap(hull, point, pair, np.inf, warm), 0.0)
                if bound[k] > worst:
                    worst = bound[k]
                    which = k
        number = pair.each.number[hull]
        if worst <= small or number >= most:
            return worst
        for m in range(3):
            pair.corners[number, m] = corners[which, m]
        pair.each.number[hull] = number + 1


def _join(
    items: Int[Array, " k"],
    low: Float[Array, "N 3"],
    high: Float[Array, "N 3"],
    nodes: Int[Array, "3 N"],
    used: int,
) -> tuple[int, int]:
    """Joins nodes by halves along the longest side of what holds their middles.

    All parts of a level of the tree are halved together.

    Args:
        items: Numbers of the nodes.
        low, high: Boxes of all nodes [m]; those of new ones are written.
        nodes: Children and body of all nodes; the children of new ones are written.
        used: Nodes that there are.

    Returns:
        The root and the number of nodes used.
    """
    if len(items) == 1:
        return int(items[0]), used
    root = used
    middles = low[items] + high[items]
    counts = np.array([len(items)])
    levels = []
    while len(counts):
        level = used + np.arange(len(counts))
        used += len(counts)
        levels.append(level)
        begins = np.cumsum(counts) - counts
        sides = np.maximum.reduceat(middles, begins) - np.minimum.reduceat(middles, begins)
        group = np.repeat(np.arange(len(counts)), counts)
        along = middles[np.arange(len(items)), sides.argmax(axis=1)[group]]
        order = np.lexsort((along, group))
        items = items[order]
        middles = middles[order]
        counts = np.stack([counts // 2, counts - counts // 2], axis=1).ravel()
        parted = counts > 1
        children = items[np.cumsum(counts) - counts]
        children[parted] = used + np.arange(np.count_nonzero(parted))
        nodes[:2, level] = children.reshape(-1, 2).T
        left = np.repeat(parted, counts)
        items = items[left]
        middles = middles[left]
        counts = counts[parted]
    for level in reversed(levels):
        left, right = nodes[:2, level]
        low[level] = np.minimum(low[left], low[right])
        high[level] = np.maximum(high[left], high[right])
    return root, used
