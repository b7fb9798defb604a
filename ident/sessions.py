"""From recordings and a robot to an arm and motions: read, match joints, check the telemetry,
smooth.

One way in: what is given comes as parts, each checked when its turn comes; a session that is not
long is one part. What is too long to be held is let go part by part; stretches of its motions are
held.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import accumulate, chain, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ident.arrays import in_a_line
from ident.checks.inspection import inspect_parts, inspect_sessions
from ident.checks.report import (
    REPORTED_BY_A_FIT,
    TelemetryReport,
    as_mounted,
    check_accepted,
    overrule,
)
from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.errors import RecordingError, RobotError
from ident.model.hybrid import HybridModel
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion, no_motion, prepare_each
from ident.motion.settings import USUAL_MOTION, MotionSettings
from ident.motion.stretches import FITTED_SAMPLES, hold
from ident.recordings import TOPIC
from ident.recordings.load import PART_SAMPLES, Source, gather_sources, load_parts
from ident.recordings.recording import Session, TelemetryIssue
from ident.recordings.session_toml import load_session_file, settings_of
from ident.results import SessionStamp, StampLedger, known_series
from ident.robot.arm import ArmModel
from ident.robot.branches import arm_tips
from ident.robot.names import find_urdf, is_fetched, split_tip
from ident.safe_read import read_text

if TYPE_CHECKING:
    from ident.results import KnownSeries

# Over all runs a joint that stands is within this [rad or m] (chosen: else it stood in several
# places).
STANDS = 0.01

Sources = Source | Sequence[Source]
Robot = str | Path | ArmModel


@dataclass(frozen=True)
class Given:
    """Recordings and a robot as a user gives them."""

    # session folders or files, sessions, or tables in memory (the runs of one session)
    paths: Sources
    # URDF path, name or arm; None takes the one that a session.toml names
    robot: Robot | None = None
    topic: str = TOPIC  # topic of bags
    session_file: str | Path | None = None  # A session.toml for folders that can't hold one

    @cached_property
    def gathered(self) -> list[str | Path | Session]:
        """The paths and sessions, tables in memory made sessions."""
        stated = None
        if self.session_file is not None:
            stated = load_session_file(Path(self.session_file))
        return gather_sources(self.paths, stated)

    def parts(self, most: int = sys.maxsize) -> Iterator[Session]:
        """Every session, or its parts of consecutive runs with about so many samples, each read
        when its turn comes.
        """
        for source in self.gathered:
            if isinstance(source, Session):
                yield source
            else:
                yield from load_parts(source, self.topic, self.session_file, most)

    def find_robot(self) -> Robot | None:
        """The robot that is given, else the first that settings name; None where nobody names one.

        Its session may be far from its turn.
        """
        if self.robot is not None:
            return self.robot
        for source in self.gathered:
            if isinstance(source, Session):
                named = source.robot
            else:
                named = settings_of(Path(source), self.session_file).robot
            if named:
                return None if is_fetched(named) else named
        return None


def load_robot(robot: Robot | None, sessions: Sequence[Session]) -> ArmModel:
    """The robot that the user names or gives, or the one that the sessions' files name.

    Raises:
        RecordingError: Neither names one.
        RobotError: It can't be used.
    """
    if isinstance(robot, ArmModel):
        return robot
    if robot is not None and not isinstance(robot, str | Path):
        raise RobotError(
            "robot",
            f"a {type(robot).__name__} is no robot",
            "give a URDF path, a name or an ArmModel",
        )
    named = robot or next((session.robot for session in sessions if session.robot), None)
    if named is None:
        where = str(sessions[0].path or sessions[0].name) if sessions else "--robot"
        raise RecordingError(
            where, "no robot is named", "give --robot, or robot = … in session.toml"
        )
    if robot is None and is_fetched(named):
        raise RobotError(
            named,
            "a recording can't have it fetched by robot_descriptions",
            f"give --robot {named}",
        )
    return load_arm_of_log(named, sessions)


def load_arm_of_log(named: str | Path, sessions: Sequence[Session]) -> ArmModel:
    """A robot; of one with several arms the one whose joints the recordings name, where they name
    one alone.

    Raises:
        RobotError: It can't be used, or it has several arms and the names don't tell which.
    """
    try:
        return ArmModel.load(named)
    except RobotError as error:
        path = find_urdf(named)
        _, tip = split_tip(named)
        has_branches = "not a serial chain" in str(error)
        if tip or path.suffix == ".xacro" or not sessions or not has_branches:
            raise
        recorded = set(sessions[0].joints)
        for end in arm_tips(read_text(path, "give a URDF file", RobotError)):
            with suppress(RobotError):
                arm = ArmModel.load(f"{named}:{end}")
                if set(arm.joint_names) <= recorded:
                    return arm
        raise


@dataclass(frozen=True, eq=False)
class Inspected:
    """Recordings that have been checked, or are as they are asked for."""

    arm: ArmModel  # the robot
    # One a session; where these are too long to be held, an iterator of one a part of consecutive
    # runs, checked by itself, the amount of motion in all of them at the end.
    reports: Iterable[TelemetryReport]
    ledger: StampLedger  # takes note of what has passed

    @property
    def whole(self) -> tuple[ArmModel, tuple[TelemetryReport, ...]]:
        """The arm as it is mounted, and all reports."""
        reports = tuple(self.reports)
        return as_mounted(self.arm, reports[0].session), reports


def inspect_sources(
    given: Given,
    accept: Sequence[str] = (),
    settings: TelemetrySettings = USUAL_TELEMETRY,
    in_parts: bool = False,
    reported: Sequence[str] = (),
    known: Sequence[KnownSeries] = (),
) -> Inspected:
    """Reads sessions and checks their telemetry, without refusing any.

    Args:
        given, settings: Recordings and robot, and by what they are refused.
        accept, reported: Names of issues whose refusal is overruled, and of those that what comes
            next reports.
        in_parts: Whether what is too long to be held may come in parts.
        known: Recordings that are looked for in the sessions.

    Raises:
        InputError: Recordings or robot can't be used, or an issue that can't be accepted.
    """
    weaken = partial(overrule, accept=check_accepted(accept), reported=reported)
    ledger = StampLedger(known)
    most = PART_SAMPLES if in_parts else sys.maxsize
    coming = ledger.passing(given.parts(most))
    parts: list[Session] = []
    for session in coming:
        parts.append(session)
        if sum(session_part.samples for session_part in parts) >= most:
            arm = load_robot(given.find_robot(), parts)
            # a part is let go when it has been checked
            read = (parts.pop(0) for _ in range(len(parts)))
            reports = inspect_parts(chain(read, coming), arm, settings)
            return Inspected(arm, map(weaken, reports), ledger)
    arm = load_robot(given.find_robot(), parts)
    checked = inspect_sessions(parts, arm, settings)
    return Inspected(arm, tuple(map(weaken, checked)), ledger)


@dataclass(frozen=True, eq=False)
class Opened:
    """Sessions ready for use."""

    __repr__ = in_a_line

    arm: ArmModel  # the robot, joints that the recordings lack locked; without payload
    # the telemetry check of each session or part, its runs let go
    reports: tuple[TelemetryReport, ...]
    motions: Sequence[Motion]  # all runs of all sessions, or pieces of them
    # name of each session, and how many of the motions are its own
    sizes: tuple[tuple[str, int], ...]
    ledger: StampLedger  # where the recordings come from

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
        """Where the recordings come from: one stamp a session."""
        return self.ledger.stamps

    def data_records(self) -> list[dict[str, Any]]:
        """Session, name, SHA-256 and series of each file read, for a model's provenance."""
        return self.ledger.files


def open_sessions(
    paths: Sources,
    robot: Robot | HybridModel | None = None,
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
        robot: URDF path, name or arm; None takes the one named in session.toml. A model is for an
            evaluation: its robot is taken, recordings of another arm are refused, and they are
            read whole.
        topic, session_file: Topic of bags; a session.toml for folders that can't hold one.
        cutoff: Corner of the common filter [Hz].
        learning: Whether something is to be fitted: then too little data is refused too.
        accept: Names of issues whose refusal is overruled.
        motion: How a recording becomes a motion.

    Raises:
        InputError: Recordings or robot can't be used, an issue that can't be accepted, or a joint
            that the model speaks of is not recorded.
    """
    model = None
    given = Given(paths, None, topic, session_file)
    if isinstance(robot, HybridModel):
        model = robot
        sessions = tuple(given.parts())
        _require_robot_of(model, sessions)
        given = Given(sessions, model.robot)
    else:
        given = replace(given, robot=robot)
    known = () if model is None else known_series(model.provenance)
    inspected = inspect_sources(
        given, accept, in_parts=model is None, reported=REPORTED_BY_A_FIT, known=known
    )
    reports: list[TelemetryReport] = []
    groups: list[_Group] = []
    groups_of: list[int] = []
    coming = _prepare(
        inspected.reports,
        reports,
        groups,
        groups_of,
        learning,
        partial(prepare_each, cutoff=cutoff, settings=motion),
    )
    held = hold(coming, FITTED_SAMPLES if model is None else sys.maxsize)
    short = next((group.where for k, group in enumerate(groups) if k not in groups_of), None)
    if short is not None or not groups:
        raise no_motion(short or reports[-1].session.name, motion)
    count = Counter(groups_of[k] for k in held.source)
    sizes = tuple((group.name, count[k]) for k, group in enumerate(groups))
    first = reports[0].session
    arm = as_mounted(inspected.arm, first).keeping(groups[0].joints)
    if model is not None:
        missing = [name for name in model.joint_names if name not in arm.joint_names]
        if missing:
            what = f"{', '.join(missing)} not recorded, but in the model"
            remedy = "fit a model for these joints"
            raise RecordingError(first.path or first.name, what, remedy)
    return Opened(arm, tuple(reports), held.motions, sizes, inspected.ledger)


def _require_robot_of(model: HybridModel, sessions: Sequence[Session]) -> None:
    """Passes if sessions that name a robot name the model's, whatever the arms are called."""
    for session in sessions:
        if not session.robot:
            continue
        theirs = load_robot(None, (session,))
        common = [name for name in theirs.joint_names if name in model.robot.joint_names]
        if common:
            theirs = theirs.keeping(common, model.robot.locked_joints)
        model.require_robot(theirs, session.path or session.name)


def lock_still(opened: Opened) -> Opened:
    """The sessions with the joints locked that stand in one place in all runs, and a note of it.

    A hand's joint is often logged and never moved. One that stands elsewhere from run to run stays:
    of it a fit says that its losses can't be told.

    Args:
        opened: Sessions that something is to be fitted to.
    """
    motions = opened.motions
    names = opened.arm.joint_names
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    low = np.min([motion.q.min(axis=0) for motion in motions], axis=0)
    high = np.max([motion.q.max(axis=0) for motion in motions], axis=0)
    stands = (moving < LEAST_MOVING) & (high - low <= STANDS)
    if not stands.any() or stands.all():
        return opened
    still = [name for name, is_still in zip(names, stands, strict=True) if is_still]
    moved = tuple(name for name in names if name not in still)
    arm = opened.arm.locked(still, (0.5 * (low + high))[stands].tolist())
    first = opened.reports[0]
    verb = "stands" if len(still) == 1 else "stand"
    evidence = f"{first.session.name}: {', '.join(still)} {verb} in all runs; locked there"
    note = TelemetryIssue("joints_locked", tuple(still), "note", evidence, "none needed")
    reports = (replace(first, issues=(*first.issues, note)), *opened.reports[1:])
    motions = [motion.select(moved) for motion in motions]
    return replace(opened, arm=arm, motions=motions, reports=reports)


class _Group(NamedTuple):
    """A session on its way to motions: its path and name, its joints."""

    where: str | Path
    name: str
    joints: tuple[str, ...]


def _prepare(
    checked: Iterable[TelemetryReport],
    reports: list[TelemetryReport],
    groups: list[_Group],
    groups_of: list[int],
    learning: bool,
    smooth: Callable[[Session], Iterator[Motion]],
) -> Iterator[Motion]:
    """Motions of sessions, or of parts of them, that are fit for use.

    Reports without runs, groups, and the number of each motion's group are added to the lists.

    Raises:
        RecordingError: One is not, or has other joints than the first.
    """
    for report in checked:
        session = report.require_fit(learning).session
        where = session.path or session.name
        if session.runs:
            if groups and session.joints != groups[0].joints:
                what = (
                    f"its joints are {', '.join(session.joints)}, those of {groups[0].name} are not"
                )
                raise RecordingError(where, what, "give sessions with the same joints together")
            if session.path is None or not groups or groups[-1].where != where:
                groups.append(_Group(where, session.name, session.joints))
        reports.append(replace(report, session=session.replace(runs=())))
        del report
        for motion in smooth(session):
            groups_of.append(len(groups) - 1)
            yield motion
        del session  # a part is let go before the next is read
