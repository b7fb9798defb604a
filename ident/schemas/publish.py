"""JSON Schemas of the result files, made from their typed records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import TypeAdapter

from ident.errors import InputError
from ident.schemas.diagnosis import ArmComparisonRecord, DiagnosisRecord
from ident.schemas.records import (
    CloseRecord,
    DemoRecord,
    EvaluationRecord,
    EvaluationsRecord,
    FitRecord,
    NewSessionRecord,
    RangesRecord,
    ServoRecord,
    TelemetryRecord,
    ViewRecord,
    WatchRecord,
)
from ident.schemas.simulators import BlindRecord, ExportRecord, PatchRecord, SimulationRecord, VerificationRecord

DIALECT = "https://json-schema.org/draft/2020-12/schema"
RECORDS: dict[str, Any] = {
    "blind": BlindRecord,
    "close": CloseRecord,
    "comparison": ArmComparisonRecord,
    "demo": DemoRecord,
    "diagnosis": DiagnosisRecord,
    "evaluation": EvaluationRecord,
    "evaluations": EvaluationsRecord,
    "export": ExportRecord,
    "fit": FitRecord,
    "new": NewSessionRecord,
    "patch": PatchRecord,
    "ranges": RangesRecord,
    "servo": ServoRecord,
    "simulation": SimulationRecord,
    "telemetry": TelemetryRecord,
    "verification": VerificationRecord,
    "view": ViewRecord,
    "watch": WatchRecord,
}


def make_schema(name: str, records: Mapping[str, Any] = RECORDS, command: str = "ident schema") -> dict[str, Any]:
    """JSON Schema of a result file; keys that it does not name may be there too.

    Args:
        name: Name of the file's kind: `diagnosis`, or `ident.diagnosis/1` as the file itself says.
        records: Kinds and their records.
        command: Which command asks, for messages.

    Raises:
        InputError: No such kind.
    """
    short = name.rpartition("/")[0] or name
    short = short.rpartition(".")[2]
    if short not in records:
        raise InputError(command, f"there is no result file {name!r}", f"give one of: {', '.join(sorted(records))}")
    return {"$schema": DIALECT, **TypeAdapter(records[short]).json_schema(mode="serialization")}
