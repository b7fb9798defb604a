"""From recordings and a robot to an arm and motions: read, match joints, check the telemetry, smooth.

Recordings are paths, sessions, or tables in memory; the robot is a URDF path, a name, or an arm that is there already.
What is too long to be held is read, checked and smoothed part by part; its motions wait on disk.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import accumulate, chain, pairwise
from pathlib import Path
from typing import Any

from ident.checks import TelemetryReport, inspect_parts, inspect_sessions
from ident.checks.accepted import TOLD_BY_A_FIT, check_accepted, overrule
from ident.checks.report import as_mounted
from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.errors import RecordingError, RobotError
from ident.files import sha256_of
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion, no_motion, prepare, prepare_each
from ident.motion.out_of_core import emptied, hold, pieces_of
from ident.motion.settings import USUAL_MOTION, MotionSettings
from ident.provenance import SessionStamp, StampLedger, stamp_sessions
from ident.recordings.frames import Source, gather_sources
from ident.recordings.load import PART_SAMPLES, TOPIC, load_parts, load_session, robot_named_in
from ident.recordings.recording import Session, TelemetryIssue
from ident.recordings.session_toml import load_session_file
from ident.robot.arm import ArmModel
from ident.robot.names import is_fetched

Sources = Source | Sequence[Source]
Robot = str | Path | ArmModel


@dataclass(frozen=True, eq=False)
class Opened:
    """Sessions ready for use.

    Attributes:
        arm: The robot, joints that the recordings lack locked; without payload.
        reports: The telemetry check of each session, with the mended session in it; of each part of sessions too long
            to be held, and then without its runs.
        motions: All runs of all sessions, or pieces of them.
        sizes: Name of each session, and how many of the motions are its own.
        passed: Where recordings that are not held come from: stamps, and a record a file.
    """

    arm: ArmModel
    reports: tuple[TelemetryReport, ...]
    motions: Sequence[Motion]
    sizes: tuple[tuple[str, int], ...]
    passed: tuple[tuple[SessionStamp, ...], list[dict[str, Any]]] | None = None

    @property
    def groups(self) -> tuple[tuple[str, tuple[Motion, ...]], ...]:
        """Name and motions of each session."""
        ends = accumulate((count for _, count in self.sizes), initial=0)
        spans = zip(self.sizes, pairwise(ends), strict=True)
        return tuple((name, tuple(self.motions[start:end])) for (name, _), (start, end) in spans)

    @property
    def issues(self) -> tuple[TelemetryIssue, ...]:
        """All that the telemetry checks found."""
        return tuple(issue for report in self.reports for issue in report.issues)

    @property
    def stamps(self) -> tuple[SessionStamp, ...]:
        """Where the recordings come from."""
        return self.passed[0] if self.passed else stamp_sessions(report.session for report in self.reports)

    def data_records(self) -> list[dict[str, Any]]:
        """Name and SHA-256 of each file that was read, for a model's provenance."""
        return self.passed[1] if self.passed else [one for report in self.reports for one in _records(report.session)]


def _records(session: Session) -> list[dict[str, Any]]:
    return [
        {"session": session.name, "file": source.name, "sha256": sha256_of(source)}
        for source in sorted({run.source for run in session.runs if run.source and run.source.is_file()})
    ]


def load_sources(sources: Sources, topic: str = TOPIC, session_file: str | Path | None = None) -> tuple[Session, ...]:
    """Whatever a user gives as recordings, as sessions."""
    return tuple(
        one if isinstance(one, Session) else load_session(one, topic, session_file)
        for one in _gather(sources, session_file)
    )


def _gather(sources: Sources, session_file: str | Path | None) -> list[str | Path | Session]:
    return gather_sources(sources, None if session_file is None else load_session_file(Path(session_file)))


def load_robot(robot: Robot | None, sessions: Sequence[Session]) -> ArmModel:
    """The robot that the user names or gives, or the one that the sessions' files name.

    Raises:
        RecordingError: Neither names one.
        RobotError: It can't be used.
    """
    if isinstance(robot, ArmModel):
        return robot
    if robot is not None and not isinstance(robot, str | Path):
        raise RobotError("robot", f"a {type(robot).__name__} is no robot", "give a URDF path, a name or an ArmModel")
    named = robot or next((session.robot for session in sessions if session.robot), None)
    if named is None:
        where = str(sessions[0].path or sessions[0].name) if sessions else "--robot"
        raise RecordingError(where, "no robot is named", "give --robot, or robot = … in session.toml")
    if robot is None and is_fetched(named):
        raise RobotError(named, "a recording can't have it fetched by robot_descriptions", f"give --robot {named}")
    return ArmModel.load(named)


def inspect_paths(
    paths: Sources,
    robot: Robot | None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
) -> tuple[ArmModel, tuple[TelemetryReport, ...]]:
    """Reads sessions and checks their telemetry, without refusing any."""
    sessions = load_sources(paths, topic, session_file)
    arm = load_robot(robot, sessions)
    reports = inspect_sessions(sessions, arm)
    return as_mounted(arm, reports[0].session), reports


def inspect_in_parts(
    paths: Sources,
    robot: Robot | None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    ledger: StampLedger | None = None,
    accept: Sequence[str] = (),
    settings: TelemetrySettings = USUAL_TELEMETRY,
) -> tuple[ArmModel, Iterable[TelemetryReport]]:
    """The same; sessions too long to be held come in parts of consecutive runs, each read when its turn comes.

    A part is checked by itself, the amount of motion in all of them at the end: see `ident.checks.streaming`.

    Args:
        paths, robot, topic, session_file: As for `open_sessions`.
        ledger: Takes note of what passes.
        accept: Names of issues whose refusal is overruled.
        settings: What recordings are refused by.
    """
    accepted = check_accepted(accept)
    parts, coming, robot = _begin(paths, robot, topic, session_file, ledger or StampLedger())
    arm = load_robot(robot, parts)
    if coming is not None:
        reports = inspect_parts(chain(emptied(parts), coming), arm, settings)
        return arm, map(partial(overrule, accept=accepted), reports)
    return arm, tuple(overrule(report, accepted) for report in inspect_sessions(parts, arm, settings))


def _begin(
    paths: Sources, robot: Robot | None, topic: str, session_file: str | Path | None, ledger: StampLedger
) -> tuple[list[Session], Iterator[Session] | None, Robot | None]:
    """Sessions, those that are to come if there are too many samples to be held, and the robot that is named."""
    sources = _gather(paths, session_file)
    if robot is None:
        # Asked of all settings at once: the session that names the robot may be far from its turn.
        named = next((name for one in sources if (name := _robot_of(one, session_file))), None)
        robot = None if named is None or is_fetched(named) else named
    coming = ledger.passing(
        chain.from_iterable(
            (one,) if isinstance(one, Session) else load_parts(one, topic, session_file, PART_SAMPLES)
            for one in sources
        )
    )
    parts: list[Session] = []
    for part in coming:
        parts.append(part)
        if sum(each.samples for each in parts) >= PART_SAMPLES:
            return parts, coming, robot
    return parts, None, robot


def _robot_of(source: str | Path | Session, session_file: str | Path | None) -> str | None:
    return source.robot if isinstance(source, Session) else robot_named_in(source, session_file)


def open_sessions(
    paths: Sources,
    robot: Robot | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
    learning: bool = True,
    accept: Sequence[str] = (),
    motion: MotionSettings = USUAL_MOTION,
) -> Opened:
    """Reads, checks, mends and smooths sessions.

    Args:
        paths: Session folders or files, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the common filter [Hz].
        learning: Whether something is to be fitted: then too little data is refused too.
        accept: Names of issues whose refusal is overruled.
        motion: How a recording becomes a motion.

    Raises:
        InputError: Recordings or robot can't be used, or an issue that can't be accepted.
    """
    accepted, ledger = check_accepted(accept), StampLedger()
    sessions, coming, robot = _begin(paths, robot, topic, session_file, ledger)
    arm = load_robot(robot, sessions)
    if coming is None:
        return _open(sessions, arm, cutoff, learning, accepted, motion)
    passing = _Passing(cutoff, learning, motion)
    reports = inspect_parts(chain(emptied(sessions), coming), arm)
    motions = hold(passing.prepare(overrule(report, accepted, TOLD_BY_A_FIT) for report in reports))
    if not motions:
        raise no_motion(passing.reports[-1].session.path or passing.reports[-1].session.name)
    sizes = tuple((name, sum(pieces_of(motions, length) for length in runs)) for name, runs in passing.lengths.items())
    kept = (ledger.stamps, passing.records)
    arm = as_mounted(arm, passing.reports[0].session)
    return Opened(arm.keeping(passing.joints), tuple(passing.reports), motions, sizes, kept)


@dataclass(eq=False)
class _Passing:
    """Parts of sessions on their way to motions: what is kept of them when they are let go.

    Attributes:
        cutoff: Corner of the common filter [Hz].
        learning: Whether something is to be fitted.
        motion: How a recording becomes a motion.
        joints: Of all parts.
        reports: Without runs.
        lengths: Samples of each run that became a motion, by session.
        records: Name and SHA-256 of each file.
    """

    cutoff: float | None
    learning: bool
    motion: MotionSettings
    joints: tuple[str, ...] = ()
    reports: list[TelemetryReport] = field(default_factory=list)
    lengths: dict[str, list[int]] = field(default_factory=dict)
    records: list[dict[str, Any]] = field(default_factory=list)

    def prepare(self, reports: Iterable[TelemetryReport]) -> Iterator[Motion]:
        """Motions of parts that are fit for use.

        Raises:
            RecordingError: One is not, or has other joints than the first.
        """
        for report in reports:
            session = report.require_fit(self.learning).session
            if session.runs:
                self.joints = self.joints or session.joints
                _require_same(session, self.joints, self.reports[0].session.name if self.reports else "")
            self.reports.append(replace(report, session=session.replace(runs=())))
            self.records += _records(session)
            del report
            for motion in prepare_each(session, self.cutoff, self.motion):
                self.lengths.setdefault(session.name, []).append(len(motion.time))
                yield motion
            del session  # a part is let go before the next is read


def open_for_model(
    paths: Sources,
    model: HybridModel,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
) -> Opened:
    """The same for an evaluation: the robot is the model's, and little data is enough.

    Raises:
        InputError: As `open_sessions`; or a joint that the model speaks of is not recorded.
    """
    sources = load_sources(paths, topic, session_file)
    for session in sources:
        if session.robot:  # a recording of another arm is refused, whatever the arms are called
            theirs = load_robot(None, (session,))
            common = [name for name in theirs.joint_names if name in model.robot.joint_names]
            model.require_robot(theirs.keeping(common) if common else theirs, session.path or session.name)
    opened = _open(sources, model.robot, cutoff, learning=False)
    missing = [name for name in model.joint_names if name not in opened.arm.joint_names]
    if missing:
        raise RecordingError(
            opened.reports[0].session.path or opened.reports[0].session.name,
            f"{', '.join(missing)} not recorded, but in the model",
            "fit a model for these joints",
        )
    return opened


def _open(
    sessions: Sequence[Session],
    arm: ArmModel,
    cutoff: float | None,
    learning: bool,
    accept: Sequence[str] = (),
    motion: MotionSettings = USUAL_MOTION,
) -> Opened:
    reports = tuple(overrule(report, accept, TOLD_BY_A_FIT) for report in inspect_sessions(sessions, arm))
    for report in reports:
        report.require_fit(learning)
    joints = reports[0].session.joints
    for report in reports[1:]:
        _require_same(report.session, joints, reports[0].session.name)
    groups = [prepare(report.session, cutoff, motion) for report in reports]
    sizes = tuple((report.session.name, len(group)) for report, group in zip(reports, groups, strict=True))
    return Opened(
        as_mounted(arm, reports[0].session).keeping(joints), reports, tuple(chain.from_iterable(groups)), sizes
    )


def _require_same(session: Session, joints: tuple[str, ...], first: str) -> None:
    if session.joints != joints:
        raise RecordingError(
            session.path or session.name,
            f"its joints are {', '.join(session.joints)}, those of {first} are not",
            "give sessions with the same joints together",
        )
