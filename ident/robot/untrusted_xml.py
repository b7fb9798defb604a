"""XML of robots and scenes from anywhere, looked at before anything walks down it."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from ident.errors import InputError

# Elements of a robot nest four or five levels deep; far fewer than this where readers of robots overflow.
DEEPEST = 64


def require_no_entities(text: str, where: str | Path, remedy: str, error: type[InputError]) -> None:
    """Raises for an XML text that defines entities: they read other files or grow without end."""
    if "<!ENTITY" in text:
        raise error(where, "it defines entities, which no robot needs", remedy)


def read_xml(text: str, where: str | Path, remedy: str, error: type[InputError]) -> ET.Element:
    """The root element of an XML text.

    Raises:
        InputError: Not XML, with entities of its own, or nested deeper than readers of robots can follow.
    """
    require_no_entities(text, where, remedy, error)
    try:
        root = ET.fromstring(text)
    except ET.ParseError as failed:
        raise error(where, f"not XML ({failed})", remedy) from None
    level, depth = [root], 0
    while level:
        level, depth = [child for element in level for child in element], depth + 1
        if depth > DEEPEST:
            raise error(where, f"its elements nest more than {DEEPEST} levels deep", remedy)
    return root
