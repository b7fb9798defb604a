"""Files of the commands of daily work: `ident new` with --json."""

from __future__ import annotations

from typing import Any, Literal

from typing_extensions import TypedDict

from ident.schemas.common import IssueRecord, ProvenanceRecord


class ReasonRecord(TypedDict):
    """Why something was guessed."""

    what: str
    guess: str
    evidence: str


class NewSessionRecord(TypedDict):
    """A session.toml that was guessed: columns by their native names, other keys, and the evidence."""

    schema: Literal["ident.new/1"]
    file: str
    columns: dict[str, str]
    settings: dict[str, Any]
    reasons: list[ReasonRecord]
    left_out: list[str]
    telemetry: list[IssueRecord]
    provenance: ProvenanceRecord
