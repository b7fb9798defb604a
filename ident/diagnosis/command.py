"""From paths to a diagnosis: refuses what the telemetry check refuses, and says what is too little to judge."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ident.arm import ArmModel
from ident.diagnosis.baseline import INERTIA_SHARE, KNOWN_SHARE
from ident.diagnosis.decimation import prepare_slower
from ident.diagnosis.diagnose import Analysis, Diagnosis, diagnose
from ident.diagnosis.own_model import with_own_model
from ident.effects.base import Effect
from ident.errors import RecordingError
from ident.hybrid import HybridModel
from ident.recording import TelemetryIssue
from ident.signals import Motion
from ident.spooling import hold
from ident.telemetry import TelemetryReport

# Effects live up to here; beyond it drives and structure answer [Hz].
CUTOFF = 25.0
# These findings mean that there is nothing wrong with the recordings but that they say too little.
TOO_LITTLE = ("too_few_runs", "insufficient_excitation")


def diagnose_reports(
    reports: Sequence[TelemetryReport],
    arm: ArmModel,
    catalogue: Sequence[Effect],
    cutoff: float | None = None,
    seed: int = 0,
    model: HybridModel | None = None,
) -> tuple[Diagnosis, Analysis | None, Sequence[Motion]]:
    """Diagnoses inspected sessions of one set-up.

    Args:
        reports: The telemetry check of each session.
        arm: The robot, as `ArmModel.load` gives it.
        catalogue: The effects to be asked for.
        cutoff: Corner of the common filter [Hz].
        seed: Of the sign flips.
        model: The user's own model of this arm: its identified inertias are taken as known, and its gap is told beside
            that of the tuned one.

    Returns:
        The diagnosis; all that was computed on the way, if anything was; the motions.

    Raises:
        RecordingError: The sessions have different joints.
    """
    issues = tuple(issue for report in reports for issue in report.issues)
    fatal = {issue.issue for issue in issues if issue.severity == "fatal"}
    if fatal - set(TOO_LITTLE):
        return _without_analysis("refused", reports, arm, issues), None, ()
    if fatal:
        return _without_analysis("not_testable", reports, arm, issues), None, ()
    joints = reports[0].session.joints
    for report in reports[1:]:
        if report.session.joints != joints:
            where: str | Path = report.session.path or report.session.name
            raise RecordingError(where, "its joints differ from those of the first session", "diagnose it alone")
    missing = [name for name in arm.joint_names if name not in joints]
    arm = arm.locked(missing) if missing else arm
    motions = hold(motion for report in reports for motion in prepare_slower(report.session, cutoff or CUTOFF))
    clock = len(reports) == 1 and reports[0].session.common_clock
    share = INERTIA_SHARE
    if model is not None and model.inertia != "nominal" and model.joint_names == arm.joint_names:
        arm, share = model.arm, KNOWN_SHARE
    analysis = diagnose(motions, arm, catalogue, clock, issues, seed, share)
    if model is not None:
        analysis = with_own_model(analysis, model)
    return analysis.diagnosis, analysis, motions


def _without_analysis(
    verdict: str, reports: Sequence[TelemetryReport], arm: ArmModel, issues: tuple[TelemetryIssue, ...]
) -> Diagnosis:
    sessions = [report.session for report in reports]
    facts = {
        "runs": sum(len(session.runs) for session in sessions),
        "samples": sum(session.samples for session in sessions),
        "duration_s": sum(session.duration for session in sessions),
    }
    return Diagnosis(arm.name, arm.joint_names, verdict, facts, issues)
