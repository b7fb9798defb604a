"""JSON Schemas of the result files.

Their records stand in tables, those that are values in memory as well in classes.

`records.toml` of each package has a table for each record: its keys with their Python types, as
pydantic reads them.
"""

from __future__ import annotations

import tomllib
from functools import cache
from importlib import import_module
from importlib.resources import files
from typing import Any, Literal, NotRequired

from pydantic import ConfigDict, TypeAdapter
from typing_extensions import TypedDict

from ident.errors import InputError

DIALECT = "https://json-schema.org/draft/2020-12/schema"
TYPING = {"Any": Any, "Literal": Literal, "NotRequired": NotRequired}


@cache
def read_records(package: str) -> dict[str, Any]:
    """All records of a package by their names, with what their types are made of."""
    tables = tomllib.loads(
        files(f"{package}.schemas").joinpath("records.toml").read_text(encoding="utf-8")
    )
    homes = tables.pop("classes")
    schema: dict[str, Any] = {
        **TYPING,
        **{name: getattr(import_module(home), name) for name, home in homes.items()},
    }
    for name, keys in tables.items():
        rows = _rows(name, tables).items()
        types = {
            key.removesuffix("?"): f"NotRequired[{kind}]" if key.endswith("?") else kind
            for key, kind in rows
        }
        schema[name] = TypedDict(name, types)  # type: ignore[operator]
        schema[name].__doc__ = keys.get("about")
    return schema


def _rows(name: str, tables: dict[str, dict[str, str]]) -> dict[str, str]:
    """A record's keys, those of its base first."""
    rows: dict[str, str] = {}
    for key, kind in tables[name].items():
        if key == "base":
            rows = {**_rows(kind, tables), **rows}
        elif key != "about":
            rows[key] = kind
    return rows


@cache
def list_kinds(package: str) -> dict[str, str]:
    """Kind of each result file -> the name of its record.

    Those that say which `schema` they hold to.
    """
    kinds = {}
    for name, record in sorted(read_records(package).items()):
        rows = getattr(record, "__annotations__", {})
        if "schema" in rows:
            mark = str(getattr(rows["schema"], "__forward_arg__", ""))
            _, _, kind = mark.partition(".")
            kinds[kind.partition("/")[0]] = name
    return kinds


def make_schema(name: str, package: str = "ident") -> dict[str, Any]:
    """JSON Schema of a result file; keys that it does not name may be there too.

    Args:
        name: Name of the file's kind: `diagnosis`, or `ident.diagnosis/1` as the file itself says.
        package: Whose file.

    Raises:
        InputError: No such kind.
    """
    kinds = list_kinds(package)
    short = (name.rpartition("/")[0] or name).rpartition(".")[2]
    if short not in kinds:
        what = f"there is no result file {name!r}"
        raise InputError(f"{package} schema", what, f"give one of: {', '.join(sorted(kinds))}")
    record: Any = kinds[short]
    adapter: TypeAdapter[Any] = TypeAdapter(record, config=ConfigDict(defer_build=True))
    adapter.rebuild(_types_namespace=read_records(package))
    return {"$schema": DIALECT, **adapter.json_schema(mode="serialization")}
