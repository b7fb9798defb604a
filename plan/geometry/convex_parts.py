"""Meshes of links as convex parts: a bent link's hull fills its bend, and many positions of a folded arm with it.

A mesh is cut by planes along its axes, each time where the hulls of both sides lose the most volume together, until a
cut brings next to nothing. Every triangle is cut with it, so each lies inside a part, whatever the mesh is like.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import user_cache
from ident.errors import InputError
from ident.files import atomic_write
from ident.safe_read import read_arrays
from plan.geometry.solids import hull_points

# Places of cuts, as shares of the length along each axis; least gain of one, as a share of the whole hull's volume.
PLACES, LEAST = np.linspace(0.1, 0.9, 9), 0.02
MOST = 16
# Triangles by which cuts are chosen, at most; area vectors of a closed surface add up to this share of it, or less.
ENOUGH, CLOSED = 3000, 1e-3
# Changes with the way of cutting, so that parts that were kept before are not taken up.
VERSION = b"1"


@dataclass(frozen=True, eq=False)
class ConvexParts:
    """A mesh as convex parts.

    Attributes:
        corners: Of each part, in the mesh's axes [m].
        excess: By how much the parts hold more than the mesh, as a share of its volume; None of an open mesh.
    """

    corners: tuple[Float[Array, "k 3"], ...]
    excess: float | None


def convex_parts(triangles: Float[Array, "m 3 3"]) -> ConvexParts:
    """Parts whose hulls hold every triangle; kept in the user's cache by the triangles' content.

    Args:
        triangles: Corners of each [m].
    """
    triangles = np.ascontiguousarray(triangles, dtype=float)
    cache, name = user_cache(), f"{hashlib.sha256(VERSION + triangles.tobytes()).hexdigest()}.npz"
    kept = None if cache is None else cache / "parts" / name
    with suppress(InputError, ValueError, KeyError, TypeError):  # what can't be read is made anew
        arrays = read_arrays(kept, "remove it") if kept is not None and kept.is_file() else {}
        excess = float(arrays["excess"])
        return ConvexParts(tuple(np.split(arrays["corners"], arrays["ends"])), None if np.isnan(excess) else excess)
    found = _cut(triangles)
    if kept is not None:
        ends = np.cumsum([len(part) for part in found.corners])[:-1]
        with suppress(OSError, InputError), atomic_write(kept) as file:  # nobody may write everywhere
            np.savez(file, corners=np.concatenate(found.corners), ends=ends, excess=np.array(found.excess, dtype=float))
    return found


def _cut(triangles: Array) -> ConvexParts:
    volume, whole = _volume(triangles), _hull_volume(triangles)
    parts = [triangles]
    cuts = [_best_cut(triangles, whole)] if volume is None or whole > (1.0 + LEAST) * volume else []
    while cuts and len(parts) < MOST:
        worst = max(range(len(parts)), key=lambda k: cuts[k][0])
        gain, axis, place = cuts[worst]
        if gain < LEAST * whole:
            break
        sides = clip(parts[worst], axis, place)
        parts[worst : worst + 1] = sides
        cuts[worst : worst + 1] = [_best_cut(side, _hull_volume(side)) for side in sides]
    held = sum(_hull_volume(part) for part in parts)
    corners = tuple(hull_points(np.unique(part.reshape(-1, 3), axis=0)) for part in parts)
    return ConvexParts(corners, None if volume is None else max(held / volume - 1.0, 0.0))


def _best_cut(triangles: Array, whole: float) -> tuple[float, int, float]:
    """Volume that the best cut takes off the hull [m³], its axis and its place [m]."""
    some = triangles[:: max(1, len(triangles) // ENOUGH)]
    low, high = (pick(some.reshape(-1, 3), axis=0) for pick in (np.min, np.max))
    best = (0.0, 0, 0.0)
    for axis in range(3):
        for place in low[axis] + PLACES * (high[axis] - low[axis]):
            sides = clip(some, axis, place)
            if all(len(side) for side in sides):
                best = max(best, (whole - sum(_hull_volume(side) for side in sides), axis, float(place)))
    return best


def clip(triangles: Float[Array, "m 3 3"], axis: int, place: float) -> tuple[Array, Array]:
    """The triangles below and above a plane, those that cross it cut in three."""
    above = triangles[:, :, axis] > place
    count = above.sum(axis=1)
    sides = [[triangles[count == 0]], [triangles[count == 3]]]
    for side in (0, 1):  # those with one corner alone on this side
        crossing = count == (1 if side else 2)
        corners, rows = triangles[crossing], np.arange(int(crossing.sum()))
        alone = np.argmax(above[crossing] == bool(side), axis=1)
        tip, left, right = (corners[rows, (alone + k) % 3] for k in range(3))
        on_left, on_right = (
            tip + ((place - tip[:, axis]) / (end[:, axis] - tip[:, axis]))[:, None] * (end - tip)
            for end in (left, right)
        )
        sides[side].append(np.stack([tip, on_left, on_right], axis=1))
        sides[1 - side] += [np.stack([on_left, left, right], axis=1), np.stack([on_left, right, on_right], axis=1)]
    return np.concatenate(sides[0]), np.concatenate(sides[1])


def _hull_volume(triangles: Array) -> float:
    """Volume of the hull of some triangles [m³]; zero where they are flat."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and only meshes need it

    try:
        return float(ConvexHull(np.unique(triangles.reshape(-1, 3), axis=0)).volume)
    except (QhullError, ValueError):
        return 0.0


def _volume(triangles: Array) -> float | None:
    """Volume inside a closed surface [m³]; None of an open one."""
    a, b, c = (triangles[:, k] for k in range(3))
    areas = np.cross(b - a, c - a)
    if np.linalg.norm(areas.sum(axis=0)) > CLOSED * np.linalg.norm(areas, axis=1).sum():
        return None
    return float(abs(np.einsum("ij,ij->i", a - a[0], np.cross(b - a[0], c - a[0])).sum()) / 6.0) or None
