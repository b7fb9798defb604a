"""Point clouds as obstacles: read from files; balls about their points, fewer and larger ones of too many."""

from __future__ import annotations

import itertools
import struct
from collections.abc import Callable, Mapping
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
# A file of more is no cloud of one cell, but of a building [bytes].
LARGEST = 400_000_000
MOST_LINES = 1000  # of a header
AXES = ("x", "y", "z")


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
        path: `.ply` or `.pcd` with x, y and z; `.npy` with rows of three; text with three columns, `.csv` or `.xyz`.

    Raises:
        SceneError: As `read_scan`.
    """
    readers = {".ply": _read_ply, ".pcd": _read_pcd, **TABLES, ".xyz": read_table}
    return read_scan(path, "point cloud", readers, 3, "leave points without a reading out of the file")


def read_scan(
    path: Path, what: str, readers: Mapping[str, Callable[[Path], Array]], columns: int | None, remedy: str
) -> Float[Array, "r c"]:
    """The rows of numbers in a file that holds a scan.

    Args:
        path: The file.
        what: What it should be, for messages.
        readers: By the ends of names.
        columns: How many count, the first ones; None for a grid, of two or more either way.
        remedy: What to do about cells that are no numbers.

    Raises:
        SceneError: The file is missing, of no such kind, too large, damaged, no table, or holds what is no number.
    """
    kind = path.suffix.lower()
    if kind not in readers:
        raise SceneError(path, f"no {what} that can be read", f"give one of: {', '.join(readers)}")
    size = require_regular(path, f"give the path of a {what}, from the scene file on", SceneError, LARGEST)
    try:
        require_unpacked(size, _announced(path))
        found = np.asarray(readers[kind](path), dtype=float)
    except SceneError:
        raise
    except Exception as error:  # each library raises its own, and memory may end
        reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise SceneError(path, f"the {what} can't be read ({reason})", "mend or replace the file") from None
    rows, wide = (2, 2) if columns is None else (1, columns)
    if found.ndim != 2 or len(found) < rows or found.shape[1] < wide:
        what = f"it holds an array of shape {found.shape}, no {what}"
        raise SceneError(path, what, f"give {rows} or more rows of {wide} or more numbers")
    found = np.ascontiguousarray(found[:, :columns])
    bad = np.argwhere(~np.isfinite(found))
    if len(bad):
        first = f"row {bad[0][0] + 1}, column {bad[0][1] + 1} is no number"
        raise SceneError(path, first + f", nor are {len(bad) - 1} others" * (len(bad) > 1), remedy)
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
    try:
        np.array(head.split(parts), dtype=float)
        named = 0
    except ValueError:
        named = 1
    with path.open(encoding="utf-8-sig") as lines:
        return np.loadtxt(lines, delimiter=parts, skiprows=named, ndmin=2, comments="#")


# Plain numbers, by the ends of names.
TABLES: dict[str, Callable[[Path], Array]] = {".npy": read_array, ".csv": read_table, ".txt": read_table}
