"""The mesh files that a URDF names: where they lie, and which are refused."""

from __future__ import annotations

import re
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from ident.errors import InputError, RobotError, first_line
from ident.outputs import real_path
from ident.robot.names import example_robots_folder
from ident.safe_read import read_bytes, require_regular, unchanged

# Larger mesh files are no collision geometry, nor are all of an arm's together that are larger: no
# robot of example-robot-data has more than 40 MB [bytes].
LARGEST = 200_000_000
READABLE = (".stl", ".obj", ".dae", ".ply")
# What the header of a .ply says is in it.
ELEMENTS = re.compile(rb"(?:^|[\r\n])[ \t]*element[ \t]+\S+[ \t]+(\d+)")
HEADER_BYTES = 1 << 16
PLY_END = b"end_header"
# Bytes of a binary .stl before its triangles, and of one of them.
STL_HEAD = 84
STL_TRIANGLE = 50
LONGEST_COUNT = 20
# By which an .obj names files of materials, which its reader would open, and look for in many
# places; a comment of the same length; and how one line goes on in the next.
MATERIALS = b"mtllib"
NO_MATERIALS = b"#tllib"
COPY_PREFIX = "armgap-mesh-"
CONTINUED = re.compile(rb"\\(?:\n|[\r\f\0][^\n]*\n)")


def find_mesh(name: str, source: Path | None) -> Path | None:
    """The file of a mesh name, or None.

    `package://P/rest` is looked for in every folder above the URDF, in example-robot-data, and,
    where no folder is called P, as `rest` beside the URDF and above it.
    """
    relative = Path(name.removeprefix("file://").removeprefix("package://"))
    here = [] if source is None else list(real_path(source).parents)
    if name.startswith("package://"):
        packages = example_robots_folder()
        rest = Path(*relative.parts[1:])
        tried = [folder / relative for folder in (*here, packages, packages.parent.parent)]
        tried += [folder / rest for folder in here[:3]]
    elif name.startswith("file://") or relative.is_absolute():
        tried = [relative]
    else:
        tried = [folder / relative for folder in here[:2]]
    return next((path for path in tried if path.is_file()), None)


@contextmanager
def lent_mesh(path: Path, where: str | Path, place: str, error: type[InputError]) -> Iterator[Path]:
    """Lends a mesh that was looked through to a reader that opens it by its name.

    An .obj that names materials is lent as a copy without: a shape needs none, and its reader
    would open other files. A .dae is lent as a copy that holds its shapes alone.

    Raises:
        InputError: As `require_mesh`; or the file changes while it is read.
    """
    with unchanged(path, error, where):
        data = require_mesh(path, where, place, error)
        kind = path.suffix.lower()
        copied = None
        if kind == ".obj":
            text = CONTINUED.sub(b"", data)
            copied = text.replace(MATERIALS, NO_MATERIALS) if MATERIALS in text else None
        elif kind == ".dae":
            copied = _plain_collada(data, where, place, error)
        if copied is None:
            yield path
            return
        with TemporaryDirectory(prefix=COPY_PREFIX) as folder:
            copy = Path(folder) / f"mesh{kind}"
            copy.write_bytes(copied)
            yield copy


def _plain_collada(data: bytes, where: str | Path, place: str, error: type[InputError]) -> bytes:
    """The shapes of a .dae alone; raises where it is none."""
    from ident.robot.collada import plain_collada  # few meshes are of this kind

    try:
        return plain_collada(data)
    except ValueError as failed:
        what = f"{place}is no .dae that can be used ({first_line(failed)})"
        raise error(where, what, "mend or replace the mesh") from None


def require_mesh(path: Path, where: str | Path, place: str, error: type[InputError]) -> bytes:
    """The bytes of a mesh file; raises for a file that is none, or too large.

    Args:
        path: The mesh file.
        where: The file that names it, for the message.
        place: What stands before "is no mesh …" in the message, with a blank at its end.
        error: What is raised.
    """
    if path.suffix.lower() not in READABLE:
        raise error(
            where, f"{place}is no mesh that can be read", f"give one of: {', '.join(READABLE)}"
        )
    kind = path.suffix.lower()
    size = require_regular(path, "mend or replace the mesh", error)
    if size > LARGEST:
        raise error(where, f"{place}has {size / 1e6:.0f} MB", "give a simplified mesh")
    data = read_bytes(path, "mend or replace the mesh", error, LARGEST)
    require_honest_header(data, kind, where, place, error)
    if kind == ".ply":
        require_sound_ply(data, where, place, error)
    return data


def require_honest_header(
    data: bytes, kind: str, where: str | Path, place: str, error: type[InputError]
) -> None:
    """Raises for a mesh whose header speaks of more than its file can hold: its reader would make
    room for it.
    """
    size = len(data)
    head = data[: max(HEADER_BYTES, data.find(PLY_END))]
    announced = 0
    if kind == ".ply":
        announced = max(map(_whole, ELEMENTS.findall(head)), default=0)
    elif kind == ".stl" and not head.lstrip().startswith(b"solid") and len(head) >= STL_HEAD:
        announced = STL_TRIANGLE * int.from_bytes(head[STL_HEAD - 4 : STL_HEAD], "little")
    if announced > size:
        what = f"{place}speaks of more than its {size} bytes can hold"
        raise error(where, what, "mend or replace the mesh")


def require_sound_ply(data: bytes, where: str | Path, place: str, error: type[InputError]) -> None:
    """Raises for a .ply whose triangles name corners that are not there: its reader would read
    beyond them.
    """
    from plyfile import PlyData, PlyListProperty  # few meshes are of this kind

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read = PlyData.read(BytesIO(data))
        corners = len(read["vertex"])
        faces = next(element for element in read.elements if element.name == "face")
        lists = [faces[name.name] for name in faces.properties if isinstance(name, PlyListProperty)]
        named = [np.asarray(corners) for column in lists for corners in column if len(corners)]
        numbers = np.concatenate([np.zeros(1), *named])
    # the package raises its own, and whatever NumPy raises at odd numbers
    except Exception as failed:
        what = f"{place}is no whole .ply ({first_line(failed)})"
        raise error(where, what, "mend or replace the mesh") from None
    is_finite = np.isfinite(numbers).all()
    if not is_finite or numbers.min() < 0 or numbers.max() >= max(corners, 1):
        what = f"{place}has triangles of corners that are not there"
        raise error(where, what, "mend or replace the mesh")


def _whole(digits: bytes) -> int:
    """A count as its header writes it; of very many digits only so many as tell that it is too
    large.
    """
    return int(digits[:LONGEST_COUNT])


def with_mesh_paths(
    urdf: str, tag: str, source: Path | None, where: str, lent: ExitStack
) -> tuple[str, dict[str, str]]:
    """The URDF with the meshes of one tag, `collision` or `visual`, named by their paths, and the
    file that each path stands for; the other tag's are left out.

    Args:
        urdf: The URDF.
        tag: The tag.
        source: File that it stands in.
        where: The arm, for messages.
        lent: Keeps the meshes as they were looked through until they are read.

    Raises:
        RobotError: A mesh is missing, or as `require_mesh`; or all of them together, each as often
            as it is named, are larger than a single one may be.
    """
    root = ET.fromstring(urdf)
    files = {}
    total = 0
    other = "visual" if tag == "collision" else "collision"
    for link in root.findall("link"):
        for element in link.findall(other):
            link.remove(element)
        for mesh in link.findall(f"{tag}/geometry/mesh"):
            name = mesh.get("filename", "")
            path = find_mesh(name, source)
            place = f"{link.get('name', '')}: mesh {name!r}"
            if path is None:
                remedy = "put the mesh files beside the URDF, under their package's name"
                raise RobotError(where, f"{place} is not there", remedy)
            total += path.stat().st_size
            if total > LARGEST:
                what = f"its meshes up to {place} have {total / 1e6:.0f} MB"
                raise RobotError(where, what, "give simplified meshes, or name each once")
            mesh_file = lent.enter_context(lent_mesh(path, where, f"{place} ", RobotError))
            mesh.set("filename", str(mesh_file))
            files[str(mesh_file)] = str(path)
    return ET.tostring(root, encoding="unicode"), files
