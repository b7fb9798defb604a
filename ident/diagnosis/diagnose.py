"""The whole diagnosis: from smoothed motions and an arm to a verdict with its evidence.

tune the arm -> sum the columns of all candidates -> infer causes -> measure what is left -> verdict
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.diagnosis.baseline_record import TunedJoint, tuned_alone, tuned_beside
from ident.diagnosis.detection_limits import SizeLimit, find_limits
from ident.diagnosis.gap.gap_map import Place, View, map_gap
from ident.diagnosis.gap.improvement import energy_spread
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.identified import IdentifiedNumbers, SolvedSession, identify
from ident.diagnosis.remaining import (
    FIXED_URDF_FACTOR,
    Models,
    Remaining,
    find_places,
    joint_gaps,
    measure_remaining,
    reported_causes,
)
from ident.diagnosis.reservations import (
    link_reservations,
    replay_reservation,
    unlikely_reservations,
)
from ident.diagnosis.result import Details, Diagnosis, Finding, HeldOutGain
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.verdict import decide, score_outside
from ident.effects import optional
from ident.effects.base import Effect, SessionContext
from ident.inference.conclusion import EVEN_ODDS, Conclusion, Named, conclude
from ident.inference.revision import evidence_of
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.motion.stretches import runs_recorded
from ident.progress import stage
from ident.recordings.recording import TelemetryIssue
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.design import NotTestable, build_layout
from ident.regression.discrepancy import KINDS, unusual_torque
from ident.regression.dwells import HeldFriction
from ident.regression.gather import gather
from ident.regression.gram import Evidence
from ident.regression.least_squares import project
from ident.regression.run_spread import measure_inflation
from ident.regression.runs import build_session, leftover_torque
from ident.robot.arm import ArmModel
from ident.robot.names import robot_argument


@dataclass(frozen=True, eq=False)
class Analysis:
    """The diagnosis with its intermediate results, for reports, the next experiment and patches."""

    baseline: Baseline
    session: SessionContext
    evidence: Evidence
    conclusion: Conclusion
    series: tuple[RunResidual, ...]
    diagnosis: Diagnosis


def diagnose(
    motions: Sequence[Motion],
    arm: ArmModel,
    catalogue: Sequence[Effect],
    common_clock: bool = True,
    telemetry: Sequence[TelemetryIssue] = (),
    seed: int = 0,
    inertia_share: float | None = None,
    settings: DiagnosisSettings = USUAL,
) -> Analysis:
    """Diagnoses a session.

    Args:
        motions, catalogue: All runs, smoothed, and the effects to test for.
        arm: The user's arm, without payload.
        common_clock: Whether the clock continues from run to run.
        telemetry, seed: Issues of the telemetry check, for the record; seed of random draws.
        inertia_share: Standard deviation of the arm's inertias as a share of each link's scale;
            that of a URDF if None.
        settings: Thresholds and priors of all stages.
    """
    stage("tuning the arm", 0.2, 0.35)
    baseline = fit_baseline(
        motions, arm, inertia_share, settings.regression, still_joints(motions, arm)
    )
    session = build_session(baseline, motions, common_clock)
    stage("torques of every law", 0.35, 0.6)
    evidence, untestable = sum_candidates(session, baseline, catalogue)
    stage("weighing causes", 0.6, 0.9)
    conclusion = conclude(evidence, baseline, session)
    stage("what is left, and what could have been seen", 0.9, 1.0)
    models = Models.of(conclusion)
    remaining = measure_remaining(conclusion, models, session, baseline, settings, seed)
    limits = find_limits(conclusion, session)
    maps = _map(remaining, models, arm, seed, settings)
    findings = _findings(conclusion, arm, remaining, models)
    judged = sum(int(item.valid.sum()) for item in remaining.series)
    verdict = decide(conclusion.names, remaining.gap_probability, judged)
    old = conclusion.ladder[0].rms
    new = conclusion.ladder[-1].rms
    shrink = measure_shrink(old, new, remaining.floors) if findings else 0.0
    causes = reported_causes(arm, remaining, findings, telemetry)
    places = find_places(arm, maps, models, remaining, causes, settings)
    far = replay_reservation(
        remaining.improvement.forward,
        remaining.series,
        arm.joint_names,
        new,
        remaining.floors,
        settings,
    )
    tuned_joints = _tuned_joints(conclusion, baseline, models)
    identified = _identify(conclusion, baseline, session, remaining, tuned_joints)
    diagnosis = Diagnosis(
        robot=arm.name,
        robot_option=robot_argument(arm.name, arm.source, arm.tip),
        joints=arm.joint_names,
        verdict=verdict,
        session=_facts(motions),
        telemetry=tuple(telemetry),
        gap=joint_gaps(arm, models, remaining) if judged else {},
        where=() if verdict == "no_gap" else places,
        findings=findings,
        heldout=HeldOutGain(old, new, shrink, remaining.improvement),
        not_testable=(*untestable, *_hidden(limits, arm)),
        reservations=(
            *unlikely_reservations(conclusion.unlikely, arm.joint_names),
            *link_reservations(remaining.links),
            *far,
        ),
        details=Details(
            detectable=limits,
            maps=maps["before"],
            maps_fixed=maps["fixed"],
            baseline=tuned_joints,
            baseline_alone=tuned_alone(baseline, models.evidence, models.before),
            baseline_urdf=tuned_alone(baseline, models.evidence, models.fixed),
            outside_score=score_outside(remaining.gap_probability),
            leftover=remaining.gap_probability,
            tuned_links=remaining.links,
            identified=identified,
        ),
        catalogue=tuple(catalogue),
        settings=settings,
    )
    return Analysis(
        baseline,
        session,
        conclusion.evidence,
        remaining.conclusion,
        remaining.series,
        diagnosis,
    )


def still_joints(motions: Sequence[Motion], arm: ArmModel) -> list[int]:
    """Indices of the joints that stand still in all runs."""
    moving = np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)
    return [j for j in range(arm.n) if moving[j] < LEAST_MOVING]


def sum_candidates(
    session: SessionContext, baseline: Baseline, catalogue: Sequence[Effect]
) -> tuple[Evidence, tuple[NotTestable, ...]]:
    """Block sums of every candidate's columns and of discrepancies, and what can't be tested.

    Args:
        session, baseline, catalogue: The runs, the tuned model, and the effects to test for.
    """
    unusual = unusual_torque(session, leftover_torque(session))
    screened = [optional.screened(effect, session, unusual) for effect in catalogue]
    rank = baseline.base.rank
    layout = build_layout(session, rank, screened, beside=(HeldFriction(),), flexible=KINDS)
    return gather(session, baseline, layout, rest=True).with_dwells(), layout.silent


def _facts(motions: Sequence[Motion]) -> dict[str, float]:
    """Number of runs and samples, and duration."""
    return {
        "runs": runs_recorded(motions),
        "samples": int(sum(len(motion.time) for motion in motions)),
        "duration_s": float(sum(motion.time[-1] - motion.time[0] for motion in motions)),
    }


def _map(
    remaining: Remaining, models: Models, arm: ArmModel, seed: int, settings: DiagnosisSettings
) -> dict[View, list[Place]]:
    """Cells of the gap's map."""
    whitening = models.evidence.whitening
    level = np.minimum(whitening.level, remaining.noise)
    return map_gap(
        remaining.series,
        arm.joint_names,
        replace(whitening, level=level),
        np.random.default_rng(seed),
        settings=settings.gap.map,
    )


def _hidden(limits: Sequence[SizeLimit], arm: ArmModel) -> tuple[NotTestable, ...]:
    """Effects that noise or the URDF's tolerance hides at any plausible size."""
    hidden = [limit for limit in limits if limit.hidden and limit.bound_by != "size"]
    return tuple(limit.untestable(arm.joint_names) for limit in hidden)


def _tuned_joints(
    conclusion: Conclusion, baseline: Baseline, models: Models
) -> dict[str, TunedJoint]:
    """The baseline's parameters beside the names."""
    estimates = [name.estimate for name in conclusion.names]
    if not estimates:
        return tuned_alone(baseline, models.evidence, models.before)
    return tuned_beside(baseline, models.evidence, conclusion.prior, estimates)


def _identify(
    conclusion: Conclusion,
    baseline: Baseline,
    session: SessionContext,
    remaining: Remaining,
    joints: dict[str, TunedJoint],
) -> IdentifiedNumbers:
    """What the URDF says beside what the recordings say, from the sums of all candidates."""
    best = conclusion.inference.best
    evidence = evidence_of(best.model)
    prior = best.model.prior()
    groups = [name.described.coarse for name in conclusion.names]
    gram = evidence.gram()
    tuned = project(gram, evidence, prior, groups)
    given = prior.tightened(FIXED_URDF_FACTOR * prior.error.scale)
    return identify(
        SolvedSession(
            baseline=baseline,
            session=session,
            evidence=evidence,
            prior=prior,
            tuned=tuned,
            fixed=project(gram, evidence, given, groups),
            joints=joints,
            links=remaining.links,
            estimates=[name.estimate for name in conclusion.names],
            series=remaining.series,
            inflation=measure_inflation(evidence, tuned),
        )
    )


def _findings(
    conclusion: Conclusion, arm: ArmModel, remaining: Remaining, models: Models
) -> tuple[Finding, ...]:
    """The names: those likelier than all others of their class first, then what closes most."""
    improvement = remaining.improvement
    findings = []
    for k, (name, share) in enumerate(zip(conclusion.names, improvement.shares, strict=True)):
        finding = _finding(name, conclusion.groups[:k], arm, remaining, models)
        findings.append(replace(finding, share=float(share)))
    return tuple(sorted(findings, key=_place_of))


def _place_of(finding: Finding) -> tuple[bool, float]:
    """By what findings are sorted."""
    return finding.estimate.probability < EVEN_ODDS, -finding.closed


def _finding(
    name: Named, before: Sequence, arm: ArmModel, remaining: Remaining, models: Models
) -> Finding:
    """One name with what it closes beside those before it.

    Of one that tuned inertias hide that is judged against the URDF as it is.
    """
    joints = arm.joint_names
    acts = name.affected_joints
    sides = (name.before, name.after)
    if name.absorbed:
        sides = (models.given.score(before), models.given.score([*before, name.group]))
    old, new = (side.rms for side in sides)
    improvement = remaining.improvement
    places = name.estimate.places
    return Finding(
        estimate=name.estimate,
        evaluated=name,
        joints=tuple(joints[j] for j in name.named_joints),
        rms_before={joints[j]: float(old[j]) for j in acts},
        rms_after={joints[j]: float(new[j]) for j in acts},
        energy_before=float(improvement.energy_before[acts].sum()),
        energy_after=float(improvement.energy_after[acts].sum()),
        energy_std=(
            energy_spread(improvement.runs_before[:, acts]),
            energy_spread(improvement.runs_after[:, acts]),
        ),
        shrink=measure_shrink(old[acts], new[acts], remaining.floors[acts]),
        share=0.0,
        elsewhere=tuple((name.group.effect.id, joints[j]) for j in places),
        slides=slides(name.group, arm),
    )
