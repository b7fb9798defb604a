"""Where the meshes of a URDF lie: `package://` names, paths beside the URDF; and what is wrong with one."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from ident.errors import RobotError
from ident.robot.names import example_robots_folder

# Larger mesh files are no collision geometry [bytes].
LARGEST = 200_000_000
READABLE = (".stl", ".obj", ".dae", ".ply")


def find_mesh(name: str, source: Path | None) -> Path | None:
    """The file of a mesh name, or None.

    `package://P/rest` is looked for in every folder above the URDF, in example-robot-data, and, where no folder is
    called P, as `rest` beside the URDF and above it.
    """
    if name.startswith("file://"):
        path = Path(name.removeprefix("file://"))
        return path if path.is_file() else None
    here = [] if source is None else list(source.resolve().parents)
    packages = example_robots_folder()
    package = name.startswith("package://")
    relative = Path(name.removeprefix("package://"))
    folders = [*here, packages, packages.parent.parent]
    tried = [folder / relative for folder in (folders if package else here[:2])]
    if package:
        rest = Path(*relative.parts[1:])
        tried += [folder / rest for folder in here[:3]]
    elif relative.is_absolute():
        tried = [relative]
    return next((path for path in tried if path.is_file()), None)


def with_mesh_paths(urdf: str, tag: str, source: Path | None, where: str) -> str:
    """The URDF with the meshes of one tag, `collision` or `visual`, named by their paths; the other tag's are left out.

    Raises:
        RobotError: A mesh is missing, of a kind that can't be read, or too large.
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
            if path.suffix.lower() not in READABLE:
                raise RobotError(where, f"{place} is no mesh that can be read", f"give one of: {', '.join(READABLE)}")
            size = path.stat().st_size
            if size > LARGEST:
                raise RobotError(where, f"{place} has {size / 1e6:.0f} MB", "give a simplified mesh for collisions")
            mesh.set("filename", str(path))
    return ET.tostring(root, encoding="unicode")
