"""What is written into a user's own file, and what formats share: joints' names, digits."""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.export.identified import IdentifiedArm
from ident.export.xml_places import Element
from ident.files import atomic_write
from ident.laws.acting import payload_parameters
from ident.model.link_inertia import is_stated

# Significant digits that are written into a user's own file.
DIGITS = 7
OTHER_LINKS = "links are left as they are: {}"


@dataclass
class WrittenInto:
    """What was written into a file, and what was not."""

    path: Path
    form: str  # urdf or mjcf
    tip: str = ""  # the arm's last joint, where its robot has several arms
    joints: dict[str, dict[str, float]] = field(default_factory=dict)  # by its name in the file
    links: list[str] = field(default_factory=list)  # that were changed, by their names in the file
    left: list[str] = field(default_factory=list)  # what was not written, and why

    def to_dict(self) -> dict[str, Any]:
        """Its record: "file", "format", "joints", "links", "left" (what was not written)."""
        return {
            "file": str(self.path),
            "format": self.form,
            "joints": self.joints,
            "links": self.links,
            "left": self.left,
        }


class _Tried(Exception):
    """Ends the lending of a file that is not to be kept."""


@contextmanager
def lend_beside(path: Path, text: bytes) -> Iterator[Path]:
    """Lends a file of a text beside a user's own, where meshes are found; nothing of it stays.

    Raises:
        InputError: Nothing can be written there.
    """
    with suppress(_Tried), atomic_write(path) as temporary:
        temporary.write_bytes(text)
        yield temporary
        raise _Tried


def match_joints(wanted: Sequence[str], there: Sequence[str], where: Path) -> dict[str, str]:
    """The name in the file of each joint of the arm: its own, or the only one that ends in it or in
    which it ends.

    Raises:
        InputError: A joint has none, or several.
    """
    matched = {}
    for joint in wanted:
        names = [name for name in there if name == joint]
        names = names or [name for name in there if _ends_alike(name, joint)]
        if len(names) != 1:
            near = difflib.get_close_matches(joint, there, 3, 0.0)
            what = f"it has no joint {joint!r}"
            if names:
                what = f"{', '.join(names)} may each be {joint!r}"
            elif near:
                what += f", only {', '.join(near)}"
            remedy = "name the joints as the URDF does; <include> is not followed"
            raise InputError(where, what, remedy)
        matched[joint] = names[0]
    several = [name for name, count in Counter(matched.values()).items() if count > 1]
    if several:
        what = f"{several[0]!r} would be two joints of the arm"
        raise InputError(where, what, "name the joints as the URDF does")
    return matched


def _ends_alike(first: str, second: str) -> bool:
    return bool(first and second) and (first.endswith(second) or second.endswith(first))


def as_digits(values: Sequence[float] | Array) -> str:
    """Numbers to as many digits as any recording knows them, for who reads what changed."""
    return " ".join(f"{float(value):.{DIGITS}g}" for value in values)


def new_digits(
    element: Element | None, numbers: Mapping[str, Sequence[float] | Array]
) -> dict[str, str]:
    """Numbers of an element as text; those that it states already are left out."""
    there = {} if element is None else element.attributes
    return {
        key: as_digits(values)
        for key, values in numbers.items()
        if not is_stated(there.get(key), values)
    }


def link_changes(identified: IdentifiedArm) -> Float[Array, "n 10"]:
    """Change of every link against the URDF, a named payload on the last one."""
    changes = np.array(identified.links.total)
    for change in identified.changes:
        if change.effect == "payload":
            changes[-1] += payload_parameters(change.values)
    return changes


def by_name(elements: Sequence[Element], tag: str) -> dict[str, Element]:
    """Elements of a tag by their names."""
    return {each.attributes.get("name", ""): each for each in elements if each.tag == tag}
