"""From paths and a robot's name to an arm and motions: read, match joints, check the telemetry, smooth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from ident.errors import RecordingError
from ident.files import sha256_of
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion, prepare
from ident.motion.out_of_core import emptied
from ident.recordings.load import PART_SAMPLES, load_parts, load_sessions, robot_named_in
from ident.recordings.recording import Session, TelemetryIssue
from ident.robot.arm import ArmModel
from ident.telemetry import TelemetryReport, inspect_parts, inspect_sessions


@dataclass(frozen=True, eq=False)
class Opened:
    """Sessions ready for use.

    Attributes:
        arm: The robot, joints that the recordings lack locked; without payload.
        reports: The telemetry check of each session, with the mended session in it.
        groups: Name and motions of each session.
    """

    arm: ArmModel
    reports: tuple[TelemetryReport, ...]
    groups: tuple[tuple[str, tuple[Motion, ...]], ...]

    @property
    def motions(self) -> tuple[Motion, ...]:
        """All runs of all sessions."""
        return tuple(motion for _, motions in self.groups for motion in motions)

    @property
    def issues(self) -> tuple[TelemetryIssue, ...]:
        """All that the telemetry checks found."""
        return tuple(issue for report in self.reports for issue in report.issues)

    def data_records(self) -> list[dict[str, Any]]:
        """Name and SHA-256 of each file that was read, for a model's provenance."""
        return [
            {"session": report.session.name, "file": source.name, "sha256": sha256_of(source)}
            for report in self.reports
            for source in sorted({run.source for run in report.session.runs if run.source and run.source.is_file()})
        ]


def choose_robot(robot: str | None, sessions: Sequence[Session]) -> str:
    """The robot that the user names, or the one that the sessions' files name.

    Raises:
        RecordingError: Neither names one.
    """
    named = robot or next((session.robot for session in sessions if session.robot), None)
    if named is None:
        where = str(sessions[0].path or sessions[0].name)
        raise RecordingError(where, "no robot is named", "give --robot, or robot = … in session.toml")
    return named


def inspect_paths(
    paths: Sequence[str | Path],
    robot: str | None,
    topic: str = "/joint_states",
    session_file: str | Path | None = None,
) -> tuple[ArmModel, tuple[TelemetryReport, ...]]:
    """Reads sessions and checks their telemetry, without refusing any."""
    sessions = load_sessions(paths, topic, session_file)
    arm = ArmModel.load(choose_robot(robot, sessions))
    return arm, inspect_sessions(sessions, arm)


def inspect_in_parts(
    paths: Sequence[str | Path],
    robot: str | None,
    topic: str = "/joint_states",
    session_file: str | Path | None = None,
) -> tuple[ArmModel, Iterable[TelemetryReport]]:
    """The same; sessions too long to be held come in parts of consecutive runs, each read when its turn comes.

    A part is checked by itself, the amount of motion in all of them at the end: see `ident.telemetry.streaming`.
    """
    # Asked of all settings at once: the session that names the robot may be far from its turn.
    robot = robot or next((name for path in paths if (name := robot_named_in(path, session_file))), None)
    coming = chain.from_iterable(load_parts(path, topic, session_file, PART_SAMPLES) for path in paths)
    parts: list[Session] = []
    for part in coming:
        parts.append(part)
        if sum(each.samples for each in parts) >= PART_SAMPLES:
            arm = ArmModel.load(choose_robot(robot, parts))
            return arm, inspect_parts(chain(emptied(parts), coming), arm)
    arm = ArmModel.load(choose_robot(robot, parts))
    return arm, inspect_sessions(parts, arm)


def open_sessions(
    paths: Sequence[str | Path],
    robot: str | None,
    topic: str = "/joint_states",
    session_file: str | Path | None = None,
    cutoff: float | None = None,
    learning: bool = True,
) -> Opened:
    """Reads, checks, mends and smooths sessions.

    Args:
        paths: Session folders or files.
        robot: URDF path or name; None takes the one named in session.toml.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the common filter [Hz].
        learning: Whether something is to be fitted: then too little data is refused too.

    Raises:
        InputError: Recordings or robot can't be used.
    """
    sessions = load_sessions(paths, topic, session_file)
    arm = ArmModel.load(choose_robot(robot, sessions))
    return _open(sessions, arm, cutoff, learning)


def open_for_model(
    paths: Sequence[str | Path],
    model: HybridModel,
    topic: str = "/joint_states",
    session_file: str | Path | None = None,
    cutoff: float | None = None,
) -> Opened:
    """The same for an evaluation: the robot is the model's, and little data is enough.

    Raises:
        InputError: As `open_sessions`; or a joint that the model speaks of is not recorded.
    """
    opened = _open(load_sessions(paths, topic, session_file), model.robot, cutoff, learning=False)
    missing = [name for name in model.joint_names if name not in opened.arm.joint_names]
    if missing:
        raise RecordingError(
            paths[0], f"{', '.join(missing)} not recorded, but in the model", "fit a model for these joints"
        )
    return opened


def _open(sessions: Sequence[Session], arm: ArmModel, cutoff: float | None, learning: bool) -> Opened:
    reports = inspect_sessions(sessions, arm)
    for report in reports:
        report.require_fit(learning)
    joints = reports[0].session.joints
    for report in reports[1:]:
        if report.session.joints != joints:
            raise RecordingError(
                report.session.path or report.session.name,
                f"its joints are {', '.join(report.session.joints)}, those of {reports[0].session.name} are not",
                "give sessions with the same joints together",
            )
    missing = [name for name in arm.joint_names if name not in joints]
    groups = tuple((report.session.name, prepare(report.session, cutoff)) for report in reports)
    return Opened(arm.locked(missing) if missing else arm, reports, groups)
