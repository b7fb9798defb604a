"""XML of robots, looked at before it is read: no entities, nothing that nests without end."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from contextlib import suppress
from pathlib import Path

from ident.errors import InputError
from ident.safe_read import DEEPEST

# Prefixes of elements' and attributes' names, and the first element.
PREFIX = re.compile(r'<(\w[\w.-]*+):\w|\s(\w[\w.-]*+):[\w.-]++\s*+=\s*+["\']')
ROOT_TAG = re.compile(r"<[A-Za-z_][^\s/>]*+")


def require_no_entities(text: str, where: str | Path, remedy: str, error: type[InputError]) -> None:
    """Raises for an XML text that defines entities: they read other files or grow without end."""
    if "<!ENTITY" in text:
        raise error(where, "it defines entities, which no robot needs", remedy)


def read_xml(text: str, where: str | Path, remedy: str, error: type[InputError]) -> ET.Element:
    """The root element of an XML text.

    Raises:
        InputError: Not XML, with entities of its own, or nested deeper than readers of robots can
            follow.
    """
    require_no_entities(text, where, remedy, error)
    try:
        root = ET.fromstring(declare_prefixes(text))
    except ET.ParseError as failed:
        raise error(where, f"not XML ({failed})", remedy) from None
    level = [root]
    for _ in range(DEEPEST):
        level = [child for element in level for child in element]
    if level:
        raise error(where, f"its elements nest more than {DEEPEST} levels deep", remedy)
    return root


def declare_prefixes(text: str) -> str:
    """The text, with prefixes of names (`drake:acceleration`) that it uses and declares nowhere
    declared at its root.

    Robots' own parsers know nothing of namespaces, so that public URDFs lack the declarations.
    """
    used = dict.fromkeys(name for pair in PREFIX.findall(text) for name in pair if name)
    missing = [name for name in used if f"xmlns:{name}" not in text and name[:3] != "xml"]
    for name in missing:
        with suppress(ValueError):  # a name that Python's writer keeps for itself
            ET.register_namespace(name, name)  # by which it is written again
    declared = "".join(f' xmlns:{name}="{name}"' for name in missing)
    return ROOT_TAG.sub(lambda root: root.group() + declared, text, count=1) if missing else text
