"""COLLADA files (.dae) as their shapes alone: what is handed to their reader.

That reader believes what such a file says of itself. A node that stands in itself, elements that
nest without end, lengths that no data follows and corners that are not there end its process or
take all memory. So it gets a file written anew, of triangles, polygons and where they are placed,
in which each number was looked at.

Source: The Khronos Group, 2008, "COLLADA - Digital Asset Schema Release 1.4.1".
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain

import numpy as np

from ident.arrays import Array, Int
from ident.safe_read import DEEPEST, require_unpacked

# How a file begins that is written in UTF-16, and how many bytes say so.
WIDE = (b"\xff\xfe", b"\xfe\xff")
# Numbers of each transformation of a node.
TRANSFORMATIONS = {"lookat": 9, "matrix": 16, "rotate": 4, "scale": 3, "skew": 7, "translate": 3}
# Kinds of primitives with a surface, which has three corners at least.
SURFACES = ("triangles", "polylist", "polygons", "trifans", "tristrips")
FEWEST_CORNERS = 3
# As every reader of numbers reads them.
PLAIN_NUMBERS = re.compile(r"[-+0-9.eE\s]*")
WHOLE_NUMBERS = re.compile(r"[0-9\s]*")
AXES = ["X", "Y", "Z"]
# Beyond any arm's, in any unit.
LARGEST = 1e30
# What a number takes once it is read, with what is made of it [bytes].
NUMBER_BYTES = 8
# What a node takes, in numbers.
NODE_NUMBERS = 512
SHAPE = "shape"
SCENE = "scene"


@dataclass
class _Placing:
    """What the nodes of a scene are made of, and how much of it was placed."""

    shapes: Mapping[str, str]  # by the name of a geometry or of what bends it, the geometry
    nodes: Mapping[str, ET.Element]  # by their names
    sizes: Mapping[str, int]  # numbers of each geometry
    file_bytes: int
    numbers: int = 0
    above: list[str] = field(default_factory=list)  # nodes by name that are being placed

    def add(self, numbers: int) -> None:
        """Counts numbers that were placed; raises ValueError where they are out of proportion."""
        self.numbers += numbers
        require_unpacked(self.file_bytes, NUMBER_BYTES * self.numbers)


def plain_collada(data: bytes) -> bytes:
    """The shapes of a COLLADA file as one that holds nothing else.

    Args:
        data: The file.

    Raises:
        ValueError: It is no such file, or says of itself what is not so.
    """
    root = _read(data)
    _require_honest_counts(root, len(data))
    plain = ET.Element("COLLADA", version=root.get("version", "1.4.1"))
    plain.append(_units(root))
    library = ET.SubElement(plain, "library_geometries")
    sizes = {}
    for geometry in root.iterfind("library_geometries/geometry"):
        name = geometry.get("id", "")
        if name in sizes:
            raise ValueError(f"the geometry {name!r} stands twice")
        sizes[name] = _copy_geometry(geometry, ET.SubElement(library, "geometry", id=name))
    shapes = {name: name for name in sizes}
    for skin in root.iterfind("library_controllers/controller"):
        bent = skin.find("skin")
        if bent is not None:
            shapes.setdefault(skin.get("id", ""), _reference(bent.get("source")))
    nodes: dict[str, ET.Element] = {}
    for node in root.iter("node"):
        nodes.setdefault(node.get("id", ""), node)
    scenes = ET.SubElement(plain, "library_visual_scenes")
    scene = ET.SubElement(scenes, "visual_scene", id=SCENE)
    placing = _Placing(shapes, nodes, sizes, len(data))
    for child in _chosen_scene(root).iterfind("node"):
        _copy_node(child, scene, placing)
    instance = ET.SubElement(plain, "scene")
    ET.SubElement(instance, "instance_visual_scene", url=f"#{SCENE}")
    return ET.tostring(plain, encoding="utf-8", xml_declaration=True)


def _read(data: bytes) -> ET.Element:
    """The file's root, names without their namespaces."""
    wide = "utf-16" if data.startswith(WIDE) else "utf-8-sig"
    try:
        text = data.decode(wide)
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    if "<!ENTITY" in text:
        raise ValueError("it defines entities, which no shape needs")
    try:
        root = ET.fromstring(text)
    except (ET.ParseError, ValueError) as failed:
        raise ValueError(f"it is not XML ({failed})") from None
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    if level:
        raise ValueError(f"its elements nest more than {DEEPEST} levels deep")
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    if root.tag != "COLLADA":
        raise ValueError(f"it begins with {root.tag!r}, not with COLLADA")
    return root


def _require_honest_counts(root: ET.Element, size: int) -> None:
    """Raises for a file that speaks of more than it can hold."""
    for element in root.iter():
        if _count(element, "count", 0) > size:
            raise ValueError(f"speaks of more than its {size} bytes can hold")


def _units(root: ET.Element) -> ET.Element:
    """Which way is up, and how long a unit is [m]."""
    asset = ET.Element("asset")
    unit = root.find("asset/unit")
    if unit is not None:
        metres = _numbers(unit.get("meter", "1"), "a unit")
        if len(metres) != 1 or not float(metres[0]) > 0.0:
            raise ValueError(f"its unit is {unit.get('meter')!r} m long")
        ET.SubElement(asset, "unit", meter=metres[0])
    up = root.findtext("asset/up_axis")
    if up is not None:
        ET.SubElement(asset, "up_axis").text = up.strip()
    return asset


def _chosen_scene(root: ET.Element) -> ET.Element:
    instance = root.find("scene/instance_visual_scene")
    if instance is None:
        raise ValueError("it places no scene")
    name = _reference(instance.get("url"))
    for scene in root.iterfind("library_visual_scenes/visual_scene"):
        if scene.get("id", "") == name:
            return scene
    raise ValueError(f"there is no scene {name!r}")


def _copy_geometry(geometry: ET.Element, plain: ET.Element) -> int:
    """Writes a geometry anew; returns how many numbers it has."""
    numbers = 0
    mesh = geometry.find("mesh")
    if mesh is None:
        return numbers
    vertices = mesh.find("vertices")
    if vertices is None:
        raise ValueError("a mesh without vertices")
    position = _input(vertices, "POSITION")
    words = _positions(_by_id(mesh, "source", position.get("source")))
    shape = ET.SubElement(plain, "mesh")
    name = f"{SHAPE}-{plain.get('id')}"
    _write_positions(shape, name, words)
    numbers += len(words)
    for primitive in mesh:
        if primitive.tag in SURFACES:
            numbers += _copy_primitive(primitive, shape, name, len(words) // len(AXES))
    return numbers


def _positions(source: ET.Element) -> list[str]:
    """The coordinates x, y, z of all corners one after the other, as they are written."""
    accessor = source.find("technique_common/accessor")
    if accessor is None:
        raise ValueError("corners without a number of them")
    array = _by_id(source, "float_array", accessor.get("source"))
    words = _numbers(array.text or "", "corners")
    if _count(array, "count", 0) != len(words):
        raise ValueError(f"{len(words)} numbers where its header says {array.get('count')}")
    stride = _count(accessor, "stride", 1)
    count = _count(accessor, "count", 0)
    offset = _count(accessor, "offset", 0)
    axes = [param.get("name") for param in accessor.iterfind("param")]
    if any(axes.count(axis) != 1 for axis in AXES) or len(axes) > stride:
        raise ValueError("corners that are not X, Y and Z")
    if offset + stride * count > len(words):
        raise ValueError(f"{count} corners where {len(words)} numbers are")
    used = words[offset : offset + stride * count]
    columns = [used[axes.index(axis) :: stride] for axis in AXES]
    return list(chain.from_iterable(zip(*columns, strict=True)))


def _write_positions(mesh: ET.Element, name: str, words: list[str]) -> None:
    """Writes corners, and the vertices that they are."""
    source = ET.SubElement(mesh, "source", id=f"{name}-corners")
    array = ET.SubElement(source, "float_array", id=f"{name}-numbers", count=str(len(words)))
    array.text = " ".join(words)
    common = ET.SubElement(source, "technique_common")
    given = {"source": f"#{name}-numbers", "stride": str(len(AXES))}
    accessor = ET.SubElement(common, "accessor", given, count=str(len(words) // len(AXES)))
    for axis in AXES:
        ET.SubElement(accessor, "param", name=axis, type="float")
    vertices = ET.SubElement(mesh, "vertices", id=f"{name}-vertices")
    ET.SubElement(vertices, "input", semantic="POSITION", source=f"#{name}-corners")


def _copy_primitive(primitive: ET.Element, mesh: ET.Element, name: str, corners: int) -> int:
    """Writes triangles or polygons anew, by the numbers of their corners alone; how many."""
    offset = _count(_input(primitive, "VERTEX"), "offset", 0)
    each = 1 + max(_count(entry, "offset", 0) for entry in primitive.iterfind("input"))
    plain = ET.Element(primitive.tag)
    used = 0
    sides = [_whole(element.text) for element in primitive.iterfind("vcount")]
    for element in primitive.iterfind("p"):
        places = _whole(element.text)
        if len(places) % each:
            raise ValueError(f"{primitive.tag} with a part of a corner")
        chosen = places[offset::each]
        if len(chosen) and chosen.max() >= corners:
            raise ValueError(f"{primitive.tag} with corners that are not there")
        if primitive.tag != "triangles" and 0 < len(chosen) < FEWEST_CORNERS:
            raise ValueError(f"{primitive.tag} of fewer than three corners")
        if not len(chosen):
            continue
        used += len(chosen)
        ET.SubElement(plain, "p").text = " ".join(map(str, chosen.tolist()))
    if not used:
        return 0
    count = len(plain)
    if primitive.tag == "triangles":
        if used % FEWEST_CORNERS:
            raise ValueError("triangles with a part of one")
        count = used // FEWEST_CORNERS
    elif primitive.tag == "polylist":
        if len(sides) != 1 or len(plain) != 1 or sides[0].sum() != used:
            raise ValueError("polygons whose corners are counted otherwise than they are there")
        count = len(sides[0])
        ET.SubElement(plain, "vcount").text = " ".join(map(str, sides[0].tolist()))
        plain[:] = [plain[1], plain[0]]
    plain.set("count", str(count))
    given = {"semantic": "VERTEX", "source": f"#{name}-vertices", "offset": "0"}
    plain.insert(0, ET.Element("input", given))
    mesh.append(plain)
    return used


def _copy_node(node: ET.Element, parent: ET.Element, placing: _Placing) -> None:
    """Writes a node anew, with all that it places; nodes that it names are put in its place."""
    name = node.get("id", "")
    if name and name in placing.above:
        raise ValueError(f"the node {name!r} stands in itself")
    if len(placing.above) > DEEPEST:
        raise ValueError(f"its nodes nest more than {DEEPEST} levels deep")
    placing.above.append(name)
    plain = ET.SubElement(parent, "node")
    placing.add(NODE_NUMBERS)
    for child in node:
        if child.tag in TRANSFORMATIONS:
            words = _numbers(child.text or "", f"a node's {child.tag}")
            if len(words) != TRANSFORMATIONS[child.tag]:
                raise ValueError(f"a node's {child.tag} of {len(words)} numbers")
            ET.SubElement(plain, child.tag).text = " ".join(words)
        elif child.tag in ("instance_geometry", "instance_controller"):
            shape = placing.shapes.get(_reference(child.get("url")), "")
            if shape not in placing.sizes:
                raise ValueError(f"there is no geometry {child.get('url')!r}")
            placing.add(placing.sizes[shape])
            ET.SubElement(plain, "instance_geometry", url=f"#{shape}")
    for child in _placed_below(node, placing.nodes):
        _copy_node(child, plain, placing)
    placing.above.pop()


def _placed_below(node: ET.Element, nodes: Mapping[str, ET.Element]) -> Iterator[ET.Element]:
    """The nodes within a node, and those that it names."""
    for child in node:
        if child.tag == "node":
            yield child
        elif child.tag == "instance_node":
            name = _reference(child.get("url"))
            if name not in nodes:
                raise ValueError(f"there is no node {name!r}")
            yield nodes[name]


def _input(element: ET.Element, semantic: str) -> ET.Element:
    """The input of a meaning; exactly one."""
    inputs = element.findall(f"input[@semantic='{semantic}']")
    if len(inputs) != 1:
        raise ValueError(f"{element.tag} with {len(inputs)} inputs {semantic}")
    return inputs[0]


def _by_id(parent: ET.Element, tag: str, reference: str | None) -> ET.Element:
    """The element within another that a reference names; exactly one."""
    name = _reference(reference)
    named = [element for element in parent.iterfind(tag) if element.get("id") == name]
    if len(named) != 1:
        raise ValueError(f"{len(named)} elements {tag} are called {name!r}")
    return named[0]


def _reference(reference: str | None) -> str:
    """The name behind a reference's #."""
    if reference is None or not reference.startswith("#"):
        raise ValueError(f"the reference {reference!r} leads out of the file")
    return reference[1:]


def _count(element: ET.Element, key: str, usual: int) -> int:
    """A whole number of an attribute."""
    text = element.get(key, str(usual)).strip()
    if not (text.isascii() and text.isdigit()):
        raise ValueError(f"has a {key} that is no plain number")
    return int(text)


def _numbers(text: str, what: str) -> list[str]:
    """Numbers as they are written, each looked at."""
    words = text.split()
    if not PLAIN_NUMBERS.fullmatch(text):
        raise ValueError(f"{what} with what is no number")
    try:
        values = list(map(float, words))
    except ValueError:
        raise ValueError(f"{what} with what is no number") from None
    if not all(abs(value) < LARGEST for value in values):
        raise ValueError(f"{what} beyond any arm's")
    return words


def _whole(text: str | None) -> Int[Array, " k"]:
    """Whole numbers."""
    if not WHOLE_NUMBERS.fullmatch(text or ""):
        raise ValueError("numbers of corners that are none")
    try:
        return np.array(list(map(int, (text or "").split())), dtype=np.int64)
    except (ValueError, OverflowError):
        raise ValueError("numbers of corners that are none") from None
