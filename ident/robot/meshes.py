"""The mesh files that a URDF names: where they lie, and which are refused."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ET
from pathlib import Path

from ident.errors import InputError, RobotError
from ident.robot.names import example_robots_folder

# Larger mesh files are no collision geometry [bytes].
LARGEST = 200_000_000
READABLE = (".stl", ".obj", ".dae", ".ply")
# The files in which an .obj's materials stand, which its reader opens, too.
MATERIALS = re.compile(rb"(?m)^\s*mtllib\s+(\S.*?)\s*$")


def find_mesh(name: str, source: Path | None) -> Path | None:
    """The file of a mesh name, or None.

    `package://P/rest` is looked for in every folder above the URDF, in example-robot-data, and, where no folder is
    called P, as `rest` beside the URDF and above it.
    """
    relative = Path(name.removeprefix("file://").removeprefix("package://"))
    here = [] if source is None else list(source.resolve().parents)
    if name.startswith("package://"):
        packages, rest = example_robots_folder(), Path(*relative.parts[1:])
        tried = [folder / relative for folder in (*here, packages, packages.parent.parent)]
        tried += [folder / rest for folder in here[:3]]
    elif name.startswith("file://") or relative.is_absolute():
        tried = [relative]
    else:
        tried = [folder / relative for folder in here[:2]]
    return next((path for path in tried if path.is_file()), None)


def require_mesh(path: Path, where: str | Path, place: str, error: type[InputError]) -> None:
    """Raises for a file that is no mesh, too large, or has its reader open what is no plain file beside it."""
    if path.suffix.lower() not in READABLE:
        raise error(where, f"{place}is no mesh that can be read", f"give one of: {', '.join(READABLE)}")
    if (size := path.stat().st_size) > LARGEST:
        raise error(where, f"{place}has {size / 1e6:.0f} MB", "give a simplified mesh")
    for name in MATERIALS.findall(path.read_bytes()) if path.suffix.lower() == ".obj" else ():
        material = (path.parent / os.fsdecode(name).lstrip("/")).resolve()
        if material.exists() and not (material.is_file() and material.is_relative_to(path.parent.resolve())):
            what = f"{place}names {os.fsdecode(name)!r}, no plain file beside it"
            raise error(where, what, "take the line mtllib out: a shape needs no materials")


def with_mesh_paths(urdf: str, tag: str, source: Path | None, where: str) -> str:
    """The URDF with the meshes of one tag, `collision` or `visual`, named by their paths; the other tag's are left out.

    Raises:
        RobotError: A mesh is missing, or as `require_mesh`.
    """
    root = ET.fromstring(urdf)
    other = "visual" if tag == "collision" else "collision"
    for link in root.findall("link"):
        for element in link.findall(other):
            link.remove(element)
        for mesh in link.findall(f"{tag}/geometry/mesh"):
            name = mesh.get("filename", "")
            path, place = find_mesh(name, source), f"link {link.get('name', '')}: mesh {name!r}"
            if path is None:
                remedy = "put the mesh files beside the URDF, under their package's name"
                raise RobotError(where, f"{place} is not there", remedy)
            require_mesh(path, where, f"{place} ", RobotError)
            mesh.set("filename", str(path))
    return ET.tostring(root, encoding="unicode")
