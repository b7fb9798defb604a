"""What a key of a scene file means and may hold."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class SceneKey:
    """A key of a scene file."""

    says: str  # its meaning, for people
    # What it holds: one number or several, degrees that become radians (`angle`; `angles`, `rows`
    # of them, one a joint; of joints that slide metres), one number for three (`scale`), a unit
    # vector (`direction`), a rotation matrix (`turn`, `quaternion`), `text`, a `flag`, a `whole`
    # number; what is `any` is looked at by whoever reads it.
    kind: str = "any"
    default: Any = None  # its value where it is left out; None for none
    needed: bool = False  # whether it may not be left out
    least: float = 0.0  # of a number the least, or, if `above`, what it has to lie above
    above: bool = False
    most: float = math.inf  # the largest that a number, or the modulus of any of several, may be
    count: int | str | None = None  # how many numbers; `joints` for as many as joints move
    positive: bool = False  # whether all of several numbers have to lie above zero
    without: tuple[str, ...] = ()  # keys that may not stand beside it


Keys = Mapping[str, SceneKey]
"""Keys of a table, by name."""


def read_keys(path: Path) -> dict[str, Keys]:
    """All tables of the file that lists the keys, by name."""
    text = path.read_text(encoding="utf-8")
    tables: dict[str, Keys] = {}
    for table, rows in tomllib.loads(text).items():
        keys = {}
        for name, row in rows.items():
            without = tuple(row.get("without", ()))
            keys[name] = SceneKey(**row | {"without": without})
        tables[table] = keys
    return tables
