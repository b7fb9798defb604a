"""`ident.diagnosis/1` and `ident.comparison/1`, with the records that other files share."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.recordings.recording import TelemetryIssue
from ident.results import Provenance

ByJoint = dict[str, float]


class OriginRecord(TypedDict):
    """Base of every file: where it comes from."""

    provenance: Provenance


class ArmRecord(OriginRecord):
    """Base of files about one arm."""

    robot: str
    joints: list[str]


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


Verdict = Literal["no_gap", "named", "partial", "none_of_catalogue", "not_testable", "refused"]
AxisName = Literal["speed", "direction", "load", "position", "reversal", "frequency", "time", "temperature", "pose"]


class AmountRecord(TypedDict):
    """How much was recorded."""

    runs: int
    samples: int
    duration_s: float


class JointGapRecord(TypedDict):
    """What is left at a joint, what is noise, and what could still be explained [N m]."""

    rms_Nm: float
    noise_floor_Nm: float
    ceiling_rms_Nm: float | None
    energy_error_J: MeanStdRecord
    fixed_rms_Nm: NotRequired[float]
    unexplained: NotRequired[str | None]
    tuned_away_Nm: NotRequired[float]


class PlaceRecord(TypedDict):
    """A cell of the map of the gap."""

    joint: str
    axis: AxisName
    low: float
    high: float
    share_of_gap: float
    p_value: float
    share_of_time: NotRequired[float]
    energy_J: NotRequired[float | None]
    beyond_noise_Nm: NotRequired[float | None]


class FindingHeldoutRecord(TypedDict):
    """What a name closes on runs that the fit never saw."""

    rms_before_Nm: ByJoint
    rms_after_Nm: ByJoint
    energy_error_before_J: Any
    energy_error_after_J: Any
    shrink: float | None
    share: NotRequired[float]
    energy_error_before_std_J: NotRequired[float | None]
    energy_error_after_std_J: NotRequired[float | None]
    energy_error_std_missing: NotRequired[str]
    gain_rms_Nm: NotRequired[float]


# `class` is a word of Python's own, so this record is written as a call.
FindingRecord = TypedDict(
    "FindingRecord",
    {
        "effect": str,
        "joints": list[str],
        "probability": float,
        "class": list[str],
        "class_probability": float,
        "class_shares": dict[str, float],
        "rivals": NotRequired[dict[str, float]],
        "parameters": dict[str, IntervalRecord],
        "heldout": FindingHeldoutRecord,
        "evidence": NotRequired[dict[str, Any]],
        "action": NotRequired[str],
    },
)


class HeldoutRecord(TypedDict, total=False):
    """All names together, before and after; empty where nothing was fitted."""

    rms_before_Nm: ByJoint
    rms_after_Nm: ByJoint
    shrink: float | None
    without_names_rms_Nm: ByJoint
    energy_error_before_J: ByJoint
    energy_error_after_J: ByJoint
    energy_error_before_std_J: ByJoint | None
    energy_error_after_std_J: ByJoint | None
    energy_error_std_missing: str
    forward: Any


class NotTestableRecord(TypedDict):
    """An effect that these recordings can't show, and why."""

    effect: str
    joints: list[str]
    reason: str


class DetectableRecord(TypedDict):
    """How small an effect at a joint would still have been named, nine times in ten."""

    effect: str
    joints: list[str]
    figure: str
    limit: float | None
    named: Literal["above", "below"]
    hidden: bool
    bound_by: Literal["encoder", "torque", "tolerance", "size"]


class NextExperimentRecord(TypedDict):
    """What to record next."""

    separates: list[str]
    motion: str
    minutes: float


class DiagnosisRecord(ArmRecord):
    """Where the gap lies, which effect causes it, how far it shrinks; or why that can't be told."""

    schema: Literal["ident.diagnosis/1"]
    session: AmountRecord
    telemetry: list[TelemetryIssue]
    verdict: Verdict
    gap: dict[str, JointGapRecord]
    where: list[PlaceRecord]
    findings: list[FindingRecord]
    heldout: HeldoutRecord
    not_testable: list[NotTestableRecord]
    next_experiment: NextExperimentRecord | None
    nearest: NotRequired[dict[str, Any] | None]
    outside_score: NotRequired[float]
    leftover: NotRequired[dict[str, float]]
    tuned_links: NotRequired[dict[str, dict[str, Any]]]
    detectable: NotRequired[list[DetectableRecord]]
    until: NotRequired[dict[str, Any]]
    baseline: NotRequired[dict[str, dict[str, Any]]]
    baseline_alone: NotRequired[dict[str, dict[str, Any]]]
    baseline_urdf: NotRequired[dict[str, dict[str, Any]]]
    maps: NotRequired[list[dict[str, Any]]]
    maps_fixed: NotRequired[list[dict[str, Any]]]


ChangeVerdict = Literal["no_change", "changed", "changed_unexplained", "not_testable", "refused"]


class SideRecord(TypedDict):
    """One of the two sets."""

    sessions: list[str]
    runs: int
    samples: int
    duration_s: float


class ChangeHeldoutRecord(TypedDict):
    """What a change explains on runs of the later set that the fit never saw."""

    rms_before_Nm: ByJoint
    rms_after_Nm: ByJoint
    gain_rms_Nm: float
    shrink: float


class OtherPlaceRecord(TypedDict):
    """Where a change may sit as well; no joint for what acts on the whole arm."""

    effect: str
    joint: str | None


# `class` is a word of Python's own, so this record is written as a call.
ChangeRecord = TypedDict(
    "ChangeRecord",
    {
        "effect": str,
        "joints": list[str],
        "probability": float,
        "class": list[str],
        "class_probability": float,
        "class_shares": dict[str, float],
        "action": str,
        "parameters": dict[str, IntervalRecord],
        "elsewhere": list[OtherPlaceRecord],
        "heldout": ChangeHeldoutRecord,
        "evidence": dict[str, float],
    },
)


class ComparedHeldoutRecord(TypedDict):
    """All changes together, on runs of the later set; empty where nothing was fitted."""

    rms_before_Nm: ByJoint
    rms_after_Nm: ByJoint
    noise_Nm: ByJoint


class StillJointRecord(TypedDict):
    """A joint that stood still in a set: of its own torque only what exceeds its static friction shows."""

    joint: str
    when: Literal["before", "after", "before and after"]
    reason: str


class SamplesUsedRecord(TypedDict):
    """What a joint's samples are to the comparison, as shares: rows in motion, holds, stretches near turns."""

    joint: str
    in_motion: float
    at_rest: float
    holds: int
    turning: float
    left_out: float
    why: str


class ArmComparisonRecord(ArmRecord):
    """What changed between two sets of recordings of one arm: figures are after minus before."""

    schema: Literal["ident.comparison/1"]
    before: SideRecord
    after: SideRecord
    telemetry: list[TelemetryIssue]
    verdict: ChangeVerdict
    changes: list[ChangeRecord]
    heldout: ComparedHeldoutRecord
    friction_run_spread: ByJoint
    not_testable: list[NotTestableRecord]
    samples_used: NotRequired[list[SamplesUsedRecord]]
    still: NotRequired[list[StillJointRecord]]
    reservations: NotRequired[list[dict[str, Any]]]
