"""Files of all other commands with --json: recordings, models, and days of one arm."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

from typing_extensions import TypedDict

from ident.checks.report import JointEffort
from ident.infer.guess import Reason
from ident.monitor.alarms import Alarm, Outlier
from ident.recordings.recording import TelemetryIssue
from ident.schemas.diagnosis import ArmRecord, DiagnosisRecord, OriginRecord

# Rung -> joint (and `total`) -> figure; null where a joint never moves, spreads of a single run too.
LadderTable = dict[str, dict[str, float | None]]


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
    effort: list[JointEffort]
    telemetry: list[TelemetryIssue]


class TelemetryRecord(OriginRecord):
    """The telemetry checks of all sessions."""

    schema: Literal["ident.telemetry/1"]
    sessions: list[InspectedRecord]


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


class FitRecord(OriginRecord):
    """A fitted model; its provenance holds options, files and versions too."""

    schema: Literal["ident.fit/1"]
    robot: ModelRobotRecord
    inertia: ModelInertiaRecord
    loss: dict[str, Any]
    net: dict[str, Any]
    trained: NotRequired[dict[str, Any]]
    coupling: NotRequired[dict[str, Any]]
    named: NotRequired[list[NamedLawRecord]]


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


class EvaluationRecord(ArmRecord):
    """Scores of one model."""

    schema: Literal["ident.evaluation/1"]
    model: str
    sessions: list[SessionScoreRecord]
    pooled: SessionScoreRecord


class EvaluationsRecord(ArmRecord):
    """Scores of several models on the same recordings."""

    schema: Literal["ident.evaluations/1"]
    models: list[EvaluationRecord]


class ViewRecord(ArmRecord):
    """Runs that a timeline shows."""

    schema: Literal["ident.view/1"]
    runs: list[str]


class DemoRecord(ArmRecord):
    """The main job on the shipped recordings."""

    schema: Literal["ident.demo/1"]
    models: list[EvaluationRecord]
    diagnoses: list[DiagnosisRecord]
    files: NotRequired[list[str]]


class NewSessionRecord(OriginRecord):
    """A session.toml that was guessed: columns by their native names, other keys, and the evidence."""

    schema: Literal["ident.new/1"]
    file: str
    robot: str | None
    joints: list[str]
    columns: dict[str, str]
    settings: dict[str, Any]
    reasons: list[Reason]
    left_out: list[str]
    telemetry: list[TelemetryIssue]


class FigurePointRecord(TypedDict):
    """A figure in one session, with its 95 % interval by that session alone."""

    session: str
    date: str
    value: float
    low: float
    high: float
    std: float


class WatchedSessionRecord(TypedDict):
    """A session as it was examined: `done`, `refused` or `failed`, with the reason."""

    arm: str
    session: str
    date: str
    status: Literal["done", "refused", "failed"]
    verdict: str | None
    reason: str | None
    samples: int | None
    duration_s: float | None
    stamp: str
    path: str
    robot: NotRequired[str | None]


class WatchedArmRecord(TypedDict):
    """An arm through time; figures by `joint/figure`. No robot, no joints where no session could be read.

    The hint is what may be changing, without evidence enough for an alarm.
    """

    arm: str
    robot: str | None
    joints: list[str]
    sessions: list[WatchedSessionRecord]
    figures: dict[str, list[FigurePointRecord]]
    effects: list[dict[str, Any]]
    hint: NotRequired[Alarm | None]


class WatchRecord(OriginRecord):
    """All arms of a store, and what has changed; the chance of any false alarm in an arm's life is at most `level`."""

    schema: Literal["ident.watch/1"]
    level: float
    arms: list[WatchedArmRecord]
    alarms: list[Alarm]
    fresh: NotRequired[list[str]]
    waiting: NotRequired[list[str]]
    odd: NotRequired[list[Outlier]]


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


class CloseRecord(OriginRecord):
    """All arms of a loop."""

    schema: Literal["ident.close/1"]
    arms: list[ClosedArmRecord]


class FigureRangeRecord(TypedDict):
    """A figure's range, and what makes it so wide: its own interval, or its spread over the days."""

    value: float
    low: float
    high: float
    unit: str
    source: Literal["interval", "days"]


class HeldOutRangesRecord(TypedDict):
    """How often the torque of a day left out lies inside, and how many times the habit's ranges are wider."""

    level: float
    inside: dict[str, float]
    narrower_than_habit: float | None
    habit: float


class RangesRecord(ArmRecord):
    """Ranges by `joint/figure`."""

    schema: Literal["ident.ranges/1"]
    days: list[str]
    ranges: dict[str, FigureRangeRecord]
    noise_Nm: dict[str, float]
    heldout: HeldOutRangesRecord


class ServoFigureRecord(TypedDict):
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str


class ServoJointRecord(TypedDict):
    """What is told of a joint, what else would look the same, and what is not told, with the reason."""

    figures: dict[str, ServoFigureRecord]
    not_told: dict[str, str]
    heldout: dict[str, float] | None


class ServoRecord(OriginRecord):
    """Joints of a position-only arm."""

    schema: Literal["ident.servo/1"]
    robot: str
    joints: dict[str, ServoJointRecord]
