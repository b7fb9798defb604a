"""Records that several result files share."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

ByJoint = dict[str, float]


class SessionStampRecord(TypedDict):
    """A session that a result was made from: its path, its hash, its first and last time [s], its files' hashes."""

    path: str
    sha256: str
    first: float | None
    last: float | None
    runs: NotRequired[list[str]]


class ProvenanceRecord(TypedDict):
    """Where a result comes from."""

    command: str
    version: str
    settings: dict[str, Any]
    sessions: list[SessionStampRecord]


class IssueRecord(TypedDict):
    """What the telemetry check found."""

    issue: str
    joints: list[str]
    severity: str
    evidence: str
    remedy: str


class IntervalRecord(TypedDict):
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float
    open: NotRequired[Literal["low", "high", "both"]]


class MeanStdRecord(TypedDict):
    """Mean and standard deviation over the runs; a single run has none, and the record says so."""

    mean: float
    std: NotRequired[float | None]
    std_missing: NotRequired[str]
