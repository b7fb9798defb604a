"""Files of `ident inspect`, `fit`, `evaluate`, `view` and `demo` with --json."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.schemas.common import IssueRecord, ProvenanceRecord
from ident.schemas.diagnosis import DiagnosisRecord

# Rung -> joint (and `total`) -> figure; null where a joint never moves, spreads of a single run too.
LadderTable = dict[str, dict[str, float | None]]


class JointEffortRecord(TypedDict):
    """What one joint's effort is."""

    joint: str
    kind: str
    evidence: str


class InspectedRecord(TypedDict):
    """The telemetry check of one session."""

    session: str
    runs: int
    samples: int
    duration_s: float
    robot: str | None
    joints: list[str]
    common_clock: bool
    fit: bool
    effort: list[JointEffortRecord]
    telemetry: list[IssueRecord]


class TelemetryRecord(TypedDict):
    """The telemetry checks of all sessions."""

    schema: Literal["ident.telemetry/1"]
    sessions: list[InspectedRecord]
    provenance: ProvenanceRecord


class ModelRobotRecord(TypedDict):
    """The robot of a model."""

    name: str
    source: str
    joints: list[str]
    links: int
    urdf_sha256: str


class ModelInertiaRecord(TypedDict):
    """Inertial numbers of each link, in the order that is told."""

    mode: str
    order: str
    links: dict[str, list[float]]


class NamedLawRecord(TypedDict):
    """A law of one joint, numbered from zero, that a diagnosis named; coefficients as value, low and high."""

    effect: str
    joint: int
    shape: dict[str, float]
    coefficients: list[list[float]]


class FitRecord(TypedDict):
    """A fitted model; its provenance holds options, files and versions too."""

    schema: Literal["ident.fit/1"]
    robot: ModelRobotRecord
    inertia: ModelInertiaRecord
    loss: dict[str, Any]
    net: dict[str, Any]
    trained: NotRequired[dict[str, Any]]
    coupling: NotRequired[dict[str, Any]]
    named: NotRequired[list[NamedLawRecord]]
    provenance: ProvenanceRecord


class LadderSpreadRecord(TypedDict):
    """Mean and standard deviation over the runs."""

    mean: LadderTable
    std: LadderTable
    std_missing: NotRequired[str]


class SessionScoreRecord(TypedDict):
    """Scores of one group of runs, rung by rung."""

    session: str
    runs: int
    payload_kg: float
    energy_error_J: LadderSpreadRecord
    torque_rmse_Nm: LadderSpreadRecord
    torque_rmse_at_rest_Nm: LadderTable
    r2_moving: LadderTable


class EvaluationRecord(TypedDict):
    """Scores of one model."""

    schema: Literal["ident.evaluation/1"]
    model: str
    robot: str
    joints: list[str]
    sessions: list[SessionScoreRecord]
    pooled: SessionScoreRecord
    provenance: ProvenanceRecord


class EvaluationsRecord(TypedDict):
    """Scores of several models on the same recordings."""

    schema: Literal["ident.evaluations/1"]
    robot: str
    joints: list[str]
    models: list[EvaluationRecord]
    provenance: ProvenanceRecord


class ViewRecord(TypedDict):
    """Runs that a timeline shows."""

    schema: Literal["ident.view/1"]
    robot: str
    joints: list[str]
    runs: list[str]
    provenance: ProvenanceRecord


class DemoRecord(TypedDict):
    """The main job on the shipped recordings."""

    schema: Literal["ident.demo/1"]
    robot: str
    joints: list[str]
    models: list[EvaluationRecord]
    diagnoses: list[DiagnosisRecord]
    provenance: ProvenanceRecord
    files: NotRequired[list[str]]
