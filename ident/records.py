"""What the result files hold: one class is the value in memory, its JSON and, by `ident schema`,
its JSON Schema.

And numbers that decide: each with its unit, its meaning and where it comes from, in one small group
a stage. A number is a `law` (a convention of statistics or plain arithmetic), `chosen` (a size
below which nothing matters in practice, or a limit on work), or `calibrated` on development sets of
simulated arms or on recordings of real ones.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Self, TypeVar

Value = TypeVar("Value")
# A table as JSON has it, by its keys: texts, numbers, lists and further tables;
# one that is made, and one that is only read.
JsonRecord = dict[str, Any]
JsonTable = Mapping[str, Any]


@dataclass(frozen=True)
class Record:
    """Base of values whose fields are the keys of their JSON; schemas require all of them."""

    __pydantic_config__: ClassVar = {"json_schema_serialization_defaults_required": True}

    def to_dict(self) -> dict[str, Any]:
        """The record by its fields' names, each as `as_record` gives it."""
        return {
            record_field.name: as_record(getattr(self, record_field.name))
            for record_field in fields(self)
        }


def as_record(value: Any) -> Any:
    """A value as JSON knows it: records by their keys, lists, tables; a text of anything else."""
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(name): as_record(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [as_record(item) for item in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def as_json(record: Any, indent: int | None = 1) -> str:
    """A record as JSON allows it, without a line end: what is no finite number is null."""
    return json.dumps(_strict(record), indent=indent, allow_nan=False)


def _strict(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _strict(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_strict(entry) for entry in value]
    if value is None or isinstance(value, int | str):
        return value
    figure = float(value)  # of NumPy's kinds as well
    return figure if math.isfinite(figure) else None


def number(default: Value, unit: str, meaning: str, source: str) -> Value:
    """A field of `Numbers` that says what it is.

    Args:
        default: Its usual value.
        unit: Its unit; "1" for a ratio or a count.
        meaning: What it decides.
        source: `law`, `chosen` or `calibrated`, a colon, and how or why.
    """
    return field(default=default, metadata={"unit": unit, "meaning": meaning, "source": source})


@dataclass(frozen=True)
class Numbers(Record):
    """Base of a stage's numbers, and of groups of such stages: a field each, by `number`."""

    def but(self, **numbers: Any) -> Self:
        """A copy with some numbers changed, given by their names."""
        return replace(self, **numbers)

    def describe(self) -> list[dict[str, Any]]:
        """Every number as a row, those of groups included.

        Returns:
            Rows of "name" (its groups before it, parted by dots), "value", "unit", "meaning" and
            "source".
        """
        rows: list[dict[str, Any]] = []
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, Numbers):
                of_group = value.describe()
                rows += [{**row, "name": f"{entry.name}.{row['name']}"} for row in of_group]
            else:
                rows.append({"name": entry.name, "value": value, **entry.metadata})
        return rows
