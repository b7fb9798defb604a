"""The order of the checks: each sees what the ones before it have mended."""

from __future__ import annotations

import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ident.checks.absent_joints import check_absent
from ident.checks.angles import mend_angle_units
from ident.checks.arrangement import check_bodies
from ident.checks.channels import check_clipping, check_commands, drop_stuck, drop_stuck_velocity
from ident.checks.clock import mend_clock_jumps, mend_order, split_at_gaps
from ident.checks.conventions.reread import as_it_is, read_conventions
from ident.checks.effort import collect_states
from ident.checks.effort_checks import check_effort
from ident.checks.effort_kind import judge_effort, mend_effort_kind
from ident.checks.excitation import Amount
from ident.checks.gains import Gains, check_gains
from ident.checks.information import mend_information
from ident.checks.lateness import check_lateness
from ident.checks.odd_runs import check_odd_runs
from ident.checks.ratings import check_placeholders, check_rating
from ident.checks.report import TelemetryReport, as_mounted, require_same_mount
from ident.checks.run_clocks import check_run_clocks
from ident.checks.sampling import check_rate, mend_jitter
from ident.checks.scales import check_scales
from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.checks.spikes import mend_absurd, mend_channel_spikes, mend_spikes
from ident.checks.time_base import (
    check_clock,
    check_stated_rate,
    is_clock_wrong,
    mend_time_base,
    mend_time_unit,
)
from ident.checks.urdf_faults import check_bodies_of_urdf
from ident.checks.velocity import mend_velocity
from ident.checks.wraps import mend_wraps, split_at_jumps
from ident.recordings.joint_names import match_joints
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.recordings.series import SearchedRun, Series
from ident.robot.arm import ArmModel

# Broken cells, which come from neither units nor signs.
DAMAGE = frozenset({"garbage_cells", "effort_spike"})


class Repeats:
    """Takes note of the runs that pass, and of those that hold an earlier one's series.

    In whatever form they hold it.
    """

    def __init__(self) -> None:
        self._known: dict[bytes, str] = {}
        self._series: dict[tuple[str, ...], list[tuple[str, Series]]] = defaultdict(list)
        self._told: list[str] = []

    def take(self, session: Session, report: TelemetryReport) -> None:
        """Takes note of one more session, or part of one, as it was read."""
        for run in session.runs:
            name = f"{session.name}/{run.name}"
            earlier = self._known.get(_mark(run)) or self._earlier(run)
            if earlier is not None and len(run):
                self._told.append(f"{name} is {earlier} once more")
                continue
            self._known[_mark(run)] = name
            if (series := Series.of(run)) is not None:
                self._series[series.joints].append((name, series))

    def _earlier(self, run: Recording) -> str | None:
        """Name of the run whose series this one holds, with other bytes."""
        searched = SearchedRun(run)
        known = self._series[searched.joints]
        return next((earlier for earlier, series in known if series.is_in(searched)), None)

    def issues(self) -> list[TelemetryIssue]:
        """One fatal issue that names the runs that were given twice; empty where none was."""
        if not self._told:
            return []
        more = f", and {len(self._told) - 1} more" if len(self._told) > 1 else ""
        return [
            TelemetryIssue(
                "repeated_session", (), "fatal", self._told[0] + more, "give every recording once"
            )
        ]


def _mark(run: Recording) -> bytes:
    """Of a run to the last bit, time included."""
    digest = hashlib.blake2b(digest_size=16)
    for values in (run.time, run.position, run.effort):
        digest.update(values.tobytes())
    return digest.digest()


Mending = Callable[[Session], tuple[Session, list[TelemetryIssue]]]


def inspect_sessions(
    sessions: Sequence[Session],
    arm: ArmModel | None = None,
    settings: TelemetrySettings = USUAL_TELEMETRY,
) -> tuple[TelemetryReport, ...]:
    """Checks sessions that are to be used together.

    Mends what can be mended safely, and compares them with the robot. What they lack together is
    reported with the first.

    Args:
        sessions: At least one, in their order.
        arm: Their robot; without it, what needs a model is not checked.
        settings: Thresholds.

    Returns:
        A report for each session, in their order, with the session as it was mended.

    Raises:
        RecordingError: No joint of the robot is recorded.
    """
    first, *others, together = _inspect_each(sessions, arm, settings)
    return replace(first, issues=(*first.issues, *together.issues)), *others


def inspect_parts(
    parts: Iterable[Session], arm: ArmModel, settings: TelemetrySettings = USUAL_TELEMETRY
) -> Iterator[TelemetryReport]:
    """Checks consecutive parts of sessions too long to be held, as `inspect_sessions` checks
    sessions.

    Each is let go before the next is read. What an earlier part of its session showed is not told
    again, unless it is fatal. What all parts lack together is told by a last report without runs.

    Args:
        parts: The parts, in their order.
        arm: Their robot.
        settings: Thresholds.

    Raises:
        RecordingError: No joint of the robot is recorded, or a part has other joints than the
            first.
    """
    reported: set[tuple[str, str, tuple[str, ...], str]] = set()

    def news(report: TelemetryReport) -> TelemetryReport:
        """The report without what is known of its session."""
        issues = []
        for issue in report.issues:
            where = str(report.session.path or report.session.name)
            key = (where, issue.issue, issue.joints, issue.severity)
            is_new = key not in reported
            if is_new or issue.severity == "fatal" or not report.session.runs:
                issues.append(issue)
            reported.add(key)
        return replace(report, issues=tuple(issues))

    # A map and a filter hold on to nothing that they have handed out.
    return filter(
        lambda report: report.session.runs or report.issues,
        map(news, _inspect_each(parts, arm, settings)),
    )


def _inspect_each(
    sessions: Iterable[Session], arm: ArmModel | None, settings: TelemetrySettings
) -> Iterator[TelemetryReport]:
    """A report of each session, or part of one, and a last one without runs.

    What they lack together or hold twice.

    Raises:
        RecordingError: Two of them are said to be mounted otherwise.
    """
    tallies = (Amount(settings.excitation), Repeats())
    gains = Gains()
    last = None
    for session in sessions:
        if arm is not None and last is not None:
            require_same_mount(arm, last.session, session)
        # The checks' matrices are small: threads of the linear algebra only get into each other's
        # way.
        with threadpool_limits(limits=1, user_api="blas"):
            report = inspect_alone(gains.in_first_unit(session), arm, settings)
            for tally in tallies:
                tally.take(session, report)
        # Later ones are held against the same arm.
        arm = None if arm is None else as_mounted(arm, report.session)
        last = TelemetryReport(report.session.replace(runs=()), (), report.arm)
        yield report
        del session, report
    if last is not None:
        with threadpool_limits(limits=1, user_api="blas"):
            issues = tuple(issue for tally in (*tallies, gains) for issue in tally.issues())
        yield replace(last, issues=issues)


def inspect_alone(
    session: Session, arm: ArmModel | None, settings: TelemetrySettings = USUAL_TELEMETRY
) -> TelemetryReport:
    """All checks but those that ask for the amount of data.

    Rows and columns first: each check sees what the ones before it left standing. Then the
    conventions of log and URDF are searched together, once, and what is left is held against the
    model under them.
    """
    issues = list(session.issues())
    absent: list[str] = []
    if arm is not None:
        session, matching = match_joints(session, arm.joint_names)
        issues += matching
        absent = [name for name in arm.joint_names if name not in session.joints]
        recorded = arm.locked(absent) if absent else arm
        arm = as_mounted(recorded.with_payload(session.payload), session)
    session, told = check_rows(_whole_rows(session), arm)
    issues += told
    if not session.samples or arm is None:
        issues += [] if not session.samples else _check_channels(session)
        return TelemetryReport(session, tuple(issues), arm)
    if not is_damaged(issues):
        session, told = check_odd_runs(session, arm)
        issues += told
    # Inertia and the bodies' places are part of every torque: where they are wrong, nothing else
    # can be read.
    misplaced = check_bodies(session, arm)
    if misplaced or is_damaged(issues) or is_clock_wrong(session, arm):
        reading = as_it_is(session, arm)
    else:
        reading = read_conventions(session, arm, settings.effort)
    session = reading.session
    arm = reading.arm
    judged = reading.judged
    issues += reading.issues
    session, told = mend_effort_kind(session, judged, reading.is_compensated, reading.guessed)
    has_clock = not any(
        issue.issue == "time_not_increasing" and issue.severity == "fatal" for issue in issues
    )
    issues += told + check_clock(session, judged) + (check_rate(session) if has_clock else [])
    issues += _check_channels(session) + check_bodies_of_urdf(session, arm)
    states = collect_states(session, judged, settings.effort, reading.guessed)
    issues += check_gains(session)
    if states is not None:
        # Each question is asked only where the ones before it left the torque its meaning.
        torque = misplaced + (check_absent(session, states, absent) if absent else [])
        torque += check_placeholders(session, arm) + check_lateness(session, judged)
        # A torque that is off at all joints by one factor is told once.
        in_model_unit = not any(
            issue.issue in ("mass_factor", "effort_not_torque") for issue in reading.issues
        )
        torque += check_rating(session, judged, states) if in_model_unit else []
        sound = not any(issue.severity == "fatal" for issue in torque)
        issues += torque + (check_effort(session, judged, states) if sound else [])
        if not any(issue.severity == "fatal" for issue in issues):
            # What rests on a wrong gain is said after it.
            issues = [*check_scales(session, states, judged), *issues]
    effort = judge_effort(session, states, issues)
    return TelemetryReport(session, tuple(issues), arm, effort, reading.conventions)


def is_damaged(issues: Sequence[TelemetryIssue]) -> bool:
    """Whether so many cells are broken that a run tells neither its units nor its signs."""
    return any(issue.severity == "fatal" and issue.issue in DAMAGE for issue in issues)


def check_rows(session: Session, arm: ArmModel | None) -> tuple[Session, list[TelemetryIssue]]:
    """Mends what is wrong with cells, rows and channels whatever the torque is, in a fixed order.

    Args:
        session: The recordings.
        arm: Their robot; None where it is not known.

    Returns:
        The session as it was mended (without samples where nothing is left), and all issues.
    """
    steps: tuple[Mending, ...] = (
        mend_absurd,
        mend_order,
        mend_clock_jumps,
        mend_time_unit,
        mend_channel_spikes,
        lambda session_so_far: mend_angle_units(session_so_far, arm),
        mend_spikes,
        lambda session_so_far: mend_wraps(session_so_far, arm),
        check_run_clocks,
        check_stated_rate,
        mend_time_base,
        mend_jitter,
        mend_information,
        drop_stuck,
        drop_stuck_velocity,
        lambda session_so_far: split_at_jumps(session_so_far, arm),
        split_at_gaps,
        mend_velocity,
    )
    issues: list[TelemetryIssue] = []
    for step in steps:
        if not session.samples:
            break
        session, told = step(session)
        session = _without_empty(session)
        issues += told
    return session, issues


def _check_channels(session: Session) -> list[TelemetryIssue]:
    """What the channels show of themselves, without a model."""
    return check_clipping(session) + check_commands(session)


def _whole_rows(session: Session) -> Session:
    """The rows of which every cell is finite."""
    runs = []
    for run in session.runs:
        rows = np.isfinite(run.time)
        for values in run.channels().values():
            rows &= np.isfinite(values).all(axis=1)
        runs.append(run if rows.all() else run.at(rows))
    return _without_empty(session.replace(runs=runs))


def _without_empty(session: Session) -> Session:
    """Runs of which no row is left are none.

    Where nothing is left at all, the first still tells the joints.
    """
    return session.replace(runs=[run for run in session.runs if len(run)] or session.runs[:1])
