"""Obstacles from mesh files: read by Coal, looked over before anything is planned round them."""

from __future__ import annotations

import os
from pathlib import Path

import coal
import numpy as np

from ident.arrays import Array, Float, Int
from ident.robot.names import require_mesh
from plan.errors import SceneError
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
        SceneError: The file is missing, no mesh, not finite, too large, or open.
    """
    if not os.path.isfile(path):  # false of names that no file can have, too
        raise SceneError(path, "no such mesh file", "give the path of an STL, OBJ or DAE file, from the scene file on")
    require_mesh(path, path, "", SceneError)
    points, triangles = _load(path, scale)
    if len(triangles) == 0 or not np.isfinite(points).all():
        raise SceneError(path, "the mesh has no triangle, or a corner that is no number", "mend or replace the mesh")
    size = float(np.ptp(points, axis=0).max())
    if not 0.0 < size < 1e3:
        raise SceneError(path, f"the mesh is {size:.3g} m long", "give scale = 0.001 if it is in millimetres")
    if not hull:
        if len(triangles) > MOST_TRIANGLES:
            what = f"the mesh has {len(triangles)} triangles, more than {MOST_TRIANGLES}"
            raise SceneError(path, what, "simplify it, or set hull = true")
        points, triangles = _merge(points, triangles, MERGED * size)
        _require_closed(path, triangles)
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    if hull:
        return Solid.hull(hull_points(points) - middle), middle
    return Solid.surface(points - middle, triangles), middle


def _load(path: Path, scale: Array) -> tuple[Float[Array, "k 3"], Int[Array, "m 3"]]:
    try:
        model = coal.MeshLoader(coal.NODE_TYPE.BV_AABB).load(str(path), np.array(scale, dtype=float))
    except (ValueError, RuntimeError) as error:
        lines = [line.removeprefix("message: ") for line in str(error).splitlines()]
        reason = next((line for line in lines if "resource" in line), "the reader refused it")
        raise SceneError(path, f"the mesh can't be read ({reason})", "mend or replace the mesh") from None
    return np.array(model.vertices()), mesh_triangles(model)


def _merge(points: Array, triangles: Array, near: float) -> tuple[Array, Array]:
    """One corner for all that are as good as the same; triangles that shrink to a line are left out."""
    _, first, which = np.unique(
        np.round(points / near).astype(np.int64), axis=0, return_index=True, return_inverse=True
    )
    merged = which.reshape(-1)[triangles]
    whole = (merged[:, 0] != merged[:, 1]) & (merged[:, 1] != merged[:, 2]) & (merged[:, 2] != merged[:, 0])
    return points[first], merged[whole]


def _require_closed(path: Path, triangles: Array) -> None:
    """Raises SceneError unless every edge belongs to an even number of triangles: else it has no inside."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    loose = int((count % 2).sum())
    if loose:
        raise SceneError(
            path, f"the mesh is open: {loose} edges belong to one triangle only", "close it, or set hull = true"
        )


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
