"""The result of a telemetry check: what was found, and the session as it may be used."""

from __future__ import annotations

import math
import string
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, RecordingError
from ident.recordings.recording import Recording, Session, Severity, TelemetryIssue
from ident.records import Record
from ident.results import Result
from ident.robot.arm import ArmModel

SCHEMA = "ident.telemetry/1"
ORDER: tuple[Severity, ...] = ("fatal", "warning", "note")
# The issue of joints whose torque is off by a factor.
MISREAD = "torque_scale"
# Rounding of a direction that is given by three numbers.
ROUNDED = 1e-6
# What a recording may be used under, but not without a word.
DOUBTFUL = (MISREAD, "guessed_gains", "mounting")
# These say that there is too little to learn from, not that what is there is wrong: harmless in an
# evaluation.
TOO_LITTLE = ("too_few_runs", "insufficient_excitation")
# A torque that a model made tells nothing of an arm, but its fit is right: benchmarks and examples
# are made so. It is told where something is fitted; a diagnosis still refuses it. Bodies that lie
# elsewhere are what a fit mends.
MENDED_BY_A_FIT = ("bodies_misplaced",)
REPORTED_BY_A_FIT = ("effort_is_model", *MENDED_BY_A_FIT)
# What issues say, by wording.
WORDS: Mapping[str, Any] = tomllib.loads(
    Path(__file__).with_name("issues.toml").read_text(encoding="utf-8")
)


class SpacedFormatter(string.Formatter):
    """`str.format` whose percentages stand apart from their sign, as any number does: `81 %`."""

    def format_field(self, value: object, format_spec: str) -> str:
        text = str(super().format_field(value, format_spec))
        return f"{text[:-1]} %" if format_spec.endswith("%") else text


SPACED = SpacedFormatter()


@dataclass(frozen=True)
class JointEffort(Record):
    """What one joint's effort is."""

    joint: str  # its name
    # ``motor_current``, ``motor_torque`` (with the gear's friction), ``joint_torque`` (hardly any
    # friction), ``external_torque`` (follows neither gravity nor motion), ``gravity_compensated``,
    # ``commanded``, ``model_output`` or ``unknown``.
    kind: str
    evidence: str  # what was seen, with figures


@dataclass(frozen=True, eq=False)
class TelemetryReport:
    """What a telemetry check found."""

    # With everything mended that can be mended safely, joints in the robot's order.
    session: Session
    issues: tuple[TelemetryIssue, ...]  # what was found, the worst first
    # The robot with the joints locked that the recording lacks, and its payload; None if none was
    # given.
    arm: ArmModel | None = None
    # What each joint's effort is; empty where there is no robot to hold it against.
    effort: tuple[JointEffort, ...] = ()
    # How log and URDF are best read: what is changed, and the share of torque that it explains, the
    # best two.
    conventions: tuple[dict[str, Any], ...] = ()

    def __post_init__(self) -> None:
        ranked = sorted(self.issues, key=lambda issue: ORDER.index(issue.severity))
        object.__setattr__(self, "issues", tuple(ranked))

    @property
    def fatal(self) -> tuple[TelemetryIssue, ...]:
        """The issues that forbid a fit."""
        return tuple(issue for issue in self.issues if issue.severity == "fatal")

    @property
    def is_fit(self) -> bool:
        """Whether the recordings may be fitted."""
        return not self.fatal

    @property
    def verdict(self) -> str:
        """Whether the recordings may be fitted, in words.

        `not fit for use`, `to be used with care: …` with the kinds of doubtful issues, or `fit for
        use`.
        """
        doubts = [
            issue.issue
            for issue in self.issues
            if issue.issue in DOUBTFUL and issue.severity == "warning"
        ]
        if not self.is_fit:
            return "not fit for use"
        return (
            f"to be used with care: {', '.join(dict.fromkeys(doubts))}" if doubts else "fit for use"
        )

    def find(self, issue: str) -> tuple[TelemetryIssue, ...]:
        """The issues of one kind, by its name; empty without any."""
        return tuple(reported for reported in self.issues if reported.issue == issue)

    def require_fit(self, learning: bool = True) -> TelemetryReport:
        """Passes if the recordings may be used, else refuses.

        Args:
            learning: Whether something is to be fitted; an evaluation may do with little data.

        Returns:
            The report itself.

        Raises:
            RecordingError: A fatal issue; names the file, the place and the remedy.
        """
        fatal = [issue for issue in self.fatal if learning or issue.issue not in TOO_LITTLE]
        if fatal:
            first = fatal[0]
            more = len(fatal) - 1
            also = f" (and {more} more, see `ident inspect`)" if more else ""
            where = str(self.session.path or self.session.name)
            raise RecordingError(where, f"{first.issue}: {first.evidence}", first.remedy + also)
        return self

    def to_dict(self) -> dict[str, Any]:
        """The report for JSON.

        Returns:
            `session`, `runs`, `samples`, `duration_s`, `robot`, `joints`, `common_clock`, `fit`
            (whether it may be fitted), and lists of records: `effort` (by joint), `conventions` and
            `telemetry` (the issues).
        """
        return {
            "session": self.session.name,
            "runs": len(self.session.runs),
            "samples": self.session.samples,
            "duration_s": self.session.duration,
            "robot": self.session.robot if self.arm is None else self.arm.name,
            "joints": list(self.session.joints),
            "common_clock": self.session.common_clock,
            "fit": self.is_fit,
            "effort": [joint_kind.to_dict() for joint_kind in self.effort],
            "conventions": list(self.conventions),
            "telemetry": [issue.to_dict() for issue in self.issues],
        }

    def mend(self, folder: str | Path) -> None:
        """Writes the mended session as a folder of Parquet runs.

        Raises:
            RecordingError: Nothing is left of a run.
        """
        if not all(len(run) for run in self.session.runs):
            where = str(self.session.path or self.session.name)
            raise RecordingError(where, "nothing that can be used is left of it", "record it again")
        from ident.recordings.save import write_session

        write_session(self.session, folder)


@dataclass(frozen=True, eq=False)
class Inspection(Result):
    """The telemetry checks of some sessions."""

    reports: tuple[TelemetryReport, ...]  # one a session

    @property
    def is_fit(self) -> bool:
        """Whether all of them may be fitted."""
        return all(report.is_fit for report in self.reports)

    def to_dict(self) -> dict[str, Any]:
        """The result for JSON: `schema`, `sessions` (a report's record each) and `provenance`."""
        return {
            "schema": SCHEMA,
            "sessions": [report.to_dict() for report in self.reports],
            "provenance": self.provenance.to_dict(),
        }


def as_mounted(arm: ArmModel, session: Session) -> ArmModel:
    """The arm under the gravity that a session states or was found with; as it is where it has
    none.
    """
    return arm if session.gravity is None else arm.with_gravity(np.array(session.gravity))


def require_same_mount(arm: ArmModel, first: Session, session: Session) -> None:
    """Passes if a later session says nothing of its mount, or what the first one's is.

    Args:
        arm: The arm as the first session is mounted.
        first, session: The first session, and a later one that is used together with it.

    Raises:
        RecordingError: Two session files, or one and the URDF, say different mounts.
    """
    if session.gravity is None:
        return
    mounted = np.asarray(arm.model.gravity.linear, dtype=float)
    stated = np.array(session.gravity)
    turned = float(np.linalg.norm(np.cross(mounted, stated)))
    size = float(np.linalg.norm(mounted) * np.linalg.norm(stated))
    same = turned <= ROUNDED * size
    if same and float(mounted @ stated) > 0.0:
        return
    source = "as its URDF has it" if first.gravity is None else "by its session.toml"
    here, there = (str(np.round(values, 3).tolist()) for values in (stated, mounted))
    what = f"gravity_mps2 = {here}, but {there} in {first.name}, {source}"
    remedy = (
        "sessions of one mount go together: write the same line into both; where the base was "
        "moved, leave the line out of the later one and `ident compare` looks for the tilt"
    )
    raise RecordingError(session.path or session.name, what, remedy)


def issue_of(
    key: str,
    session: Session,
    columns: Iterable[Any] = (),
    worst: int | None = None,
    severity: Severity | None = None,
    **seen: Any,
) -> TelemetryIssue:
    """An issue in the words of `issues.toml`.

    Args:
        key: Its row.
        session: The recordings.
        columns: Of the joints concerned, see `joints_at`.
        worst: Column of the joint that the words name; of arrays over the joints they name its
            entry.
        severity: Another one than the row's.
        **seen: What its words name.
    """
    row = WORDS[key]
    if worst is not None:
        seen = {
            name: values[worst] if isinstance(values, np.ndarray) else values
            for name, values in seen.items()
        }
        seen["joint"] = session.joints[worst]
    evidence = SPACED.format(row["evidence"], **seen)
    remedy = SPACED.format(row["remedy"], **seen)
    reported = f"{session.name}: {evidence}"
    return TelemetryIssue(
        row["issue"], joints_at(session, columns), severity or row["severity"], reported, remedy
    )


def with_reach(value: float, reach: float) -> str:
    """A multiple with how far it may be off: to two places, or to the first digit of the latter."""
    places = 2
    if 0.0 < reach < 1.0:
        places = max(places, -math.floor(math.log10(reach)))
    return f"{value:.{places}f} ± {reach:.{places}f}"


def joints_at(session: Session, columns: Iterable[Any]) -> tuple[str, ...]:
    """Names of joints.

    Args:
        session: The recordings.
        columns: Their indices, a mask over all joints, or names, which stay as they are.
    """
    given = list(columns)
    marked = np.flatnonzero(given) if given and isinstance(given[0], bool | np.bool_) else given
    return tuple(joint if isinstance(joint, str) else session.joints[joint] for joint in marked)


class Findings:
    """What a check sees run by run, and the runs that it leaves.

    Attributes:
        session: What is checked.
        runs: The runs that are left.
        reported: (run's name, what was seen there, a text), the most telling first.
        columns: Of the joints concerned.
    """

    def __init__(self, session: Session) -> None:
        self.session = session
        self.runs: list[Recording] = []
        self.reported: list[tuple[str, str]] = []
        self.columns: set[int] = set()

    def note(self, run: Recording, what: str, columns: Iterable[int] = ()) -> None:
        """Notes something seen in a run; what is noted first is what is reported.

        Args:
            run: The run.
            what: What was seen there, a text.
            columns: Indices of the joints concerned.
        """
        self.reported.append((run.name, what))
        self.columns.update(int(column) for column in columns)

    def issues(
        self, key: str, severity: Severity | None = None, **seen: Any
    ) -> list[TelemetryIssue]:
        """All that was seen as one issue, in the words of `issues.toml`.

        The first run's is reported, and in how many more there is something.

        Args:
            key: Row of `issues.toml`.
            severity: Another one than the row's.
            **seen: What the row's words name, beside `reported`.

        Returns:
            The one issue; empty if nothing was seen.
        """
        if not self.reported:
            return []
        run, what = self.reported[0]
        others = len({name for name, _ in self.reported}) - 1
        also = (
            f"; also in {others} of the other {len(self.session.runs) - 1} runs" if others else ""
        )
        named = self.session.replace(name=run)
        return [
            issue_of(
                key, named, sorted(self.columns), severity=severity, reported=what + also, **seen
            )
        ]

    def left(self) -> Session:
        """The session of the runs that are left; as it was where nothing was seen."""
        return self.session.replace(runs=self.runs) if self.reported else self.session


def check_accepted(accept: Sequence[str]) -> tuple[str, ...]:
    """The names of issues that are to be accepted, each once.

    Raises:
        InputError: A name that no refusal has.
    """
    for name in accept:
        if name not in WORDS["acceptable"]:
            raise InputError(
                "--accept",
                f"{name!r} can't be accepted",
                f"use one of: {', '.join(WORDS['acceptable'])}",
            )
    return tuple(dict.fromkeys(accept))


def overrule(
    report: TelemetryReport, accept: Sequence[str], reported: Sequence[str] = ()
) -> TelemetryReport:
    """A report in which some fatal issues are warnings.

    Args:
        report: The report.
        accept: Kinds of issues that the user accepts.
        reported: Kinds that what comes next reports itself.
    """

    def weaken(issue: TelemetryIssue) -> TelemetryIssue:
        if issue.severity != "fatal" or issue.issue not in (*accept, *reported):
            return issue
        said = (
            f"accepted by --accept {issue.issue}"
            if issue.issue in accept
            else "told, not refused, here"
        )
        return replace(issue, severity="warning", remedy=f"{said}; otherwise {issue.remedy}")

    return replace(report, issues=tuple(weaken(issue) for issue in report.issues))
