"""Point clouds as obstacles: read from files; balls about their points, fewer and larger ones of too many."""

from __future__ import annotations

import itertools
import struct
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.safe_read import require_regular, require_unpacked
from plan.errors import SceneError
from plan.geometry.solids import Solid

# Of more points the near ones are put together: at this number a motion is planned in seconds.
MOST_POINTS = 100_000
# Share by which voxels grow until the points are few enough.
COARSER = 1.1
# No arm reaches this far [m]: a cloud so wide is in another unit.
WIDEST = 1e3
CLOUDS = (".ply", ".pcd", ".npy", ".csv", ".xyz", ".txt")
# A file of more is no cloud of one cell, but of a building [bytes].
LARGEST = 400_000_000
MOST_LINES = 1000  # of a header
AXES = ("x", "y", "z")
REMEDY = "give three columns of numbers, x, y and z in metres"


def read_cloud(path: Path, radius: float, scale: Float[Array, " 3"]) -> tuple[Solid, Float[Array, " 3"]]:
    """The balls about a cloud's points, and the cloud's middle in its own frame [m].

    Args:
        path: See `read_points`.
        radius: Of a ball [m]: half the distance of neighbouring points and the sensor's error fill a scanned surface.
        scale: Of each axis.

    Raises:
        SceneError: As `read_points`; or the cloud is wider than any arm reaches.
    """
    points = read_points(path) * scale
    size = float(np.ptp(points, axis=0).max())
    if not size < WIDEST:
        raise SceneError(path, f"the cloud is {size:.3g} m wide", "give scale = 0.001 if it is in millimetres")
    kept, lost = thin_points(points, MOST_POINTS)
    note = ""
    if lost > 0.0:
        note = f"{len(points)} points as {len(kept)}, each ball {1000 * lost:.2g} mm larger"
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
    return _joined(points[order], starts)


def _joined(points: Array, starts: Array) -> tuple[Array, float]:
    """The middle of each group of points that stand in a row, and the farthest of any point from its group's."""
    middles = (np.minimum.reduceat(points, starts) + np.maximum.reduceat(points, starts)) / 2
    counts = np.diff(np.append(starts, len(points)))
    away = np.linalg.norm(points - np.repeat(middles, counts, axis=0), axis=1)
    return middles, float(away.max())


def read_points(path: Path) -> Float[Array, "k 3"]:
    """The points of a cloud's file, in the file's own unit and axes.

    Args:
        path: `.ply` or `.pcd` with x, y and z; `.npy` with rows of three; text with three columns, `.csv` or `.xyz`.

    Raises:
        SceneError: The file is missing, of no such kind, too large, empty, or holds a point that is no number.
    """
    if path.suffix.lower() not in CLOUDS:
        raise SceneError(path, "no point cloud that can be read", f"give one of: {', '.join(CLOUDS)}")
    size = require_regular(path, "give the path of a point cloud, from the scene file on", SceneError, LARGEST)
    readers = {".ply": _read_ply, ".pcd": _read_pcd, ".npy": read_array}
    try:
        require_unpacked(size, _announced(path))
        points = np.asarray(readers.get(path.suffix.lower(), read_table)(path), dtype=float)
    except SceneError:
        raise
    except Exception as error:  # each library raises its own, and memory may end
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise SceneError(path, f"the cloud can't be read ({reason})", "mend or replace the file") from None
    if points.ndim != 2 or points.shape[1] < 3 or len(points) == 0:
        raise SceneError(path, f"it holds an array of shape {points.shape}, no points", REMEDY)
    points = np.ascontiguousarray(points[:, :3])
    bad = np.flatnonzero(~np.isfinite(points).all(axis=1))
    if len(bad):
        some = f"point {bad[0] + 1} of {len(points)} is no number"
        what = some if len(bad) == 1 else f"{some}, nor are {len(bad) - 1} others"
        raise SceneError(path, what, "leave points without a reading out of the file")
    return points


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
            elif word in (b"property", b"POINTS", b"WIDTH"):
                total += 8 * abs(rows if word == b"property" else int(rest[0]))
            elif word == last:
                packed = struct.unpack("<II", file.read(8)) if rest == [b"binary_compressed"] else (0, 0)
                return total + packed[1]
    raise ValueError("a header without an end")


def _read_ply(path: Path) -> Array:
    from plyfile import PlyData  # few scenes have a cloud

    vertices = PlyData.read(str(path))["vertex"]
    return np.column_stack([vertices[axis] for axis in AXES])


def _read_pcd(path: Path) -> Array:
    from pypcd4 import PointCloud

    cloud = PointCloud.from_path(path)
    found = cloud.numpy(AXES)
    if len(found) != cloud.metadata.points:
        raise ValueError(f"{len(found)} of {cloud.metadata.points} points are there")
    return np.asarray(found)


def read_array(path: Path) -> Array:
    """A plain array of numbers in NumPy's format."""
    found = np.load(path, mmap_mode="r", allow_pickle=False)
    if found.dtype.kind not in "fiu":
        raise ValueError(f"it holds {found.dtype}, no numbers")
    return np.array(found, dtype=float)


def read_table(path: Path) -> Array:
    """Rows of numbers parted by commas, semicolons or blanks; a first row of names is passed over."""
    with path.open(encoding="utf-8-sig") as lines:
        head = next((line for line in lines if line.strip() and not line.startswith("#")), "")
    parts = next((mark for mark in ",;" if mark in head), None)
    named = any(_is_name(cell) for cell in head.split(parts))
    with path.open(encoding="utf-8-sig") as lines:
        return np.loadtxt(lines, delimiter=parts, skiprows=int(named), ndmin=2, comments="#")


def _is_name(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return True
    return False
