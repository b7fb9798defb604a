"""What the result files hold: one class is the value in memory, its JSON and, by `ident schema`, its JSON Schema."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar


@dataclass(frozen=True)
class Record:
    """Base of values whose fields are the keys of their JSON; schemas require all of them."""

    __pydantic_config__: ClassVar = {"json_schema_serialization_defaults_required": True}

    def to_dict(self) -> dict[str, Any]:
        """The record, of what JSON knows alone."""
        return {one.name: as_record(getattr(self, one.name)) for one in fields(self)}


def as_record(value: Any) -> Any:
    """A value as JSON knows it: records by their keys, lists, tables, and a text of anything else."""
    if isinstance(value, Record):
        return value.to_dict()
    if isinstance(value, Mapping):
        return {str(name): as_record(one) for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [as_record(one) for one in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
