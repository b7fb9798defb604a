"""The tables of a scene file that hold shapes: obstacles, the floor, and what the arm carries."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np

from ident.arrays import Array
from ident.robot.urdf import rpy_to_matrix
from plan.errors import SceneError
from plan.geometry.boxes import Box
from plan.geometry.clouds import read_cloud
from plan.geometry.height_fields import read_heights
from plan.geometry.mesh_obstacles import read_mesh
from plan.geometry.solids import Kind, Solid
from plan.geometry.tool import Carried
from plan.problem.scene_keys import SceneTable

# What each shape needs beside name and place; and keys by which one is known where it is not named.
SHAPE_KEYS: dict[str, set[str]] = {
    "box": {"size_m"},
    "sphere": {"radius_m"},
    "capsule": {"radius_m", "length_m"},
    "cylinder": {"radius_m", "length_m"},
    "mesh": {"file", "scale", "hull"},
    "cloud": {"cloud", "radius_m", "scale"},
    "heights": {"heights", "size_m", "base_m", "scale"},
}
TELLING = {"file": "mesh", "cloud": "cloud", "heights": "heights"}
# What was scanned is given in the base frame, where nothing else is said.
SCANNED = ("cloud", "heights")
PLACE_KEYS, CARRIED_KEYS = {"name", "shape", "xyz_m", "rpy_rad"}, {"touches", "link"}
# A floor is a box so wide that no arm reaches its edge, and so thick that none reaches its bottom: half lengths [m].
FLOOR_HALF = (50.0, 50.0, 1.0)


def read_obstacles(top: SceneTable) -> tuple[Box, ...]:
    """The obstacles of a scene file, and its floor as one more.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind, or a mesh can't be used.
    """
    found = [_shape(_shape_table(top.file, *item), False) for item in top.items("obstacle")]
    if "floor" in top:
        found.append(floor_box(top.table("floor").number("height_m", 0.0, least=-10.0)))
    return tuple(found)


def read_attached(top: SceneTable) -> tuple[Carried, ...]:
    """What the arm carries, the frame on which it hangs, and the links that it may touch."""
    found = []
    for item in top.items("attached"):
        table = _shape_table(top.file, *item, CARRIED_KEYS)
        touches = table.given("touches", [])
        if not isinstance(touches, list) or not all(isinstance(name, str) for name in touches):
            what = f"touches is {touches!r}, not a list of links"
            raise SceneError(top.file, what, 'give touches = ["link", …]')
        link = table.text("link") if "link" in table else None
        found.append(Carried(_shape(table, True), link, tuple(touches)))
    return tuple(found)


def floor_box(height: float) -> Box:
    """The floor at a height above the base's origin [m]."""
    return Box("floor", 0, np.eye(3), np.array([0.0, 0.0, height - FLOOR_HALF[2]]), np.array(FLOOR_HALF))


def _shape_table(file: Path, name: str, entry: dict[str, Any], more: set[str] | None = None) -> SceneTable:
    """A shape's table, its kind found out and its keys looked at."""
    kind = entry.get("shape", next((shape for word, shape in TELLING.items() if word in entry), "box"))
    if kind not in SHAPE_KEYS:
        raise SceneError(file, f"{name}: shape is {kind!r}", f"use one of: {', '.join(SHAPE_KEYS)}")
    table = SceneTable(file, name, {**entry, "shape": kind}, PLACE_KEYS | SHAPE_KEYS[kind] | (more or set()))
    if kind in SCANNED and more is not None:
        remedy = "give another shape, or a mesh, of which the hull counts"
        raise SceneError(file, f"{name}: {kind} can't be carried", remedy)
    return table


def _shape(table: SceneTable, carried: bool) -> Box:
    """A shape and its place; of a mesh that is carried the hull: the arm's own bodies are convex."""
    kind, middle = table.text("shape"), np.zeros(3)
    if kind == "box":
        solid = Solid.simple("box", *(table.numbers("size_m", 3, positive=True) / 2))
    elif kind == "mesh":
        solid, middle = read_mesh(_file(table, "file"), _scale(table), table.flag("hull") or carried)
    elif kind == "heights":
        scale = table.number("scale", 1.0, above=True)
        base = table.number("base_m", least=-np.inf) if "base_m" in table else None
        size = table.numbers("size_m", 2, positive=True)
        solid, middle = read_heights(_file(table, "heights"), size, scale, base)
    else:
        radius = table.number("radius_m", above=True)
        if kind == "cloud":
            solid, middle = read_cloud(_file(table, "cloud"), radius, _scale(table))
        else:
            lengths = () if kind == "sphere" else (table.number("length_m", above=True) / 2,)
            solid = Solid.simple(cast("Kind", kind), radius, *lengths)
    rotation = rpy_to_matrix(table.numbers("rpy_rad", 3, np.zeros(3)))
    centre = table.numbers("xyz_m", 3, np.zeros(3) if kind in SCANNED else None)
    return Box.around(str(table.given("name", table.name)), solid, 0, rotation, centre + rotation @ middle)


def _file(table: SceneTable, key: str) -> Path:
    return table.file.parent / table.text(key)


def _scale(table: SceneTable) -> Array:
    given = table.given("scale", 1.0)
    scaled = SceneTable(table.file, table.name, {"scale": given if isinstance(given, list) else [given] * 3}, {"scale"})
    return scaled.numbers("scale", 3, positive=True)
