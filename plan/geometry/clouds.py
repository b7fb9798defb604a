"""Point clouds from files, as balls about their points."""

from __future__ import annotations

import itertools
import math
import struct
from io import BufferedReader, BytesIO
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, first_line
from ident.safe_read import read_bytes, require_unpacked
from plan.geometry.solids import Solid

# Of more points the near ones are put together: at this number a motion is planned in seconds.
MOST_POINTS = 100_000
# Share by which voxels grow until the points are few enough.
COARSER = 1.1
# No arm reaches this far [m]: a cloud so wide is in another unit.
WIDEST = 1e3
# A file of more is no cloud of one cell, but of a building [bytes].
LARGEST = 400_000_000
# Lines of a header, at most.
MOST_LINES = 1000
# Bytes that a number takes once it is read, and a column of a .pcd file, which takes a name of its
# own.
NUMBER_BYTES = 8
COLUMN_BYTES = 512
AXES = ("x", "y", "z")
CLOUDS = (".ply", ".pcd", ".npy")
# The word behind which the data of a kind of file begins.
HEADER_ENDS = {".ply": b"end_header", ".pcd": b"DATA"}


def read_cloud(
    path: Path, radius: float, scale: Float[Array, " 3"]
) -> tuple[Solid, Float[Array, " 3"]]:
    """The balls about a cloud's points, and the cloud's middle in its own frame [m].

    Args:
        path: See `read_points`.
        radius: Of a ball [m]: half the distance of neighbouring points and the sensor's error fill
            a scanned surface.
        scale: Of each axis.

    Raises:
        InputError: As `read_points`; or the cloud is wider than any arm reaches.
    """
    points = read_points(path) * scale
    size = float(np.ptp(points, axis=0).max())
    if not size < WIDEST:
        what = f"the cloud is {size:.3g} m wide"
        raise InputError(path, what, "give scale = 0.001 if it is in millimetres")
    thinned, lost = thin_points(points, MOST_POINTS)
    note = ""
    if lost > 0.0:
        larger = f"{1000 * lost:.2g} mm larger"
        note = f"{len(points)} points as {len(thinned)}, each ball {larger}"
    middle = (thinned.min(axis=0) + thinned.max(axis=0)) / 2
    return Solid.cloud(thinned - middle, radius + lost, note), middle


def thin_points(points: Float[Array, "k 3"], most: int) -> tuple[Float[Array, "m 3"], float]:
    """Fewer points, and how far those that were left out lie from them at most [m].

    The points of a voxel are put together in the middle of what they span. Balls that are larger by
    what is returned hold the balls of all points, so that what is proven of the few is true of the
    many.
    """
    points = np.unique(points, axis=0)
    if len(points) <= most:
        return points, 0.0
    # Points that fill a surface evenly have this distance.
    size = float(np.ptp(points, axis=0).max()) / np.sqrt(most)
    order, starts = _voxels(points, size)
    while len(starts) > most:
        size *= COARSER
        order, starts = _voxels(points, size)
    points = points[order]
    low = np.minimum.reduceat(points, starts)
    high = np.maximum.reduceat(points, starts)
    middles = (low + high) / 2
    counts = np.diff(np.append(starts, len(points)))
    away = points - np.repeat(middles, counts, axis=0)
    return middles, float(np.linalg.norm(away, axis=1).max())


def _voxels(points: Float[Array, "k 3"], size: float) -> tuple[Array, Array]:
    """The order in which the points of a voxel follow each other, and where each voxel begins.

    Args:
        points: The points [m].
        size: Edge length of a voxel [m].
    """
    cells = np.floor((points - points.min(axis=0)) / size).astype(np.int64)
    order = np.lexsort(cells.T)
    changes = np.any(np.diff(cells[order], axis=0) != 0, axis=1)
    return order, np.flatnonzero(np.r_[True, changes])


def read_points(path: Path) -> Float[Array, "k 3"]:
    """The points of a cloud's file, in the file's own unit and axes.

    Args:
        path: `.ply` or `.pcd` with x, y and z; `.npy` with rows of three.

    Raises:
        InputError: The file is missing, of no such kind, too large, damaged, no table, or holds
            what is no number.
    """
    if path.suffix.lower() not in CLOUDS:
        known = ", ".join(CLOUDS)
        raise InputError(path, "no point cloud that can be read", f"give one of: {known}")
    remedy = "give the path of a point cloud, from the scene file on"
    data = read_bytes(path, remedy, largest=LARGEST)
    kind = path.suffix.lower()
    try:
        require_unpacked(len(data), _announced(data, kind))
        table = np.asarray(_read_table(data, kind), dtype=float)
    except Exception as error:  # each library raises its own, and memory may end
        what = f"the point cloud can't be read ({first_line(error)})"
        raise InputError(path, what, "mend or replace the file") from None
    if table.ndim != 2 or len(table) < 1 or table.shape[1] < 3:
        what = f"it holds an array of shape {table.shape}, no point cloud"
        raise InputError(path, what, "give 1 or more rows of 3 or more numbers")
    points = np.ascontiguousarray(table[:, :3])
    bad = np.argwhere(~np.isfinite(points))
    if len(bad):
        row, column = bad[0]
        what = f"row {row + 1}, column {column + 1} is no number"
        if len(bad) > 1:
            what += f", nor are {len(bad) - 1} others"
        raise InputError(path, what, "leave points without a reading out of the file")
    return points


def _announced(data: bytes, kind: str) -> int:
    """What the header of a .ply or .pcd says is in the file [bytes]; 0 for other kinds."""
    last = HEADER_ENDS.get(kind)
    if last is None:
        return 0
    rows = 1
    total = 0
    file = BytesIO(data)
    for line in itertools.islice(file, MOST_LINES):
        word, *rest = line.split() or [b""]
        if word == b"element":
            rows = int(rest[1])
        elif word == b"property":
            total += NUMBER_BYTES * abs(rows)
        elif word == b"COUNT":
            total += COLUMN_BYTES * _sum_of_sizes(rest)
        elif word in (b"POINTS", b"WIDTH"):
            total += NUMBER_BYTES * _sum_of_sizes(rest)
        elif word == last:
            if rest == [b"binary_compressed"]:
                _, unpacked = struct.unpack("<II", file.read(8))
                total += unpacked
            return total
    raise ValueError("a header without an end")


def _sum_of_sizes(words: list[bytes]) -> int:
    """Sum of whole numbers, their signs left out."""
    return sum(abs(int(word)) for word in words)


def _read_table(data: bytes, kind: str) -> Array:
    """The coordinates in a file of one of the three kinds."""
    if kind == ".ply":
        return _read_ply(data)
    return _read_pcd(data) if kind == ".pcd" else _read_npy(data)


def _read_npy(data: bytes) -> Float[Array, "..."]:
    """The numbers of a .npy file.

    Its header is believed once so many numbers follow: NumPy makes room for them before it reads.
    """
    stream = BytesIO(data)
    version = np.lib.format.read_magic(stream)
    is_old = version == (1, 0)
    read = np.lib.format.read_array_header_1_0 if is_old else np.lib.format.read_array_header_2_0
    shape, _, kind = read(stream)
    if kind.kind not in "fiu":
        raise ValueError(f"it holds {kind}, no numbers")
    if math.prod(shape) * kind.itemsize > len(data):
        raise ValueError(f"an array of shape {shape} in {len(data)} bytes")
    stream.seek(0)
    return np.array(np.load(stream, allow_pickle=False), dtype=float)


def _read_ply(data: bytes) -> Float[Array, "k 3"]:
    """The coordinates of a .ply file's vertices."""
    from plyfile import PlyData  # few scenes have a cloud

    vertices = PlyData.read(BytesIO(data))["vertex"]
    return np.column_stack([vertices[axis] for axis in AXES])


def _read_pcd(data: bytes) -> Float[Array, "k 3"]:
    """The coordinates in a .pcd file."""
    from pypcd4 import PointCloud

    cloud = PointCloud.from_fileobj(BufferedReader(BytesIO(data)))
    points = np.asarray(cloud.numpy(AXES))
    if len(points) != cloud.metadata.points:
        raise ValueError(f"{len(points)} of {cloud.metadata.points} points are there")
    return points
