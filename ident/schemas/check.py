"""Whether a record that was read is what its table in `records.toml` says.

A stranger's file is looked through once, by the rows that its JSON Schema is made of; what reads it
then needs no checks of its own.
"""

from __future__ import annotations

import ast
import math
import tomllib
from functools import cache
from importlib.resources import files
from pathlib import Path

from ident.errors import InputError, shortened

PLAIN: dict[str, tuple[type, ...]]
PLAIN = {"str": (str,), "bool": (bool,), "int": (int,), "float": (int, float)}
"""Types of JSON's plain values by their names; a truth value is no number."""
ANY = "Any"
Tables = dict[str, dict[str, str]]


def require_record(record: object, name: str, where: str | Path, remedy: str) -> None:
    """Passes if a record has all keys of its table, with values of their types.

    Further keys may be there.

    Args:
        record: As JSON was read.
        name: Of its table in `records.toml`, whose base and parts are values in memory nowhere.
        where: Its file.
        remedy: What the user can do.

    Raises:
        InputError: A key is missing, or has a value of another type, with its place in the file.
    """
    fault = _fault_of_record(record, name, "")
    if fault:
        raise InputError(where, fault, remedy)


@cache
def _tables() -> Tables:
    text = files("ident.schemas").joinpath("records.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@cache
def _type_of(text: str) -> ast.expr:
    return ast.parse(text, mode="eval").body


def _fault_of_record(record: object, name: str, place: str) -> str:
    """What is wrong with a record; empty where nothing is."""
    if not isinstance(record, dict):
        return f"{place or 'it'} is {_shown(record)}, no table"
    rows = dict(_tables()[name])
    while "base" in rows:
        rows = {**_tables()[rows.pop("base")], **rows}
    for row, kind in rows.items():
        key = row.removesuffix("?")
        if row == "about" or (key != row and key not in record):
            continue
        inner = f"{place}.{key}" if place else key
        if key not in record:
            return f"it lacks {inner}"
        fault = _fault(record[key], _type_of(kind), inner)
        if fault:
            return fault
    return ""


def _fault(value: object, kind: ast.expr, place: str) -> str:
    """What is wrong with a value of a type; empty where nothing is."""
    if isinstance(kind, ast.Name) and kind.id in _tables():
        return _fault_of_record(value, kind.id, place)
    if isinstance(kind, ast.BinOp):
        faults = [_fault(value, side, place) for side in (kind.left, kind.right)]
        return "" if "" in faults else faults[0]
    if isinstance(kind, ast.Subscript) and ast.unparse(kind.value) in ("list", "dict"):
        return _fault_of_parts(value, kind, place)
    if _is_plain(value, kind):
        return ""
    return f"{place} is {_shown(value)}, not {ast.unparse(kind)}"


def _fault_of_parts(value: object, kind: ast.Subscript, place: str) -> str:
    """What is wrong with a list or a table of values; empty where nothing is."""
    inner = kind.slice
    parts: dict[object, object]
    if isinstance(inner, ast.Tuple) and isinstance(value, dict):
        parts = value
        inner = inner.elts[1]
    elif isinstance(value, list) and not isinstance(inner, ast.Tuple):
        parts = dict(enumerate(value, start=1))
    else:
        return f"{place} is {_shown(value)}, not {ast.unparse(kind)}"
    for key, entry in parts.items():
        fault = _fault(entry, inner, f"{place}.{key}")
        if fault:
            return fault
    return ""


def _is_plain(value: object, kind: ast.expr) -> bool:
    """Whether a value is null, a text, a number or a truth value of a type, or one of a few."""
    if isinstance(kind, ast.Constant):
        return value is kind.value
    if isinstance(kind, ast.Subscript):  # Literal
        choices = ast.literal_eval(kind.slice)
        return value in (choices if isinstance(choices, tuple) else (choices,))
    name = ast.unparse(kind)
    if name == ANY:
        return True
    if isinstance(value, bool) and name != "bool":
        return False
    is_one = isinstance(value, PLAIN[name])
    return is_one and (not isinstance(value, float) or math.isfinite(value))


def _shown(value: object) -> str:
    return shortened(repr(value))
