"""Files of `ident patch`, `export`, `verify`, `simulate` and `blind` with --json."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.schemas.diagnosis import ArmRecord, IntervalRecord, OriginRecord


class PatchedEffectRecord(TypedDict):
    """A named effect, and how each format expresses it."""

    effect: str
    joints: list[str]
    parameters: dict[str, IntervalRecord]
    formats: dict[str, dict[str, Any]]


class PatchRecord(ArmRecord):
    """What a patch holds, and how near it comes."""

    schema: Literal["ident.patch/1"]
    diagnosis: str
    verdict: str
    baseline: str
    files: list[str]
    effects: list[PatchedEffectRecord]
    told: list[str]
    structure: dict[str, dict[str, Any]]
    heldout: NotRequired[dict[str, Any]]
    written: NotRequired[dict[str, str]]
    merged: NotRequired[dict[str, Any]]


class ExportRecord(ArmRecord):
    """Files of an identified arm, and how near each comes when it is loaded back."""

    schema: Literal["ident.export/1"]
    files: list[str]
    changed_links: list[str]
    left_out: list[str]
    loaded_back: dict[str, dict[str, Any]]
    merged: NotRequired[dict[str, Any]]
    torque_rmse_Nm: NotRequired[dict[str, dict[str, float]]]
    heldout: NotRequired[dict[str, Any]]
    written: NotRequired[dict[str, str]]


class CheckRecord(TypedDict):
    """A limit, the figure of one session, and whether it keeps it."""

    session: str
    figure: str
    joint: str
    bound: float
    value: float | None
    passed: bool


class VerificationRecord(ArmRecord):
    """A model against limits."""

    schema: Literal["ident.verification/1"]
    model: str
    passed: bool
    in_sample: bool
    checks: list[CheckRecord]


class SimulatedRecord(TypedDict):
    """A session that was written."""

    folder: str
    runs: int
    samples: int
    duration_s: float
    robot: str
    joints: list[str]
    sha256: str
    key: str


class SimulationRecord(ArmRecord):
    """Sessions of the simulated arm."""

    schema: Literal["ident.simulation/1"]
    sessions: list[SimulatedRecord]


class BlindOutcomeRecord(TypedDict):
    """One case; further keys tell how it was scored."""

    name: str
    kind: str
    robot: str
    joints: list[str]
    verdict: str


class BlindRecord(OriginRecord):
    """The check on withheld effects."""

    schema: Literal["ident.blind/1"]
    robot: str
    cases: int
    seed: int
    failed: int
    seals: dict[str, str]
    scores: dict[str, Any]
    intervals: dict[str, list[float | None]]
    counts: dict[str, int]
    strata: dict[str, dict[str, dict[str, float | int | None]]]
    confusion: dict[str, dict[str, int]]
    calibration: list[dict[str, Any]]
    coverage: dict[str, dict[str, float | int | None]]
    baselines: dict[str, dict[str, float | None]]
    worlds: dict[str, list[dict[str, Any]]]
    worst_stratum: dict[str, Any] | None
    efficiency: dict[str, dict[str, float | int | None]]
    reliability: dict[str, dict[str, float | int | None]]
    edits: NotRequired[dict[str, dict[str, Any]]]
    confidently_wrong: list[str]
    seconds_per_case: float | None
    outcomes: list[BlindOutcomeRecord]
    run: dict[str, Any]
