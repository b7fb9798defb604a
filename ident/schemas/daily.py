"""Files of the commands of daily work: `ident new` and `ident watch` with --json."""

from __future__ import annotations

from typing import Any, Literal, NotRequired

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
    robot: str | None
    joints: list[str]
    columns: dict[str, str]
    settings: dict[str, Any]
    reasons: list[ReasonRecord]
    left_out: list[str]
    telemetry: list[IssueRecord]
    provenance: ProvenanceRecord


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


class AlarmRecord(TypedDict):
    """A figure that has changed, with the 95 % interval of the change."""

    arm: str
    session: str
    joint: str
    figure: str
    since: str
    probability: float
    evidence: float
    before: float
    after: float
    low: float
    high: float
    spread: float
    scale: float | None
    scale_low: float | None
    scale_high: float | None


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
    hint: NotRequired[AlarmRecord | None]


class OddSessionRecord(TypedDict):
    """A figure that one session alone has."""

    arm: str
    joint: str
    figure: str
    session: str
    value: float
    usual: float
    spread: float
    p_value: float


class WatchRecord(TypedDict):
    """All arms of a store, and what has changed; the chance of any false alarm in an arm's life is at most `level`."""

    schema: Literal["ident.watch/1"]
    level: float
    arms: list[WatchedArmRecord]
    alarms: list[AlarmRecord]
    provenance: ProvenanceRecord
    fresh: NotRequired[list[str]]
    waiting: NotRequired[list[str]]
    odd: NotRequired[list[OddSessionRecord]]
