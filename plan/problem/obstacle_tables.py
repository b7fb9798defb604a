"""The tables of a scene file that hold shapes: obstacles, the floor, and what the arm carries."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.arrays import Array
from ident.robot.urdf import rpy_to_matrix
from plan.errors import SceneError
from plan.geometry.boxes import Box
from plan.geometry.clouds import read_cloud
from plan.geometry.height_fields import read_heights
from plan.geometry.mesh_obstacles import read_mesh
from plan.geometry.solids import Solid

if TYPE_CHECKING:
    from plan.problem.task_file import Reader

# What each shape needs beside name and place.
SHAPE_KEYS: dict[str, set[str]] = {
    "box": {"size_m"},
    "sphere": {"radius_m"},
    "capsule": {"radius_m", "length_m"},
    "cylinder": {"radius_m", "length_m"},
    "mesh": {"file", "scale", "hull"},
    "cloud": {"cloud", "radius_m", "scale"},
    "heights": {"heights", "size_m", "base_m", "scale"},
}
# Keys by which a shape is known where it is not named.
TELLING = {"file": "mesh", "cloud": "cloud", "heights": "heights"}
# What was scanned is given in the base frame, where nothing else is said.
SCANNED = ("cloud", "heights")
PLACE_KEYS = {"name", "shape", "xyz_m", "rpy_rad"}
# A floor is a box so wide that no arm reaches its edge, and so thick that none reaches its bottom: half lengths [m].
FLOOR_HALF = (50.0, 50.0, 1.0)


def read_shape(reader: Reader, entry: Any, key: str, extra: set[str] | None = None) -> Box:
    """A shape and its place, from one table.

    Args:
        reader: Of the scene file.
        entry: The table.
        key: Its name in messages.
        extra: Keys that it may have beside those of its shape.

    Raises:
        SceneError: A key is missing, unknown or of the wrong kind, or a mesh can't be used.
    """
    if not isinstance(entry, dict):
        raise SceneError(reader.file, f"{key} is not a table", "write [[obstacle]] and its keys")
    kind = entry.get("shape", next((shape for word, shape in TELLING.items() if word in entry), "box"))
    if kind not in SHAPE_KEYS:
        raise SceneError(reader.file, f"{key}: shape is {kind!r}", f"use one of: {', '.join(SHAPE_KEYS)}")
    reader.only(entry, PLACE_KEYS | SHAPE_KEYS[kind] | (extra or set()), key)
    if kind in SCANNED and extra is not None:
        remedy = "give another shape, or a mesh, of which the hull counts"
        raise SceneError(reader.file, f"{key}: {kind} can't be carried", remedy)
    rotation = rpy_to_matrix(reader.numbers(entry, f"{key}.rpy_rad", 3, np.zeros(3)))
    centre = reader.numbers(entry, f"{key}.xyz_m", 3, np.zeros(3) if kind in SCANNED else None)
    solid, middle = _solid(reader, entry, key, kind, extra is not None)
    return Box.around(str(entry.get("name", key)), solid, 0, rotation, centre + rotation @ middle)


def _solid(reader: Reader, entry: Mapping[str, Any], key: str, kind: str, carried: bool) -> tuple[Solid, Array]:
    middle = np.zeros(3)
    if kind == "box":
        return Solid.simple("box", *(_sizes(reader, entry, key, 3) / 2)), middle
    if kind == "mesh":
        return _mesh(reader, entry, key, carried)
    if kind == "heights":
        scale = float(_positive(reader, {"scale": 1.0, **entry}, key, "scale"))
        base = reader.number(entry, f"{key}.base_m", least=-np.inf) if "base_m" in entry else None
        file = reader.file.parent / reader.text(entry, "heights")
        return read_heights(file, _sizes(reader, entry, key, 2), scale, base)
    radius = _positive(reader, entry, key, "radius_m")
    if kind == "cloud":
        return read_cloud(reader.file.parent / reader.text(entry, "cloud"), radius, _scale(reader, entry, key))
    if kind == "sphere":
        return Solid.simple("sphere", radius), middle
    length = _positive(reader, entry, key, "length_m")
    return Solid.simple("capsule" if kind == "capsule" else "cylinder", radius, length / 2), middle


def _mesh(reader: Reader, entry: Mapping[str, Any], key: str, carried: bool) -> tuple[Solid, Array]:
    """A mesh file's solid; of what is carried the hull: the arm's own bodies are convex."""
    hull = entry.get("hull", False)
    if not isinstance(hull, bool):
        raise SceneError(reader.file, f"{key}.hull is {hull!r}", "give true or false")
    return read_mesh(reader.file.parent / reader.text(entry, "file"), _scale(reader, entry, key), hull or carried)


def _scale(reader: Reader, entry: Mapping[str, Any], key: str) -> Array:
    given = entry.get("scale", 1.0)
    return reader.positive({"scale": given if isinstance(given, list) else [given] * 3}, f"{key}.scale", 3)


def _positive(reader: Reader, entry: Mapping[str, Any], key: str, name: str) -> float:
    if name not in entry:
        raise SceneError(reader.file, f"{key}.{name} is missing", "add it, in metres")
    value = entry[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < np.inf:
        raise SceneError(reader.file, f"{key}.{name} is {value!r}, not a number above zero", "give one")
    return float(value)


def _sizes(reader: Reader, entry: Mapping[str, Any], key: str, count: int) -> Array:
    size = reader.numbers(entry, f"{key}.size_m", count)
    if np.any(size <= 0):
        what = f"{key}: size_m {size.tolist()} has a side that is not above zero"
        raise SceneError(reader.file, what, "give lengths")
    return size


def floor_box(height: float) -> Box:
    """The floor at a height above the base's origin [m]."""
    return Box("floor", 0, np.eye(3), np.array([0.0, 0.0, height - FLOOR_HALF[2]]), np.array(FLOOR_HALF))
