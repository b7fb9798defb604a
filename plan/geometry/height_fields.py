"""Height fields as obstacles: what lies under a surface that is given by its height over a grid."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ident.arrays import Array, Float, Int, freeze
from plan.errors import SceneError
from plan.geometry.clouds import TABLES, read_scan
from plan.geometry.solids import Solid

# Of more corners the near ones are put together: at this number a motion is planned in seconds.
MOST_CORNERS = 50_000
# Where nothing else is said a field is so thick below its lowest point: thicker than a link is long [m].
THICK = 1.0
HIGHEST = 1e3


def read_heights(
    path: Path, size: Float[Array, " 2"], scale: float, base: float | None
) -> tuple[Solid, Float[Array, " 3"]]:
    """The body under a height field, and its middle in the field's own frame, whose origin is the grid's middle [m].

    Args:
        path: `.npy` or text; a row for each y, a column for each x, both rising; heights along z.
        size: From the first to the last column, along x, and from the first to the last row, along y [m].
        scale: Of the heights.
        base: Height down to which it is solid [m]; a metre below its lowest point if None.

    Raises:
        SceneError: The file is missing, too large, no grid, not finite, or its lowest point lies below the base.
    """
    remedy = "fill heights without a reading, with the highest that may be there"
    heights = read_scan(path, "height field", TABLES, None, remedy) * scale
    count, note = heights.size, ""
    if count > MOST_CORNERS:
        heights = coarser(heights, MOST_CORNERS)
        note = f"{count} heights as {heights.size}, each the highest as far as its neighbours"
    low, high = float(heights.min()), float(heights.max())
    if max(-low, high) > HIGHEST:
        what = f"heights from {low:.3g} to {high:.3g} m"
        raise SceneError(path, what, "give scale = 0.001 if they are in millimetres")
    floor = low - THICK if base is None else base
    if not floor < low:
        raise SceneError(path, f"its lowest point, {low:g} m, is not above base_m, {floor:g} m", "give a lower base_m")
    x, y = (np.linspace(-0.5, 0.5, k) * side for k, side in zip(heights.shape[::-1], size, strict=True))
    points, triangles = _closed(heights, x, y, floor)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    return Solid("heights", freeze(np.array([floor - middle[2]])), freeze(points - middle), triangles, note), middle


def coarser(heights: Float[Array, "y x"], most: int) -> Float[Array, "v u"]:
    """Heights over a coarser grid of the same extent that lie nowhere below the given ones.

    A corner is as high as the highest of the given ones as far as its neighbours on the coarse grid, so each corner of
    a coarse triangle is as high as all that the triangle covers.
    """
    share = np.sqrt(most / heights.size)
    for axis in (0, 1):
        rows = np.moveaxis(heights, axis, 0)
        count = max(2, int(len(rows) * share))
        at = np.linspace(0.0, len(rows) - 1.0, count)
        # Rounding must not leave a neighbour out.
        first, last = np.floor(np.r_[at[0], at[:-1]] - 1e-6), np.ceil(np.r_[at[1:], at[-1]] + 1e-6)
        spans = np.clip(np.column_stack([first, last + 1]), 0, len(rows)).astype(int)
        heights = np.moveaxis(np.array([rows[start:stop].max(axis=0) for start, stop in spans]), 0, axis)
    return np.ascontiguousarray(heights)


def _closed(
    heights: Float[Array, "y x"], x: Float[Array, " x"], y: Float[Array, " y"], floor: float
) -> tuple[Float[Array, "k 3"], Int[Array, "m 3"]]:
    """Corners and triangles of the body from the heights down to a floor, seen from outside against the clock."""
    rows, columns = heights.shape
    number = np.arange(rows * columns).reshape(rows, columns)
    top = np.column_stack([np.tile(x, rows), np.repeat(y, columns), heights.reshape(-1)])
    a, b, c, d = (
        number[i : rows - 1 + i, k : columns - 1 + k].reshape(-1) for i, k in ((0, 0), (0, 1), (1, 1), (1, 0))
    )
    edge = np.concatenate([number[0], number[1:, -1], number[-1, -2::-1], number[-2:0:-1, 0]])
    foot = top[edge].copy()
    foot[:, 2] = floor
    under = rows * columns + np.arange(len(edge))
    after, under_after = np.roll(edge, -1), np.roll(under, -1)
    middle = np.full(len(edge), rows * columns + len(edge))
    parts = [(a, b, c), (a, c, d), (under, under_after, after), (under, after, edge), (middle, under_after, under)]
    points = np.concatenate([top, foot, [[0.0, 0.0, floor]]])
    return points, np.concatenate([np.column_stack(part) for part in parts]).astype(np.int64)
