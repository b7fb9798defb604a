"""Obstacles from files: meshes, read by Coal and looked over; point clouds as balls about their points."""

from __future__ import annotations

import itertools
import os
import struct
from pathlib import Path

import coal
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, first_line
from ident.robot.meshes import require_mesh
from ident.safe_read import require_regular, require_unpacked
from plan.geometry.solids import Solid, hull_points, mesh_triangles

# A surface of more triangles takes minutes to plan round; nobody needs so many to keep clear of a thing.
MOST_TRIANGLES = 100_000
# Corners closer than this share of the mesh's size are one: STL files repeat each corner for each triangle.
MERGED = 1e-7


def read_mesh(path: Path, scale: Float[Array, " 3"], hull: bool) -> tuple[Solid, Float[Array, " 3"]]:
    """The solid of a mesh file and the middle of it in the mesh's own frame [m].

    A closed mesh counts as it is, hollows and all; with `hull`, any mesh counts as the smallest convex body round it.

    Args:
        path: STL, OBJ, DAE or PLY.
        scale: Of each axis.
        hull: Whether the hull is meant.

    Raises:
        InputError: The file is missing, no mesh, not finite, too large, or open.
    """
    if not os.path.isfile(path):  # false of names that no file can have, too
        raise InputError(path, "no such mesh file", "give the path of an STL, OBJ or DAE file, from the scene file on")
    require_mesh(path, path, "", InputError)
    try:
        model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.array(scale, dtype=float))
    except (ValueError, RuntimeError) as error:
        lines = [line.removeprefix("message: ") for line in str(error).splitlines()]
        reason = next((line for line in lines if "resource" in line), "the reader refused it")
        raise InputError(path, f"the mesh can't be read ({reason})", "mend or replace the mesh") from None
    points, triangles = np.array(model.vertices()), mesh_triangles(model)
    if len(triangles) == 0 or not np.isfinite(points).all():
        raise InputError(path, "the mesh has no triangle, or a corner that is no number", "mend or replace the mesh")
    size = float(np.ptp(points, axis=0).max())
    if not 0.0 < size < 1e3:
        raise InputError(path, f"the mesh is {size:.3g} m long", "give scale = 0.001 if it is in millimetres")
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    if hull:
        return Solid.hull(hull_points(points) - middle), middle
    if len(triangles) > MOST_TRIANGLES:
        what = f"the mesh has {len(triangles)} triangles, more than {MOST_TRIANGLES}"
        raise InputError(path, what, "simplify it, or set hull = true")
    # One corner for all that are as good as the same; triangles that shrink to a line are left out.
    near = np.round(points / (MERGED * size)).astype(np.int64)
    _, first, which = np.unique(near, axis=0, return_index=True, return_inverse=True)
    points, triangles = points[first], which.reshape(-1)[triangles]
    triangles = triangles[(triangles != np.roll(triangles, 1, axis=1)).all(axis=1)]
    # Without every edge in an even number of triangles it has no inside.
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    loose = int((np.unique(edges, axis=0, return_counts=True)[1] % 2).sum())
    if loose:
        what = f"the mesh is open: {loose} edges belong to one triangle only"
        raise InputError(path, what, "close it, or set hull = true")
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return Solid.surface(points - middle, triangles), middle


def holds(solid: Solid, point: Float[Array, " 3"]) -> bool:
    """Whether a closed surface has a point, in its own axes, inside: by the solid angle under which it is seen.

    Source: A. van Oosterom, J. Strackee, 1983, "The solid angle of a plane triangle".
    """
    a, b, c = (solid.points[solid.triangles[:, k]] - point for k in range(3))
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    flat = la * lb * lc + np.einsum("ij,ij->i", a, b) * lc
    flat += np.einsum("ij,ij->i", b, c) * la + np.einsum("ij,ij->i", c, a) * lb
    return bool(abs(2.0 * np.arctan2(volume, flat).sum()) > 2.0 * np.pi)


# Of more points the near ones are put together: at this number a motion is planned in seconds.
MOST_POINTS = 100_000
# Share by which voxels grow until the points are few enough.
COARSER = 1.1
# No arm reaches this far [m]: a cloud so wide is in another unit.
WIDEST = 1e3
# A file of more is no cloud of one cell, but of a building [bytes].
LARGEST = 400_000_000
MOST_LINES = 1000  # of a header
AXES = ("x", "y", "z")
CLOUDS = (".ply", ".pcd", ".npy")


def read_cloud(path: Path, radius: float, scale: Float[Array, " 3"]) -> tuple[Solid, Float[Array, " 3"]]:
    """The balls about a cloud's points, and the cloud's middle in its own frame [m].

    Args:
        path: See `read_points`.
        radius: Of a ball [m]: half the distance of neighbouring points and the sensor's error fill a scanned surface.
        scale: Of each axis.

    Raises:
        InputError: As `read_points`; or the cloud is wider than any arm reaches.
    """
    points = read_points(path) * scale
    size = float(np.ptp(points, axis=0).max())
    if not size < WIDEST:
        raise InputError(path, f"the cloud is {size:.3g} m wide", "give scale = 0.001 if it is in millimetres")
    kept, lost = thin_points(points, MOST_POINTS)
    note = f"{len(points)} points as {len(kept)}, each ball {1000 * lost:.2g} mm larger" if lost > 0.0 else ""
    middle = (kept.min(axis=0) + kept.max(axis=0)) / 2
    return Solid.cloud(kept - middle, radius + lost, note), middle


def thin_points(points: Float[Array, "k 3"], most: int) -> tuple[Float[Array, "m 3"], float]:
    """Fewer points, and how far those that were left out lie from them at most [m].

    The points of a voxel are put together in the middle of what they span. Balls that are larger by what is returned
    hold the balls of all points, so that what is proven of the few is true of the many.
    """
    points = np.unique(points, axis=0)
    if len(points) <= most:
        return points, 0.0
    low = points.min(axis=0)
    # Points that fill a surface evenly have this distance.
    size = float(np.ptp(points, axis=0).max()) / np.sqrt(most)
    while True:
        cells = np.floor((points - low) / size).astype(np.int64)
        order = np.lexsort(cells.T)
        starts = np.flatnonzero(np.r_[True, np.any(np.diff(cells[order], axis=0) != 0, axis=1)])
        if len(starts) <= most:
            break
        size *= COARSER
    points = points[order]
    middles = (np.minimum.reduceat(points, starts) + np.maximum.reduceat(points, starts)) / 2
    counts = np.diff(np.append(starts, len(points)))
    return middles, float(np.linalg.norm(points - np.repeat(middles, counts, axis=0), axis=1).max())


def read_points(path: Path) -> Float[Array, "k 3"]:
    """The points of a cloud's file, in the file's own unit and axes.

    Args:
        path: `.ply` or `.pcd` with x, y and z; `.npy` with rows of three.

    Raises:
        InputError: The file is missing, of no such kind, too large, damaged, no table, or holds what is no number.
    """
    if path.suffix.lower() not in CLOUDS:
        raise InputError(path, "no point cloud that can be read", f"give one of: {', '.join(CLOUDS)}")
    size = require_regular(path, "give the path of a point cloud, from the scene file on", largest=LARGEST)
    try:
        require_unpacked(size, _announced(path))
        found = np.asarray(_read_table(path), dtype=float)
    except Exception as error:  # each library raises its own, and memory may end
        what = f"the point cloud can't be read ({first_line(error)})"
        raise InputError(path, what, "mend or replace the file") from None
    if found.ndim != 2 or len(found) < 1 or found.shape[1] < 3:
        what = f"it holds an array of shape {found.shape}, no point cloud"
        raise InputError(path, what, "give 1 or more rows of 3 or more numbers")
    found = np.ascontiguousarray(found[:, :3])
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        first = f"row {bad[0][0] + 1}, column {bad[0][1] + 1} is no number"
        others = f", nor are {len(bad) - 1} others" * (len(bad) > 1)
        raise InputError(path, first + others, "leave points without a reading out of the file")
    return found


def _announced(path: Path) -> int:
    """What the header of a .ply or .pcd says is in the file, in eight bytes a number; 0 for others."""
    rows, total, last = 1, 0, {".ply": b"end_header", ".pcd": b"DATA"}.get(path.suffix.lower())
    if last is None:
        return 0
    with path.open("rb") as file:
        for line in itertools.islice(file, MOST_LINES):
            word, *rest = line.split() or [b""]
            if word == b"element":
                rows = int(rest[1])
            elif word in (b"property", b"POINTS", b"WIDTH", b"COUNT"):
                each = 512 if word == b"COUNT" else 8  # a column takes a name of its own
                total += each * sum(map(abs, [rows] if word == b"property" else map(int, rest)))
            elif word == last:
                packed = struct.unpack("<II", file.read(8)) if rest == [b"binary_compressed"] else (0, 0)
                return total + packed[1]
    raise ValueError("a header without an end")


def _read_table(path: Path) -> Array:
    """The coordinates in a file of one of the three kinds."""
    kind = path.suffix.lower()
    if kind == ".ply":
        from plyfile import PlyData  # few scenes have a cloud

        vertices = PlyData.read(str(path))["vertex"]
        return np.column_stack([vertices[axis] for axis in AXES])
    if kind == ".pcd":
        from pypcd4 import PointCloud

        cloud = PointCloud.from_path(path)
        found = cloud.numpy(AXES)
        if len(found) != cloud.metadata.points:
            raise ValueError(f"{len(found)} of {cloud.metadata.points} points are there")
        return np.asarray(found)
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.kind not in "fiu":
        raise ValueError(f"it holds {array.dtype}, no numbers")
    return np.array(array, dtype=float)
