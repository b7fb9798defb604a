"""Obstacles from files: meshes, read by Coal and looked over. Point clouds stand in `clouds`."""

from __future__ import annotations

import os
from pathlib import Path

import coal
import numpy as np

from ident.arrays import Array, Float, Int
from ident.errors import InputError
from ident.robot.meshes import lent_mesh
from plan.geometry.solids import Solid, hull_points, mesh_triangles

# A surface of more triangles takes minutes to plan round; nobody needs so many to keep clear of a
# thing.
MOST_TRIANGLES = 100_000
# Corners closer than this share of the mesh's size are the same: STL files repeat each corner for
# each triangle.
MERGED = 1e-7
# A mesh as long as this is in another unit [m].
LONGEST = 1e3


def read_mesh(
    path: Path, scale: Float[Array, " 3"], hull: bool
) -> tuple[Solid, Float[Array, " 3"]]:
    """The solid of a mesh file and the middle of it in the mesh's own frame [m].

    A closed mesh counts as it is, hollows and all; with `hull`, any mesh counts as the smallest
    convex body round it.

    Args:
        path: STL, OBJ, DAE or PLY.
        scale: Of each axis.
        hull: Whether the hull is meant.

    Raises:
        InputError: The file is missing, no mesh, not finite, too large, or open.
    """
    if not os.path.isfile(path):  # false of names that no file can have, too
        remedy = "give the path of an STL, OBJ or DAE file, from the scene file on"
        raise InputError(path, "no such mesh file", remedy)
    with lent_mesh(path, path, "", InputError) as lent:  # Coal takes no open file
        model = _load(lent, scale, path)
    points = np.array(model.vertices())
    triangles = mesh_triangles(model)
    if len(triangles) == 0 or not np.isfinite(points).all():
        what = "the mesh has no triangle, or a corner that is no number"
        raise InputError(path, what, "mend or replace the mesh")
    size = float(np.ptp(points, axis=0).max())
    if not 0.0 < size < LONGEST:
        what = f"the mesh is {size:.3g} m long"
        raise InputError(path, what, "give scale = 0.001 if it is in millimetres")
    if hull:
        middle = _middle(points)
        return Solid.hull(hull_points(points) - middle), middle
    if len(triangles) > MOST_TRIANGLES:
        what = f"the mesh has {len(triangles)} triangles, more than {MOST_TRIANGLES}"
        raise InputError(path, what, "simplify it, or set hull = true")
    points, triangles = _merged(points, triangles, MERGED * size)
    loose = _loose_edges(triangles)
    if loose:
        what = f"the mesh is open: {loose} edges belong to one triangle only"
        raise InputError(path, what, "close it, or set hull = true")
    middle = _middle(points)
    return Solid.surface(points - middle, triangles), middle


def _load(path: Path, scale: Float[Array, " 3"], where: Path) -> coal.BVHModelBase:
    """A mesh as Coal reads it; of a file that messages call by its own name.

    Raises:
        InputError: Coal can't read it.
    """
    loader = coal.MeshLoader(coal.NODE_TYPE.BV_AABB)
    try:
        return loader.load(str(path), np.array(scale, dtype=float))
    except (ValueError, RuntimeError) as error:
        lines = [line.removeprefix("message: ") for line in str(error).splitlines()]
        reason = next((line for line in lines if "resource" in line), "the reader refused it")
        what = f"the mesh can't be read ({reason.replace(str(path), str(where))})"
        raise InputError(where, what, "mend or replace the mesh") from None


def _middle(points: Float[Array, "k 3"]) -> Float[Array, " 3"]:
    """The middle of what points span along each axis [m]."""
    return (points.min(axis=0) + points.max(axis=0)) / 2


def _merged(
    points: Float[Array, "k 3"], triangles: Int[Array, "m 3"], cell: float
) -> tuple[Float[Array, "l 3"], Int[Array, "p 3"]]:
    """A mesh with a single corner for all that are as good as the same.

    Triangles that shrink to a line are left out.

    Args:
        points: Corners [m].
        triangles: Numbers of each one's corners.
        cell: Corners in the same cell of this size are as good as the same [m].
    """
    cells = np.round(points / cell).astype(np.int64)
    _, first, which = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    triangles = which.reshape(-1)[triangles]
    differ = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
    return points[first], triangles[differ]


def _loose_edges(triangles: Int[Array, "m 3"]) -> int:
    """Number of edges in an odd number of triangles: with any of these a mesh has no inside."""
    sides = [triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]
    edges = np.sort(np.concatenate(sides), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return int((counts % 2).sum())


def holds(solid: Solid, point: Float[Array, " 3"]) -> bool:
    """Whether a closed surface has a point, in its own axes, inside.

    By the solid angle under which the surface is seen.

    Source: A. van Oosterom, J. Strackee, 1983, "The solid angle of a plane triangle".
    """
    first, second, third = solid.triangles.T
    a = solid.points[first] - point
    b = solid.points[second] - point
    c = solid.points[third] - point
    length_a = np.linalg.norm(a, axis=1)
    length_b = np.linalg.norm(b, axis=1)
    length_c = np.linalg.norm(c, axis=1)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c))
    flat = length_a * length_b * length_c + np.einsum("ij,ij->i", a, b) * length_c
    opposite_a = np.einsum("ij,ij->i", b, c) * length_a
    opposite_b = np.einsum("ij,ij->i", c, a) * length_b
    flat += opposite_a + opposite_b
    angle = 2.0 * np.arctan2(volume, flat).sum()
    return bool(abs(angle) > 2.0 * np.pi)
