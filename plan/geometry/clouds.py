"""Point clouds as obstacles: balls about their points, fewer and larger ones where there are too many."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from plan.errors import SceneError
from plan.geometry.cloud_files import read_points
from plan.geometry.solids import Solid

# Of more points the near ones are put together: at this number a motion is planned in seconds.
MOST_POINTS = 100_000
# Share by which voxels grow until the points are few enough.
COARSER = 1.1
# No arm reaches this far [m]: a cloud so wide is in another unit.
WIDEST = 1e3


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
