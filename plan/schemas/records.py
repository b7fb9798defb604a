"""Files of `plan solve`, `compare` and `excite` with --json."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.results import Provenance


class EnergyRecord(TypedDict):
    """Energy by each way of counting it [J]."""

    signed: float
    positive: float
    absolute: float


class ResultRecord(TypedDict):
    """One plan with its certificate, or why there is none."""

    schema: Literal["plan.result/1"]
    status: Literal["solved", "infeasible", "budget_spent"]
    reason: str
    robot: str
    joints: list[str]
    held: dict[str, float]
    carried: list[dict[str, Any]]
    method: str
    objective: Literal["energy", "time"]
    metric: str
    evaluations: int
    seconds: float
    cpu_seconds: float
    seed: int
    reference_gap: float | None
    starts: list[dict[str, Any]]
    history: list[list[float]]
    notes: list[str]
    provenance: Provenance
    energy_J: NotRequired[EnergyRecord]
    duration_s: NotRequired[float]
    peak_torque_share: NotRequired[list[float]]
    peak_speed_share: NotRequired[list[float]]
    collision_free: NotRequired[bool]
    clearance_m: NotRequired[float | None]
    asked_clearance_m: NotRequired[float]
    clearance_cuts: NotRequired[list[dict[str, Any]]]
    limits: NotRequired[dict[str, float | None]]
    execution: NotRequired[dict[str, float]]
    extrapolation: NotRequired[float | None]
    beyond_training: NotRequired[list[dict[str, Any]]]
    torque_reserve_Nm: NotRequired[list[float] | None]
    energy_half_width_J: NotRequired[float | None]
    unchecked_pairs: NotRequired[list[dict[str, Any]]]
    coarser_obstacles: NotRequired[list[str]]
    rules: NotRequired[list[dict[str, Any]]]
    stand_in: NotRequired[dict[str, Any]]
    link_meshes: NotRequired[list[dict[str, Any]]]
    issues: NotRequired[list[dict[str, Any]]]
    via_points_rad: NotRequired[list[list[float]]]
    times_s: NotRequired[list[float]]


class ComparisonRecord(TypedDict):
    """All methods on one task."""

    schema: Literal["plan.comparison/1"]
    task: str
    robot: str
    joints: list[str]
    objective: Literal["energy", "time"]
    at_evaluations: int
    at_seconds: float
    summary: list[dict[str, Any]]
    results: list[ResultRecord]
    provenance: Provenance


class ExcitationRecord(TypedDict):
    """The next motion to record."""

    schema: Literal["plan.excite/1"]
    robot: str
    joints: list[str]
    status: Literal["ready", "one_sided", "needs_set_up"]
    aim: Literal["separate", "show", "identify"]
    separates: list[str]
    joint: str
    set_up: str | None
    told_by_motion: list[str]
    motion: dict[str, Any]
    distance: dict[str, Any]
    odds: float
    odds_random: float
    noise_Nm: dict[str, float]
    obstacles: NotRequired[list[str]]
    carried: NotRequired[list[dict[str, Any]]]
    unchecked_pairs: NotRequired[list[dict[str, Any]]]
    rules: NotRequired[list[dict[str, Any]]]
    stand_in: NotRequired[dict[str, Any]]
    link_meshes: NotRequired[list[dict[str, Any]]]
    issues: NotRequired[list[dict[str, Any]]]
    evaluations: int
    seconds: float
    seed: int
    provenance: Provenance


RECORDS: dict[str, Any] = {"comparison": ComparisonRecord, "excite": ExcitationRecord, "result": ResultRecord}
