"""The file of `ident close`."""

from __future__ import annotations

from typing import Literal, NotRequired

from typing_extensions import TypedDict

from ident.schemas.common import ProvenanceRecord


class RoundRecord(TypedDict):
    """One round: minutes of motion, gap of the model before it by joint, and what all recordings together say."""

    minutes: float
    gap_floors: dict[str, float] | None
    gap_upper: float | None
    verdict: str
    named: list[str]


class ClosedArmRecord(TypedDict):
    """One arm; gaps are of torque on runs that the model never saw, in noise floors, root mean square over joints."""

    seed: int | None
    robot: str
    joints: list[str]
    effects: list[str]
    closed: bool
    reason: str
    minutes: float
    rounds: int
    by_round: list[RoundRecord]
    named: list[str]
    gap_floors_before: float
    gap_floors_after: float
    gap_floors_by_joint: dict[str, float]
    heldout_floors: dict[str, float]
    patch: str
    tracking_before_rad: NotRequired[float]
    tracking_after_rad: NotRequired[float]
    tuned_after_rad: NotRequired[float]
    net_after_rad: NotRequired[float]
    randomised_after_rad: NotRequired[float]


class CloseRecord(TypedDict):
    """All arms of a loop."""

    schema: Literal["ident.close/1"]
    arms: list[ClosedArmRecord]
    provenance: ProvenanceRecord
