"""Numbers that decide: each with its unit, its meaning and where it comes from, in one small group a stage.

A number is a `law` (a convention of statistics or plain arithmetic), `chosen` (a size below which nothing matters in
practice, or a limit on work), or `calibrated` on development sets of simulated arms or on recordings of real ones.
"""

from __future__ import annotations

import sys
import tomllib
from dataclasses import dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import Any

from ident.records import Record


def number(
    default: float | str | tuple[float, ...] | None = None, unit: str = "", meaning: str = "", source: str = ""
) -> Any:
    """A field of `Settings` that says what it is; without arguments a row of its class's table says it."""
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True)
class Settings(Record):
    """Base of a stage's numbers, and of groups of such stages.

    A class that names a `table` has its numbers there, in the `settings.toml` beside its module.
    """

    def __init_subclass__(cls, table: str = "") -> None:
        if table:
            for name, one in _numbers(sys.modules[cls.__module__].__file__ or "", table).items():
                setattr(cls, name, one)

    def describe(self) -> list[dict[str, Any]]:
        """Every number's name (its groups before it, parted by dots), value, unit, meaning and source."""
        found: list[dict[str, Any]] = []
        for one in fields(self):
            value = getattr(self, one.name)
            if isinstance(value, Settings):
                found += [{**each, "name": f"{one.name}.{each['name']}"} for each in value.describe()]
            else:
                found.append({"name": one.name, "value": value, **one.metadata})
        return found


def read_group(module: str, table: str) -> Any:
    """A table of the `settings.toml` beside a module as `Settings` without a class: an attribute a number."""
    given = [(name, Any, one) for name, one in _numbers(module, table).items()]
    return make_dataclass(table, given, bases=(Settings,), frozen=True)()


def _numbers(module: str, table: str) -> dict[str, Any]:
    """A field for each row of a table of the `settings.toml` beside a module."""
    rows = tomllib.loads(Path(module).with_name("settings.toml").read_text(encoding="utf-8"))[table]
    values = {name: row.pop("value") for name, row in rows.items()}
    return {name: number(tuple(one) if isinstance(one, list) else one, **rows[name]) for name, one in values.items()}
