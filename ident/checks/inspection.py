"""The order of the checks: each sees what the ones before it have mended."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from ident.checks.angles import mend_degrees, mend_spikes, mend_wraps, split_at_jumps
from ident.checks.channels import check_clipping, check_commands, drop_stuck
from ident.checks.clock import mend_clock_jumps, mend_jitter, mend_order, split_at_gaps
from ident.checks.effort import States, check_effort, collect_states
from ident.checks.effort_kind import judge_effort, mend_effort_kind
from ident.checks.excitation import Amount
from ident.checks.motion import mend_time_base, mend_time_unit, mend_velocity
from ident.checks.mount import mend_mount
from ident.checks.permuted import check_order
from ident.checks.repeated import find_repeated
from ident.checks.report import TelemetryReport, as_mounted
from ident.checks.scale import check_absent, check_gains, check_rating, check_scales, compare_gains
from ident.checks.settings import USUAL_TELEMETRY, TelemetrySettings
from ident.checks.spikes import mend_absurd, mend_channel_spikes
from ident.recordings.joint_names import match_joints
from ident.recordings.recording import Recording, Session, TelemetryIssue
from ident.robot.arm import ArmModel

Mending = Callable[[Session], tuple[Session, list[TelemetryIssue]]]


def inspect(session: Session, arm: ArmModel | None = None) -> TelemetryReport:
    """Checks a session, mends what can be mended safely, and compares it with the robot's model where one is given.

    Args:
        session: The recordings as read.
        arm: The robot, without the session's payload.

    Returns:
        The issues, the mended session in the robot's joints, and the robot as the session needs it.

    Raises:
        RecordingError: No joint of the robot is recorded.
    """
    return inspect_sessions([session], arm)[0]


def inspect_sessions(
    sessions: Sequence[Session], arm: ArmModel | None = None, settings: TelemetrySettings = USUAL_TELEMETRY
) -> tuple[TelemetryReport, ...]:
    """Checks sessions that are to be used together: whether there is enough motion is asked of all of them at once."""
    # The checks' matrices are small: threads of the linear algebra only get into each other's way.
    with threadpool_limits(limits=1, user_api="blas"):
        reports: list[TelemetryReport] = []
        for session in sessions:
            reports.append(inspect_alone(session, arm, settings))
            arm = arm if arm is None else as_mounted(arm, reports[-1].session)
        amount = Amount(settings=settings.excitation)
        for report in reports:
            amount.take(report.session, report.arm)
        also = (*amount.issues(), *find_repeated(sessions), *compare_gains(sessions))
        first = replace(reports[0], issues=(*reports[0].issues, *also))
        return (first, *reports[1:])


def inspect_alone(
    session: Session, arm: ArmModel | None, settings: TelemetrySettings = USUAL_TELEMETRY
) -> TelemetryReport:
    """All checks but those that ask for the amount of data."""
    issues, absent = list(session.issues()), list[str]()
    if arm is not None:
        session, matching = match_joints(session, arm.joint_names)
        issues += matching
        absent = [name for name in arm.joint_names if name not in session.joints]
        arm = as_mounted((arm.locked(absent) if absent else arm).with_payload(session.payload), session)
    session = _without_empty(session.replace(runs=[_without_nan(run) for run in session.runs]))
    if not session.samples:
        return TelemetryReport(session, tuple(issues), arm)

    def mount(found: Session) -> tuple[Session, list[TelemetryIssue]]:
        nonlocal arm
        if arm is None:
            return found, []
        arm, turned = mend_mount(found, arm)
        return (found.replace(gravity=tuple(arm.model.gravity.linear.tolist())) if turned else found), turned

    steps: tuple[Mending, ...] = (
        mend_absurd,
        mend_order,
        mend_clock_jumps,
        mend_time_unit,
        mend_channel_spikes,
        lambda found: mend_degrees(found, arm),
        mend_spikes,
        lambda found: mend_wraps(found, arm),
        # Before the torque is held against the model in any other way.
        mount,
        # Before gravity and inertia are held against each other for the time base.
        lambda found: mend_effort_kind(found, arm),
        lambda found: mend_time_base(found, arm),
        mend_jitter,
        drop_stuck,
        split_at_jumps,
        split_at_gaps,
        mend_velocity,
    )
    for step in steps:
        session, found = step(session)
        session = _without_empty(session)
        issues += found
        if not session.samples:
            return TelemetryReport(session, tuple(issues), arm)
    issues += check_clipping(session) + check_commands(session)
    if arm is None:
        return TelemetryReport(session, tuple(issues), arm)
    states = collect_states(session, arm, settings.effort)
    issues += check_gains(session)
    if states is not None:
        issues += _check_torque(session, arm, states, absent)
        if not any(issue.severity == "fatal" for issue in issues):
            issues = [*check_scales(session, states), *issues]  # what rests on a wrong gain is said after it
    return TelemetryReport(session, tuple(issues), arm, judge_effort(session, states, issues))


def _check_torque(session: Session, arm: ArmModel, states: States, absent: list[str]) -> list[TelemetryIssue]:
    """What the torque is: each question is asked only where the ones before it left the torque its meaning."""
    found = check_absent(session, states, absent) if absent else []
    found += check_rating(session, arm) or check_order(session, arm, states)
    return found if any(issue.severity == "fatal" for issue in found) else found + check_effort(session, arm, states)


def _without_empty(session: Session) -> Session:
    """Runs of which no row is left are none; where nothing is left at all, the first still tells the joints."""
    return session.replace(runs=[run for run in session.runs if len(run)] or session.runs[:1])


def _without_nan(run: Recording) -> Recording:
    """The rows in which every cell is a number."""
    whole = np.isfinite(run.time)
    for values in run.channels().values():
        whole &= np.isfinite(values).all(axis=1)
    return run if whole.all() else run.at(whole)
