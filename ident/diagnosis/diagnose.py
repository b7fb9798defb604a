"""The whole diagnosis: from smoothed motions and an arm to a verdict with its evidence.

The steps: tune the arm (inertias and losses); sum the columns of all candidate effects over blocks; select effects;
test them against a discrepancy; add wrong links; then measure residuals, held-out gains, detection limits and the gap's
map.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.alternate import Selection, keep_effects, select_effects
from ident.diagnosis.baseline_record import tuned_alone, tuned_beside
from ident.diagnosis.detection_limits import find_limits
from ident.diagnosis.gap.gap_map import map_gap
from ident.diagnosis.gap.improvement import energy_spread
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.identified import Solved, identify
from ident.diagnosis.named_links import name_wrong_links
from ident.diagnosis.remaining import Models, Remaining, find_places, joint_gaps, measure_remaining
from ident.diagnosis.reservations import joints_of, link_reservations, replay_reservation
from ident.diagnosis.result import Details, Diagnosis, Finding, HeldOutGain
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.selection.name_probability import Estimate
from ident.diagnosis.selection.search import Search
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.verdict import (
    decide,
    discount_by_discrepancy,
    find_nearest,
    score_outside,
)
from ident.effects.base import Effect, SessionContext
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.motion.stretches import runs_recorded
from ident.progress import stage
from ident.recordings.recording import TelemetryIssue
from ident.regression.baseline import Baseline, fit_baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, build_layout
from ident.regression.discrepancy import unusual_torque
from ident.regression.dwells import HeldFriction
from ident.regression.gram import Evidence, gather
from ident.regression.least_squares import Prior, project
from ident.regression.posterior import Beside, LeftAtJoint, Posterior, measure_dispersion
from ident.regression.runs import build_session, leftover_torque
from ident.robot.arm import ArmModel
from ident.robot.names import robot_argument

# Reason that an effect is rejected for if a discrepancy explains its torque at about the same cost.
NOT_BEYOND_DISCREPANCY = (
    "a flexible function of the joint's state explains as much at about the same cost, so it may be no such law"
)


@dataclass(frozen=True, eq=False)
class Analysis:
    """The diagnosis with its intermediate results, for reports, the next experiment and patches."""

    baseline: Baseline
    session: SessionContext
    evidence: Evidence
    search: SearchResults
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
        telemetry, seed: Issues of the telemetry check, for the record; seed of the sign flips.
        inertia_share: Standard deviation of the arm's inertias as a share of each link's scale; that of a URDF if None.
        settings: Thresholds and priors of all stages.
    """
    stage("tuning the arm", 0.2, 0.35)
    static = [j for j in range(arm.n) if sum(int(motion.moving[:, j].sum()) for motion in motions) < LEAST_MOVING]
    baseline = fit_baseline(motions, arm, inertia_share, settings.regression, static)
    session = build_session(baseline, motions, common_clock)
    unusual = unusual_torque(session, leftover_torque(session))
    screened = [effect.screened(session, unusual) for effect in catalogue]
    layout = build_layout(session, baseline.base.rank, screened, beside=(HeldFriction(),))
    stage("torques of every law", 0.35, 0.6)
    evidence = gather(session, baseline, layout, rest=True).with_dwells()
    prior = Prior.of(evidence, baseline.prior)
    alone = Posterior.gather(session, baseline, evidence, prior.error)
    evidence = evidence.with_dispersion(measure_dispersion(alone))
    stage("searching for laws", 0.6, 0.9)
    first = Search(evidence, prior, HeldOut(evidence, prior), seed, settings=settings.selection)
    found_laws = select_effects(first, session, baseline)
    selected, beside = _test_against_discrepancy(found_laws, alone, session, baseline, settings)
    selected = name_wrong_links(selected, session, baseline, settings.verdict)
    stage("what is left, and what could have been seen", 0.9, 1.0)
    models = Models.of(selected)
    remaining = measure_remaining(selected, models, beside.left, beside.explained, session, baseline, settings)
    limits = find_limits(selected.search, selected.found, (models.after, models.after_fixed), models.inflation, session)
    whitening = models.evidence.whitening
    maps = map_gap(
        remaining.series,
        arm.joint_names,
        replace(whitening, level=np.minimum(whitening.level, remaining.noise)),
        np.random.default_rng(seed),
        settings=settings.gap.map,
    )
    found, laws = selected.found, len(beside.laws)  # the effects after these are link errors
    discounted = discount_by_discrepancy(selected.estimates[:laws], beside.laws, settings.verdict)
    estimates = (*discounted, *selected.estimates[laws:])
    findings = _findings(found, estimates, arm, remaining, models.given, settings)
    old, new = found.ladder[0].rms, found.ladder[-1].rms
    shrink = measure_shrink(old, new, remaining.floors) if found.accepted else 0.0
    verdict = decide(
        found,
        estimates,
        remaining.excess.present,
        remaining.noise,
        remaining.tolerance,
        models.with_fixed_inertias,
        settings.verdict,
    )
    far = replay_reservation(
        remaining.improvement.forward, remaining.series, arm.joint_names, new, remaining.floors, settings
    )
    tuned_joints = (
        tuned_beside(baseline, selected.fine, selected.estimates)
        if selected.fine
        else tuned_alone(baseline, models.evidence, models.after)
    )
    identified = identify(
        Solved(
            baseline=baseline,
            session=session,
            evidence=models.evidence,
            prior=selected.search.prior,
            tuned=models.after,
            fixed=project(models.evidence.gram(), models.evidence, models.given.prior, models.groups),
            joints=tuned_joints,
            links=remaining.links,
            estimates=estimates,
            series=remaining.series,
            inflation=models.inflation,
        )
    )
    diagnosis = Diagnosis(
        robot=arm.name,
        robot_option=robot_argument(arm.name, arm.source, arm.tip),
        joints=arm.joint_names,
        verdict=verdict,
        session={
            "runs": runs_recorded(motions),
            "samples": int(sum(len(motion.time) for motion in motions)),
            "duration_s": float(sum(motion.time[-1] - motion.time[0] for motion in motions)),
        },
        telemetry=tuple(telemetry),
        gap=joint_gaps(arm, models, remaining),
        where=() if verdict == "no_gap" else find_places(arm, maps, models, remaining, findings, telemetry, settings),
        findings=findings,
        heldout=HeldOutGain(old, new, shrink, remaining.improvement),
        not_testable=(
            *layout.silent,
            *(one.untestable(arm.joint_names) for one in limits if one.hidden and one.bound_by != "size"),
        ),
        reservations=(*selected.reservations, *link_reservations(remaining.links), *far),
        details=Details(
            nearest=find_nearest(found, arm.joint_names),
            detectable=limits,
            maps=maps["before"],
            maps_fixed=maps["fixed"],
            baseline=tuned_joints,
            baseline_alone=tuned_alone(baseline, models.evidence, models.before),
            baseline_urdf=tuned_alone(baseline, models.evidence, models.fixed),
            outside_score=score_outside(verdict, estimates, shrink, remaining.excess.leftover),
            leftover=remaining.excess.leftover,
            tuned_links=remaining.links,
            identified=identified,
        ),
        catalogue=tuple(catalogue),
        settings=settings,
    )
    return Analysis(baseline, session, models.evidence, found, remaining.series, diagnosis)


@dataclass(frozen=True, eq=False)
class _Discrepancies:
    """What discrepancies (flexible functions of each joint's state) explain of a session."""

    left: tuple[LeftAtJoint | None, ...]  # by joint, beside the effects; None where it does not move
    explained: Float[Array, " n"]  # share of each joint's mean square that they explain in place of the effects
    laws: tuple[Beside, ...]  # of each effect its evidence beside them, when all were tested together


def _test_against_discrepancy(
    selected: Selection, alone: Posterior, session: SessionContext, baseline: Baseline, settings: DiagnosisSettings
) -> tuple[Selection, _Discrepancies]:
    """Drops effects that a discrepancy explains at about the same cost, and returns the rest with the tests.

    All effects are tested together, so that one that is dropped does not count against its neighbours. An effect's
    class may be less probable without those that were dropped.

    Args:
        selected, alone: The effects, and discrepancies alone.
        session, baseline, settings: The runs, the tuned model, and thresholds.
    """
    search = selected.search
    posterior = alone.revised(search.evidence, baseline, search.prior.error)
    posterior, names = _with_names(posterior, selected, session, baseline)
    laws = [
        posterior.law(name, [other for other in names if other is not name], item.affected_joints)
        for name, item in zip(names, selected.found.accepted, strict=True)
    ]
    while True:
        estimates = discount_by_discrepancy(selected.estimates, laws, settings.verdict)
        kept = [k for k, one in enumerate(estimates) if one.class_probability >= settings.verdict.even_odds]
        if len(kept) == len(estimates):
            break
        laws = [laws[k] for k in kept]
        selected = keep_effects(selected, kept, session, baseline, NOT_BEYOND_DISCREPANCY)
    posterior, names = _with_names(posterior, selected, session, baseline)
    moving, explained = set(np.flatnonzero(search.evidence.samples).tolist()), np.zeros(session.n)
    acting = {j for item in selected.found.accepted for j in item.affected_joints}
    left = tuple(posterior.left_at(j, names) if j in moving | acting else None for j in range(session.n))
    for j in acting:
        explained[j] = posterior.left_at(j, ()).share
    return selected, _Discrepancies(left, explained, tuple(laws))


def _with_names(
    posterior: Posterior, selected: Selection, session: SessionContext, baseline: Baseline
) -> tuple[Posterior, list[Group]]:
    """A posterior with columns of the effects at their refined points, the same if it has them, and these."""
    points, search = [estimate.refined for estimate in selected.estimates], selected.search
    if not set(points) <= set(posterior.names):
        posterior = Posterior.gather(session, baseline, search.evidence, search.prior.error, points)
    return posterior, [posterior.names[point] for point in points]


def _findings(
    found: SearchResults,
    estimates: Sequence[Estimate],
    arm: ArmModel,
    remaining: Remaining,
    given: HeldOut,
    settings: DiagnosisSettings,
) -> tuple[Finding, ...]:
    """The findings, those likelier than not first, and of these what closes most.

    Args:
        found, estimates, arm, remaining: What was accepted, its estimates, the arm, and what is left.
        given, settings: The untuned URDF, by which absorbed effects are scored, and thresholds.
    """
    improvement, floors = remaining.improvement, remaining.floors
    likely, most = settings.verdict.even_odds, settings.selection.class_odds
    joints, findings, groups = arm.joint_names, [], [item.group for item in found.accepted]
    for k, (item, estimate, share) in enumerate(zip(found.accepted, estimates, improvement.shares, strict=True)):
        sides = (given.score(groups[:k]), given.score(groups[: k + 1])) if item.absorbed else (item.before, item.after)
        old, new = (side.rms for side in sides)
        acts = item.affected_joints
        findings.append(
            Finding(
                estimate=estimate,
                evaluated=item,
                joints=joints_of(item, joints),
                rms_before={joints[j]: float(old[j]) for j in acts},
                rms_after={joints[j]: float(new[j]) for j in acts},
                energy_before=float(improvement.energy_before[acts].sum()),
                energy_after=float(improvement.energy_after[acts].sum()),
                energy_std=(
                    energy_spread(improvement.runs_before[:, acts]),
                    energy_spread(improvement.runs_after[:, acts]),
                ),
                shrink=measure_shrink(old[acts], new[acts], floors[acts]),
                share=float(share),
                elsewhere=tuple(
                    (item.group.effect.id, joints[j]) for j, odds in estimate.places.items() if odds <= most
                ),
                slides=slides(item.group, arm),
            )
        )
    return tuple(sorted(findings, key=lambda one: (one.estimate.probability < likely, -one.closed)))
