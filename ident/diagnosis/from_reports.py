"""From telemetry reports to a diagnosis.

Sessions that the check refuses, or that are too short, are not fitted.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ident.checks.report import MISREAD, TOO_LITTLE, TelemetryReport
from ident.diagnosis.diagnose import Analysis, diagnose
from ident.diagnosis.result import Diagnosis, Finding
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.effects.base import Effect
from ident.errors import RecordingError
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion, no_motion
from ident.motion.settings import MotionSettings
from ident.motion.stretches import Held, hold, within_band
from ident.progress import stage
from ident.recordings.recording import TelemetryIssue
from ident.regression.decimation import moved_inertia, prepare_slower
from ident.robot.arm import ArmModel

# What a finding's action takes for granted at some joints.
GUESSED = "; the drive gain of {} is a guess"
CHECK_GAIN = "; check the drive gain of {}, too: its torque is off by a factor"
MEND_FIRST = "; first mend the factor by which the torque of {} is off, for this size goes with it"


def diagnose_reports(
    reports: Iterable[TelemetryReport],
    arm: ArmModel,
    catalogue: Sequence[Effect],
    cutoff: float | None = None,
    seed: int = 0,
    model: HybridModel | None = None,
    settings: DiagnosisSettings = USUAL,
) -> tuple[Diagnosis, Analysis | None, Sequence[Motion]]:
    """Diagnoses inspected sessions of one set-up.

    Args:
        reports: Telemetry report of each session, or of each part of a long one; one without runs
            only adds issues.
        arm, catalogue: The robot, as `ArmModel.load` gives it, and the effects to test for.
        cutoff: Corner of the common low-pass filter [Hz]; if None, as the encoders' resolution
            allows, at most that of the settings (25 Hz).
        seed: Seed of the sign flips.
        model: The user's own model of this arm. Its identified inertias are taken as known, and its
            gap is reported beside that of the tuned one.
        settings: Thresholds and priors of all stages.

    Returns:
        The diagnosis, its intermediate results (None if nothing was fitted), and the motions.

    Raises:
        RecordingError: The sessions have different joints, or no run is long enough.
    """
    collected = _Collected()
    stage("reading, checking, smoothing", 0.0, 0.2)
    held = hold(_prepare_in_turn(reports, collected, cutoff, settings.motion))
    fatal = {issue.issue for issue in collected.issues if issue.severity == "fatal"}
    if fatal:
        verdict = "refused" if fatal - set(TOO_LITTLE) else "not_testable"
        issues = tuple(collected.issues)
        refused = Diagnosis(
            arm.name, arm.joint_names, verdict, collected.facts, issues, settings=settings
        )
        return refused, None, ()
    if not held.motions:
        raise no_motion(collected.session, settings.motion)
    arm = arm.keeping(collected.joints)
    if collected.gravity is not None:
        arm = arm.with_gravity(np.array(collected.gravity))
    motions = held.motions
    if cutoff is None:
        motions = within_band(motions, moved_inertia(arm, motions))
    if held.in_part:
        collected.issues.append(_used_in_part(held))
    share = None
    if model is not None and model.inertia != "nominal" and model.joint_names == arm.joint_names:
        arm = model.arm
        share = settings.regression.known_share
    analysis = diagnose(
        motions, arm, catalogue, collected.common_clock, collected.issues, seed, share, settings
    )
    if model is not None:
        from ident.diagnosis.user_model import with_own_model

        analysis = with_own_model(analysis, model)
    findings = [
        replace(finding, caveat=caveat_of(finding, collected.issues))
        for finding in analysis.diagnosis.findings
    ]
    diagnosis = replace(analysis.diagnosis, findings=tuple(findings), session=collected.facts)
    return diagnosis, replace(analysis, diagnosis=diagnosis), motions


def _used_in_part(held: Held) -> TelemetryIssue:
    """That a long session is not looked at as a whole."""
    used = sum(len(motion.time) for motion in held.motions)
    stretches = f"{len(held.motions)} stretches from all over the session"
    evidence = f"{used} of {held.samples} samples are used: {stretches}"
    remedy = "none needed; of what happens once (a push) give the hour in question alone"
    return TelemetryIssue("used_in_part", (), "note", evidence, remedy)


def caveat_of(finding: Finding, issues: Sequence[TelemetryIssue]) -> str:
    """What a finding's action takes for granted: a guessed drive gain, or a torque off by a factor.

    Args:
        finding: The finding.
        issues: What the check of the recordings told.

    Returns:
        Text that goes on behind the action, from a semicolon on; "" where nothing is taken for
        granted at its joints.
    """
    words = {"guessed_gains": GUESSED}
    change = finding.estimate.group.effect.as_change
    if not change.exact:  # an exact change may be that factor itself, and so may a body
        words[MISREAD] = CHECK_GAIN if change.body else MEND_FIRST
    caveats = []
    for kind, sentence in words.items():
        affected: set[str] = set()
        for issue in issues:
            if issue.issue == kind:
                affected.update(issue.joints)
        names = [name for name in finding.joints if name in affected]
        if names:
            caveats.append(sentence.format(", ".join(names)))
    return "".join(caveats)


def _no_facts() -> dict[str, float]:
    """Number of runs and samples, and duration [s], of nothing."""
    return {"runs": 0, "samples": 0, "duration_s": 0.0}


@dataclass(eq=False)
class _Collected:
    """Accumulates what telemetry reports have in common."""

    joints: tuple[str, ...] = ()  # joint names
    issues: list[TelemetryIssue] = field(default_factory=list)  # all issues so far
    # Number of runs and samples, and duration.
    facts: dict[str, float] = field(default_factory=_no_facts)
    common_clock: bool = True  # whether all runs are of one session whose clock continues
    session: Path | str = ""  # path or name of the last session
    # That of the first session [m/s²]; None for the URDF's.
    gravity: tuple[float, float, float] | None = None
    # Keys of the issues so far: parts of one session report a shared fault once.
    reported: set[tuple[str, str, tuple[str, ...], str]] = field(default_factory=set)

    def take(self, report: TelemetryReport) -> None:
        """Adds the report of one more session, or of one more part of a session.

        Raises:
            RecordingError: Its joints differ from those of the first session.
        """
        session = report.session
        where: str | Path = session.path or session.name
        self.gravity = self.gravity or session.gravity
        if session.runs:
            self.joints = self.joints or session.joints
            if session.joints != self.joints:
                raise RecordingError(
                    where, "its joints differ from those of the first session", "diagnose it alone"
                )
        self.common_clock &= session.common_clock and self.session in ("", where)
        self.session = where
        keys = [(str(where), issue.issue, issue.joints, issue.severity) for issue in report.issues]
        for key, issue in zip(keys, report.issues, strict=True):
            if key not in self.reported:
                self.issues.append(issue)
        self.reported.update(keys)
        self.facts["runs"] += len(session.runs)
        self.facts["samples"] += session.samples
        self.facts["duration_s"] += session.duration


def _prepare_in_turn(
    reports: Iterable[TelemetryReport],
    collected: _Collected,
    cutoff: float | None,
    settings: MotionSettings,
) -> Iterator[Motion]:
    """Motions of the sessions up to the first one with a fatal issue.

    Of later ones only issues are collected.
    """
    for report in reports:
        collected.take(report)
        if not any(issue.severity == "fatal" for issue in collected.issues):
            yield from prepare_slower(report.session, cutoff, settings)
        del report  # frees this part before the next is read
