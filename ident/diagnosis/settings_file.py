"""Numbers of a diagnosis in a TOML file: read where they are used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar

from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.errors import InputError
from ident.safe_read import read_toml
from ident.settings import Settings

S = TypeVar("S", bound=Settings)

# Says where the numbers are from; a diagnosis doesn't need it.
ORIGIN = "calibration"


def read_settings(path: Path) -> DiagnosisSettings:
    """The usual numbers with those of a file in their place.

    Raises:
        InputError: No such file, no TOML, or a name or value that no setting has.
    """
    record = read_toml(path, "give a TOML file of settings")
    return change_settings(USUAL, {name: value for name, value in record.items() if name != ORIGIN}, path)


def change_settings(settings: S, values: Mapping[str, Any], where: str | Path, group: str = "") -> S:
    """The same with some numbers changed, group by group.

    Args:
        settings: The numbers.
        values: Name and value, or name of a group and its mapping.
        where: The file that they are from.
        group: The group's own name.

    Raises:
        InputError: No such name, or no such number.
    """
    known, found = {one.name: getattr(settings, one.name) for one in fields(settings)}, {}
    for name, value in values.items():
        place = f"{group}.{name}" if group else name
        if name not in known:
            raise InputError(where, f"there is no setting {place}", f"known here: {', '.join(known)}")
        old = known[name]
        if isinstance(old, Settings):
            if not isinstance(value, Mapping):
                raise InputError(where, f"{place} is a group of numbers, not one", f"write a table [{place}]")
            found[name] = change_settings(old, value, where, place)
        else:
            found[name] = _like(old, value, where, place)
    return replace(settings, **found)


def _like(old: Any, value: Any, where: str | Path, place: str) -> Any:
    """A value of the kind of the one whose place it takes."""
    many = isinstance(old, tuple)
    given = value if many and isinstance(value, list) else [value]
    whole = all(isinstance(one, int) and not isinstance(one, bool) for one in given)
    real = all(isinstance(one, int | float) and not isinstance(one, bool) and math.isfinite(one) for one in given)
    if not real or many != isinstance(value, list) or (isinstance(old, int) and not whole):
        raise InputError(where, f"{place} is {value!r}", f"give something like {old}")
    return tuple(map(float, given)) if many else given[0]
