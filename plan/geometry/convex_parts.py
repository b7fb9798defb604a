"""Meshes of links as convex parts.

A bent link's hull fills its bend, and many positions of a folded arm with it. A mesh is cut by
planes along its axes, each time where the hulls of both sides lose the most volume together, until
a cut brings next to nothing. Every triangle is cut with it, so each lies inside a part, whatever
the mesh is like.
"""

from __future__ import annotations

import hashlib
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.errors import InputError
from ident.files import atomic_write
from ident.safe_read import read_arrays
from ident.user_cache import user_cache
from plan.geometry.solids import hull_points

if TYPE_CHECKING:
    from scipy.spatial import ConvexHull

# Places of cuts, as shares of the length along each axis.
PLACES = np.linspace(0.1, 0.9, 9)
# Least gain of a cut, as a share of the whole hull's volume.
LEAST = 0.02
# Most parts of a mesh.
MOST = 16
# Triangles by which cuts are chosen, at most.
ENOUGH = 3000
# Area vectors of a closed surface add up to this share of its area, or less.
CLOSED = 1e-3
# Changes with the way of cutting, so that parts that were stored before are not taken up.
VERSION = b"3"

Parts = tuple[list[Float[Array, "k 3"]], float | None]
"""Corners of each part [m], and by how much they hold more than the mesh; see `convex_parts`."""


def convex_parts(triangles: Float[Array, "m 3 3"]) -> Parts:
    """Parts whose hulls hold every triangle; stored in the user's cache by the triangles' content.

    Args:
        triangles: Corners of each [m].

    Returns:
        Corners of each part [m]; and by how much the parts hold more than the mesh, as a share of
        its volume, None of an open mesh.
    """
    triangles = np.ascontiguousarray(triangles, dtype=float)
    path = _stored_at(triangles)
    stored = None if path is None else _read_parts(path)
    if stored is not None:
        return stored
    parts, excess = _cut(triangles)
    if path is not None:
        _store_parts(path, parts, excess)
    return parts, excess


def _stored_at(triangles: Float[Array, "m 3 3"]) -> Path | None:
    """Where the parts of a mesh are stored; None where the user has no cache."""
    folder = user_cache()
    if folder is None:
        return None
    digest = hashlib.sha256(VERSION + triangles.tobytes()).hexdigest()
    return folder / "parts" / f"{digest}.npz"


def _read_parts(path: Path) -> Parts | None:
    """The parts that are stored in a file; None where none can be read: they are made anew."""
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path, "remove it")
        excess = float(arrays["excess"])
        parts = np.split(arrays["corners"], arrays["ends"])
    except (InputError, ValueError, KeyError, TypeError):
        return None
    return parts, None if np.isnan(excess) else excess


def _store_parts(path: Path, parts: list[Float[Array, "k 3"]], excess: float | None) -> None:
    """Writes parts into a file, where the user may write."""
    ends = np.cumsum([len(corners) for corners in parts])[:-1]
    share = np.array(excess, dtype=float)
    with suppress(OSError, InputError), atomic_write(path) as file:
        np.savez(file, corners=np.concatenate(parts), ends=ends, excess=share)


def _cut(triangles: Array) -> Parts:
    """As `convex_parts`, made anew.

    Where to cut is chosen by hulls of few corners; hulls of all corners are made of the last parts
    alone.
    """
    volume = _closed_volume(triangles)
    whole = _hull_volume(_farthest(triangles.reshape(-1, 3)))
    pieces = [triangles]
    cuts = []
    if volume is None or whole > (1.0 + LEAST) * volume:
        cuts.append(_best_cut(triangles))
    while cuts and len(pieces) < MOST:
        gains = [gain for gain, _, _ in cuts]
        worst = gains.index(max(gains))
        gain, axis, place = cuts[worst]
        if gain <= LEAST * whole:
            break
        sides = clip(pieces[worst], axis, place)
        pieces[worst : worst + 1] = sides
        cuts[worst : worst + 1] = [_best_cut(side) for side in sides]
    hulls = [_hull(piece) for piece in pieces]
    parts = [corners for corners, _ in hulls]
    if volume is None:
        return parts, None
    held = sum(held for _, held in hulls)
    return parts, max(held / volume - 1.0, 0.0)


def _closed_volume(triangles: Float[Array, "m 3 3"]) -> float | None:
    """Volume of a closed surface [m³]; None of an open one, or one that holds nothing."""
    a = triangles[:, 0]
    b = triangles[:, 1]
    c = triangles[:, 2]
    areas = np.cross(b - a, c - a)
    if np.linalg.norm(areas.sum(axis=0)) > CLOSED * np.linalg.norm(areas, axis=1).sum():
        return None
    corner = a[0]
    sixfold = np.einsum("ij,ij->i", a - corner, np.cross(b - corner, c - corner)).sum()
    return float(abs(sixfold) / 6.0) or None


def _hull(triangles: Float[Array, "m 3 3"]) -> tuple[Float[Array, "k 3"], float]:
    """Corners of the hull of some triangles, and its volume [m³].

    Flat ones have none, and a little thickness.
    """
    points = triangles.reshape(-1, 3)
    hull = _quick_hull(points)
    if hull is None:
        return hull_points(np.unique(points, axis=0)), 0.0
    return points[hull.vertices], float(hull.volume)


def _hull_volume(points: Float[Array, "k 3"]) -> float:
    """Volume of the hull of some points [m³]; zero where they are flat."""
    hull = _quick_hull(points)
    return 0.0 if hull is None else float(hull.volume)


def _quick_hull(points: Float[Array, "k 3"]) -> ConvexHull | None:
    """Qhull's hull of some points; None where they are flat, or too few."""
    from scipy.spatial import ConvexHull, QhullError  # slow to load, and only meshes need it

    try:
        return ConvexHull(points)
    except (QhullError, ValueError):
        return None


def _best_cut(triangles: Array) -> tuple[float, int, float]:
    """Volume that the best cut takes off the hull [m³], its axis and its place [m].

    Along each axis the mesh is cut into slabs once. Of each slab only the corners that lie farthest
    in some direction count: to choose a cut that is enough, and a hull of few corners is quick.

    Args:
        triangles: Corners of each [m].
    """
    best = (0.0, 0, 0.0)
    some = triangles[:: max(1, len(triangles) // ENOUGH)]
    corners = some.reshape(-1, 3)
    felt = _hull_volume(_farthest(corners))
    if felt == 0.0:
        return best
    low = corners.min(axis=0)
    high = corners.max(axis=0)
    for axis in range(3):
        places = low[axis] + PLACES * (high[axis] - low[axis])
        slabs = _slabs(some, axis, places)
        for number, place in enumerate(places, start=1):
            below = np.concatenate(slabs[:number])
            above = np.concatenate(slabs[number:])
            if len(below) and len(above):
                held = _hull_volume(_farthest(below)) + _hull_volume(_farthest(above))
                best = max(best, (felt - held, axis, float(place)))
    return best


def _slabs(
    triangles: Float[Array, "m 3 3"], axis: int, places: Float[Array, " c"]
) -> list[Float[Array, "k 3"]]:
    """Farthest corners of the slabs between planes across an axis, the lowest slab first [m]."""
    slabs = []
    rest = triangles
    for place in places:
        below, rest = clip(rest, axis, place)
        slabs.append(_farthest(below.reshape(-1, 3)))
    slabs.append(_farthest(rest.reshape(-1, 3)))
    return slabs


def _farthest(points: Float[Array, "k 3"]) -> Float[Array, "m 3"]:
    """Of some points those that lie farthest in any of the directions in which hulls are felt."""
    if len(points) == 0:
        return points
    along = _directions() @ points.T
    return points[np.unique(np.argmax(along, axis=1))]


@cache
def _directions(on_spiral: int = 86) -> Float[Array, "k 3"]:
    """Unit vectors evenly all round: the axes both ways, and so many on a spiral between poles."""
    number = np.arange(on_spiral) + 0.5
    height = 1.0 - 2.0 * number / on_spiral
    turn = np.pi * (1.0 + np.sqrt(5.0)) * number
    level = np.sqrt(1.0 - height**2)
    spiral = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=1)
    return freeze(np.concatenate([np.eye(3), -np.eye(3), spiral]))


def clip(triangles: Float[Array, "m 3 3"], axis: int, place: float) -> tuple[Array, Array]:
    """The triangles below and above a plane, those that cross it cut in three.

    Args:
        triangles: Three corners each [m].
        axis: The coordinate that the plane is normal to: 0, 1 or 2.
        place: The plane's place on that axis [m].

    Returns:
        Those below and those above, (k, 3, 3) each; either may be empty.
    """
    is_above = triangles[:, :, axis] > place
    count = is_above.sum(axis=1)
    below = [triangles[count == 0]]
    above = [triangles[count == 3]]
    # Two corners above: one is alone below; and the other way round.
    tips, bases = _cut_in_three(triangles[count == 2], ~is_above[count == 2], axis, place)
    below.append(tips)
    above += bases
    tips, bases = _cut_in_three(triangles[count == 1], is_above[count == 1], axis, place)
    above.append(tips)
    below += bases
    return np.concatenate(below), np.concatenate(above)


def _cut_in_three(
    triangles: Float[Array, "m 3 3"], is_alone: Array, axis: int, place: float
) -> tuple[Array, list[Array]]:
    """Triangles with one corner alone on its side of a plane, cut by that plane.

    Args:
        triangles: Corners of each [m].
        is_alone: Which of its corners is alone, shape (m, 3).
        axis: Across which the plane stands.
        place: Where it stands [m].

    Returns:
        The triangle at that corner, and the two on the other side of the plane, of each.
    """
    rows = np.arange(len(triangles))
    alone = np.argmax(is_alone, axis=1)
    tip = triangles[rows, alone % 3]
    left = triangles[rows, (alone + 1) % 3]
    right = triangles[rows, (alone + 2) % 3]
    on_left = _crossing(tip, left, axis, place)
    on_right = _crossing(tip, right, axis, place)
    tips = np.stack([tip, on_left, on_right], axis=1)
    bases = [
        np.stack([on_left, left, right], axis=1),
        np.stack([on_left, right, on_right], axis=1),
    ]
    return tips, bases


def _crossing(
    begin: Float[Array, "m 3"], end: Float[Array, "m 3"], axis: int, place: float
) -> Float[Array, "m 3"]:
    """Where edges cross a plane [m]."""
    share = (place - begin[:, axis]) / (end[:, axis] - begin[:, axis])
    return begin + share[:, None] * (end - begin)
