"""Holds a result file to the schema that is published for it."""

import json
from functools import cache
from pathlib import Path
from typing import Any

from jsonschema import Draft202012Validator

from ident.schemas.publish import make_schema


@cache
def _validator(name: str) -> Draft202012Validator:
    package, short = name.rpartition("/")[0].split(".")
    schema = make_schema(short, package)
    Draft202012Validator.check_schema(schema)
    return Draft202012Validator(schema)


def check_record(record: dict[str, Any]) -> dict[str, Any]:
    """Passes a record that holds to its schema, after a round through strict JSON; returns that."""
    record = json.loads(json.dumps(record, allow_nan=False))
    faults = [f"{fault.json_path}: {fault.message[:200]}" for fault in _validator(record["schema"]).iter_errors(record)]
    assert not faults, faults
    return record


def check_file(path: str | Path) -> dict[str, Any]:
    """The same of a file."""
    record: dict[str, Any] = json.loads(Path(path).read_text(encoding="utf-8"))
    return check_record(record)
