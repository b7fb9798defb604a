"""From telemetry reports of two sets to a comparison.

Sets that the check refuses are not compared.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ident.checks.report import MISREAD, TelemetryReport
from ident.diagnosis.change.compare import compare
from ident.diagnosis.change.gain_uncertainty import BY_CURRENT, STATED
from ident.diagnosis.change.result import ArmComparison, Side
from ident.diagnosis.change.settings import CHANGE
from ident.errors import RecordingError
from ident.motion.filter import Lowpass
from ident.motion.motion import Motion, no_motion
from ident.motion.settings import FOR_DIAGNOSIS
from ident.motion.stretches import choose_runs, within_band
from ident.progress import stage
from ident.recordings.recording import Session, TelemetryIssue
from ident.regression.decimation import moved_inertia, prepare_slower
from ident.robot.arm import ArmModel


def compare_reports(
    before: Sequence[TelemetryReport],
    after: Sequence[TelemetryReport],
    arm: ArmModel,
    cutoff: float | None = None,
    seed: int = 0,
) -> ArmComparison:
    """Compares two sets of inspected sessions.

    Args:
        before, after: Telemetry reports of the sessions of each set.
        arm: The robot, as `ArmModel.load` gives it.
        cutoff: Corner of the common low-pass filter [Hz]; if None, as the encoders' resolution of
            both sets allows, at most 25 Hz.
        seed: Seed of the permutations of runs.

    Raises:
        RecordingError: The sessions have different joints, no run of a set is long enough, or the
        corner is too high.
    """
    stage("smoothing", 0.0, 0.1)
    reports = [*before, *after]
    told = [issue for report in reports for issue in report.issues]
    issues = tuple(as_compared(issue, before, after) for issue in told)
    sides = (_side(before), _side(after))
    fatal = {issue.issue for issue in issues if issue.severity == "fatal"}
    if fatal:
        verdict = "refused" if fatal - {"too_few_runs"} else "not_testable"
        return ArmComparison(arm.name, arm.joint_names, verdict, sides, issues)
    joints = reports[0].session.joints
    for report in reports:
        if report.session.joints != joints:
            where = report.session.path or report.session.name
            raise RecordingError(
                where, "its joints differ from those of the first session", "compare it alone"
            )
    sets = _motions(before, after, arm, cutoff)
    runs = [run for report in reports for run in report.session.runs]
    has_currents = any(run.current is not None for run in runs)
    gain_uncertainty = BY_CURRENT if has_currents else STATED
    comparison = compare(*sets, arm.keeping(joints), sides, seed, gain_uncertainty=gain_uncertainty)
    weighed = tuple(as_explained(issue, before, comparison) for issue in issues)
    return replace(comparison, telemetry=weighed, cutoff=sets[0][0].lowpass.cutoff)


def _motions(
    before: Sequence[TelemetryReport],
    after: Sequence[TelemetryReport],
    arm: ArmModel,
    cutoff: float | None,
) -> tuple[list[Motion], list[Motion]]:
    """The runs of both sets through one filter: different ones would look like a change."""
    joints = before[0].session.joints
    runs = [run for report in (*before, *after) for run in report.session.runs]
    slowest = min(1.0 / run.sample_interval for run in runs if len(run) > 1)
    corner = Lowpass.design(slowest, cutoff, FOR_DIAGNOSIS).cutoff
    motions: Sequence[Motion] = []
    for side in (before, after):
        of_side: list[Motion] = []
        for report in side:
            of_side += prepare_slower(report.session, corner)
        if not of_side:
            raise no_motion(side[0].session.path or side[0].session.name)
        earlier = len(motions)
        stride = -(-len(of_side) // CHANGE.most_runs)
        chosen = [of_side[k] for k in choose_runs(len(of_side), stride)]
        motions = [*motions, *chosen]
    if cutoff is None:
        motions = within_band(motions, moved_inertia(arm.keeping(joints), motions))
    return list(motions[:earlier]), list(motions[earlier:])


def as_compared(
    issue: TelemetryIssue, before: Sequence[TelemetryReport], after: Sequence[TelemetryReport]
) -> TelemetryIssue:
    """An issue with its severity for a comparison.

    A fault that is the same before and after is no change.
    Torque that does not follow the model in either set may be due to a URDF of guessed masses;
    joints that stand still show torque beyond their static friction.

    Args:
        issue: One of either set.
        before, after: Telemetry reports of each set.

    Returns:
        The same object, or a warning in place of a fatal issue.
    """
    if issue.severity != "fatal":
        return issue
    in_both = _is_fatal(issue.issue, before) and _is_fatal(issue.issue, after)
    if issue.issue == "effort_not_torque" and in_both:
        alike = "before and after alike: sizes in kg are as right as the URDF's masses"
        return replace(issue, severity="warning", remedy=f"{issue.remedy}; {alike}")
    if issue.issue == "insufficient_excitation":
        return replace(issue, severity="warning")
    return issue


def _is_fatal(kind: str, reports: Sequence[TelemetryReport]) -> bool:
    """Whether an issue of a kind is fatal in any of some sessions."""
    issues = [issue for report in reports for issue in report.issues]
    return any(issue.issue == kind and issue.severity == "fatal" for issue in issues)


def as_explained(
    issue: TelemetryIssue, before: Sequence[TelemetryReport], comparison: ArmComparison
) -> TelemetryIssue:
    """An issue with its severity beside what changed.

    A torque that is off by a factor in the later set is a note where a change of load or gain is
    why. What the earlier set read stays a warning: the later reads so much of it, too.

    Args:
        issue: One of either set.
        before: Telemetry reports of the earlier set.
        comparison: What changed.
    """
    explained: set[str] = set()
    for change in comparison.changes:
        kind = change.estimate.group.effect.as_change
        if kind.body or kind.exact:
            explained.update(change.rms_before)
    earlier = any(issue in report.issues for report in before)
    if issue.issue != MISREAD or earlier or not explained.issuperset(issue.joints):
        return issue
    return replace(
        issue,
        severity="note",
        remedy="none needed: what changed explains it, beyond what the earlier set reads",
    )


def _side(reports: Sequence[TelemetryReport]) -> Side:
    """What one set of recordings consists of: its sessions, how long they are, loads, gravity."""
    sessions = [report.session for report in reports]
    return Side(
        sessions=tuple(session.name for session in sessions),
        runs=sum(len(session.runs) for session in sessions),
        samples=sum(session.samples for session in sessions),
        duration_s=sum(session.duration for session in sessions),
        payload_kg=tuple(_payload_kg(session) for session in sessions),
        gravity_mps2=sessions[0].gravity if sessions else None,
    )


def _payload_kg(session: Session) -> float:
    """The load at the flange that session.toml names [kg]."""
    return 0.0 if session.payload is None else session.payload.mass_kg
