"""Edits of an XML text that leave every other byte as it is: places of elements, and replacements
at them.

Parsers that write a tree out again lose line breaks, quotes and the order that somebody chose; a
reader of `git diff` is to see the numbers that changed and nothing else.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from xml.parsers.expat import ExpatError, ParserCreate
from xml.sax.saxutils import quoteattr

from ident.errors import InputError

# Entities can make a small text large without an end; no robot's file needs any.
NO_ENTITIES = "it declares entities"


@dataclass(eq=False)
class Element:
    """An element of a text, by the bytes that it takes."""

    tag: str
    attributes: dict[str, str]
    start: int  # first byte of its start tag
    opened: int = 0  # first byte after its start tag
    closing: int = 0  # first byte of its end tag; that after the start tag where it closes itself
    end: int = 0  # first byte after it
    children: list[Element] = field(default_factory=list)

    def walk(self) -> Iterator[Element]:
        """The element and all that lies in it, in the order of the text."""
        yield self
        for child in self.children:
            yield from child.walk()

    def child(self, tag: str) -> Element | None:
        """Its first child of a tag; None if it has none."""
        for child in self.children:
            if child.tag == tag:
                return child
        return None


class EditedXml:
    """An XML text with edits that are made all at once.

    Args:
        text: The bytes of a UTF-8 file.
        where: Its name, for messages.

    Raises:
        InputError: It is no XML, or declares entities.
    """

    def __init__(self, text: bytes, where: str) -> None:
        self.text = text
        self.root = _read_elements(text, where)
        self._attributes: dict[int, tuple[Element, dict[str, str]]] = {}
        self._inserted: dict[int, tuple[Element, list[str]]] = {}
        self._replaced: dict[int, tuple[Element, str]] = {}

    def set(self, element: Element, values: Mapping[str, str]) -> None:
        """Gives an element attributes; those that it has already keep their places."""
        known = self._attributes.setdefault(element.start, (element, {}))[1]
        known.update(values)

    def insert(self, parent: Element, child: str) -> None:
        """Puts the text of a new first child into an element."""
        self._inserted.setdefault(parent.start, (parent, []))[1].append(child)

    def replace(self, element: Element, text: str) -> None:
        """Puts a text in an element's place."""
        self._replaced[element.start] = (element, text)

    def edited(self) -> bytes:
        """The text with all edits."""
        edits: list[tuple[int, int, bytes]] = []
        touched = {**self._attributes, **self._inserted}
        for start, (element, _) in touched.items():
            values = self._attributes.get(start, (element, {}))[1]
            children = self._inserted.get(start, (element, []))[1]
            edits.append((start, element.opened, self._start_tag(element, values, children)))
        for start, (element, text) in self._replaced.items():
            edits.append((start, element.end, text.encode()))
        edited = bytearray(self.text)
        for start, end, new in sorted(edits, reverse=True):
            edited[start:end] = new
        return bytes(edited)

    def _start_tag(self, element: Element, values: Mapping[str, str], children: list[str]) -> bytes:
        """An element's start tag with new values of attributes and new children behind it."""
        tag = self.text[element.start : element.opened].decode()
        closes_itself = tag.endswith("/>")
        body = tag[: -2 if closes_itself else -1]
        for name, value in values.items():
            # A value may hold what looks like another attribute; names stand after white space
            # outside of quotes.
            pattern = rf"""(?:[^\s"'=<>]+|"[^"]*"|'[^']*'|\s+(?!{re.escape(name)}\s*=)|=)*"""
            before = re.match(pattern, body[1:])
            place = 1 + (before.end() if before else 0)
            old = re.match(rf"""\s+{re.escape(name)}\s*=\s*("[^"]*"|'[^']*')""", body[place:])
            if old is None:
                body = f"{body.rstrip()} {name}={quoteattr(value)}"
                continue
            first, last = old.span(1)
            body = f"{body[: place + first]}{quoteattr(value)}{body[place + last :]}"
        if not children:
            return f"{body}{'/>' if closes_itself else '>'}".encode()
        indent = self._indent_of(element) + "  "
        lines = "".join(f"\n{indent}{child}" for child in children)
        if closes_itself:
            return f"{body.rstrip()}>{lines}\n{indent[:-2]}</{element.tag}>".encode()
        return f"{body}>{lines}".encode()

    def _indent_of(self, element: Element) -> str:
        """The white space before an element on its line."""
        line = self.text[self.text.rfind(b"\n", 0, element.start) + 1 : element.start].decode()
        return line if line.isspace() else ""


def _read_elements(text: bytes, where: str) -> Element:
    """The root element with all places."""
    parser = ParserCreate()
    parser.ordered_attributes = False
    stack: list[Element] = []
    roots: list[Element] = []

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = Element(tag, attributes, parser.CurrentByteIndex)
        element.opened = _end_of_tag(text, element.start)
        (stack[-1].children if stack else roots).append(element)
        stack.append(element)

    def finish(_: str) -> None:
        element = stack.pop()
        closes_itself = text[element.opened - 2 : element.opened] == b"/>"
        element.closing = element.opened if closes_itself else parser.CurrentByteIndex
        element.end = element.opened if closes_itself else _end_of_tag(text, element.closing)

    def refuse(*_: object) -> None:
        raise InputError(where, NO_ENTITIES, "give a file without <!ENTITY …>")

    parser.StartElementHandler = begin
    parser.EndElementHandler = finish
    parser.EntityDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except ExpatError as error:
        raise InputError(where, f"it is no XML ({error})", "give a URDF or an MJCF") from None
    return roots[0]


def _end_of_tag(text: bytes, start: int) -> int:
    """The first byte after the tag that begins at a place; `>` in quotes does not end it."""
    quote = b""
    for place in range(start, len(text)):
        letter = text[place : place + 1]
        if quote:
            quote = b"" if letter == quote else quote
        elif letter in (b'"', b"'"):
            quote = letter
        elif letter == b">":
            return place + 1
    return len(text)


def find_all(root: Element, test: Callable[[Element], bool]) -> list[Element]:
    """All elements that pass a test, in the order of the text."""
    return [element for element in root.walk() if test(element)]
