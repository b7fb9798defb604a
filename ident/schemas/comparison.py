"""`ident.comparison/1`: the file of `ident compare --json`."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.schemas.common import ByJoint, IntervalRecord, IssueRecord, ProvenanceRecord
from ident.schemas.diagnosis import NotTestableRecord

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


class ArmComparisonRecord(TypedDict):
    """What changed between two sets of recordings of one arm: figures are after minus before."""

    schema: Literal["ident.comparison/1"]
    robot: str
    joints: list[str]
    before: SideRecord
    after: SideRecord
    telemetry: list[IssueRecord]
    verdict: ChangeVerdict
    changes: list[ChangeRecord]
    heldout: ComparedHeldoutRecord
    friction_run_spread: ByJoint
    not_testable: list[NotTestableRecord]
    provenance: ProvenanceRecord
    samples_used: NotRequired[list[SamplesUsedRecord]]
    still: NotRequired[list[StillJointRecord]]
    reservations: NotRequired[list[dict[str, Any]]]
