"""A user's own URDF or MJCF, looked through before MuJoCo reads it: it may be a stranger's.

MuJoCo opens whatever an MJCF names and makes as many bodies as it says; its reader is no Python, so
that a pipe would stop it for good.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

from ident.errors import InputError
from ident.robot.safe_xml import read_xml
from ident.safe_read import LARGEST_TEXT, decode, read_bytes, require_regular

REMEDY = "give your own URDF or MJCF"
# Elements that read another file as a part of this one.
OTHER_FILES = ("include", "model")
# Attributes that name a file, and folders that such names start from.
FILE = re.compile(r"file(right|left|up|down|front|back)?")
FOLDERS = ("meshdir", "texturedir", "assetdir")
# Attributes by which an element stands for many, or for a picture or a field of heights.
COUNTS = ("count", "nuserdata", "nkey", "nsample", "njmax", "nconmax", "nstack")
SIDES = ("nrow", "ncol", "width", "height")
# Larger than any scene: parts, and pixels of one picture.
MOST_PARTS = 100_000
MOST_PIXELS = 1 << 26
# Memory that a file asks for: digits, and what multiplies them.
MEMORY = re.compile(r"\s*(\d+)\s*([KMGTPE]?)\s*")
POWERS = " KMGTPE"


def read_own_file(path: Path) -> bytes:
    """The bytes of a user's XML file that simulators can read at no risk.

    Raises:
        InputError: No plain file, no UTF-8, no XML, nested without end; or an MJCF that includes
            others, names what is no plain file, or multiplies beyond any scene.
    """
    data = read_bytes(path, REMEDY)
    root = read_xml(decode(data, path, REMEDY), path, REMEDY, InputError)
    if root.tag == "mujoco":
        _require_bounded(root, path)
    return data


def _require_bounded(root: ET.Element, path: Path) -> None:
    """Raises for an MJCF that opens other files than meshes and pictures, or multiplies."""
    folders = {""}
    for compiler in root.iter("compiler"):
        folders.update(compiler.get(key, "") for key in FOLDERS)
    for element, count in _counted(root, path):
        if element.tag in OTHER_FILES:
            remedy = "give the file in which the arm's bodies stand"
            raise InputError(path, f"its <{element.tag}> reads another file", remedy)
        pixels = math.prod(_sizes(element, SIDES, path))
        if count > MOST_PARTS or pixels > MOST_PIXELS or _asked_memory(element) > LARGEST_TEXT:
            raise InputError(path, f"its <{element.tag}> is larger than any scene", REMEDY)
        for key, name in element.attrib.items():
            if FILE.fullmatch(key):
                _require_plain_files(path, folders, name)


def _counted(root: ET.Element, path: Path) -> Iterator[tuple[ET.Element, int]]:
    """All elements, and how often each stands there with those around it."""
    waiting = [(root, 1)]
    while waiting:
        element, count = waiting.pop()
        count *= math.prod(_sizes(element, COUNTS, path))
        yield element, count
        waiting += [(child, count) for child in element]


def _sizes(element: ET.Element, keys: tuple[str, ...], path: Path) -> Iterator[int]:
    """Whole numbers of some attributes, at least one each."""
    for key in keys:
        for word in element.get(key, "").split():
            if not re.fullmatch(r"[-+]?[0-9]{1,18}", word):
                what = f"its <{element.tag}> has {key} {word!r}, which is no whole number"
                raise InputError(path, what, REMEDY)
            yield max(1, abs(int(word)))


def _asked_memory(element: ET.Element) -> int:
    """Bytes that an element asks for; 0 of most."""
    asked = MEMORY.fullmatch(element.get("memory", ""))
    return int(asked[1]) << 10 * POWERS.index(asked[2] or " ") if asked else 0


def _require_plain_files(path: Path, folders: set[str], name: str) -> None:
    """Raises where a name of a file leads to something else, from whichever folder it starts."""
    for folder in folders:
        place = path.parent / folder / name
        try:
            is_there = place.exists()
        except (OSError, ValueError) as error:
            raise InputError(path, f"it names {name!r} ({error})", "give plain files") from None
        if is_there:
            require_regular(place, "give plain files", largest=LARGEST_TEXT)
