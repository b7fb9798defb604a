"""The whole diagnosis: from motions and an arm to a verdict with evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.checks.report import MISREAD
from ident.diagnosis.alternate import Settled, keep_names, settle
from ident.diagnosis.baseline_record import tuned_alone, tuned_beside
from ident.diagnosis.detection_limits import find_limits
from ident.diagnosis.gap.ceiling import Ceiling, measure_ceiling
from ident.diagnosis.gap.gap_map import map_gap
from ident.diagnosis.gap.improvement import Reach, measure_reach, run_energy, spread_of_runs
from ident.diagnosis.gap.place_ranking import NamedPlace, measure_harm, rank_places
from ident.diagnosis.gap.residuals import RunResidual, compute_residuals
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.named_links import name_wrong_links
from ident.diagnosis.reservations import doubt_links, doubt_replay, joints_of
from ident.diagnosis.result import AllNames, Details, Diagnosis, Finding, JointGap
from ident.diagnosis.selection.gates import SearchResults
from ident.diagnosis.selection.name_probability import Estimate
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.tolerance import Tolerance, measure_tolerance
from ident.diagnosis.selection.urdf_scale import one_link_is_wrong
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.tuned_links import measure_tuned_links
from ident.diagnosis.verdict import (
    believed,
    decide,
    find_floors,
    find_nearest,
    find_unexplained,
    score_outside,
    stands_out,
)
from ident.effects.base import Effect, SessionContext
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.motion.out_of_core import few, runs_recorded
from ident.progress import stage
from ident.recordings.recording import TelemetryIssue
from ident.regression.baseline import Baseline, UrdfError, fit_baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import build_layout
from ident.regression.dwells import HeldFriction
from ident.regression.gram import Evidence, gather
from ident.regression.least_squares import Prior, project
from ident.regression.posterior import Beside, LeftAtJoint, Posterior, measure_dispersion
from ident.regression.run_spread import measure_inflation
from ident.regression.runs import build_session, leftover_torque
from ident.robot.arm import ArmModel
from ident.robot.names import robot_argument

# By what the URDF's tolerance is divided where it is fixed: more changes no digit of any error.
AS_GIVEN = 1e5
# Why a name does not stand that a discrepancy explains about as cheaply.
NO_LAW = (
    "a flexible function of the joint's state explains as much about as cheaply: more likely no such law is at work"
)


@dataclass(frozen=True, eq=False)
class Analysis:
    """All that the diagnosis computed on the way, for reports, the next experiment and patches."""

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
        common_clock: Whether time goes on from run to run.
        telemetry, seed: What the telemetry check found, passed on; seed of the sign flips.
        inertia_share: How well the arm's inertias are known, as the share of each link's scale; as a URDF's if None.
        settings: The numbers by which it decides.
    """
    still = [j for j in range(arm.n) if sum(int(motion.moving[:, j].sum()) for motion in few(motions)) < LEAST_MOVING]
    stage("tuning the arm", 0.2, 0.35)
    baseline = fit_baseline(motions, arm, inertia_share, settings.regression, still)
    session = build_session(baseline, motions, common_clock)
    leftover = leftover_torque(session)
    screened = [effect.screened(session, leftover) for effect in catalogue]
    layout = build_layout(session, baseline.base.rank, screened, beside=(HeldFriction(),))
    stage("torques of every law", 0.35, 0.6)
    evidence = gather(session, baseline, layout, rest=True).with_dwells()
    prior = Prior.of(evidence, baseline.prior)
    evidence = evidence.with_dispersion(measure_dispersion(session, baseline, replace(evidence), prior))
    stage("searching laws", 0.6, 0.9)
    first = Search(evidence, prior, HeldOut(evidence, prior), seed, settings=settings.selection)
    sure, beside = _beside_discrepancy(settle(first, session, baseline), session, baseline, settings)
    sure = name_wrong_links(sure, session, baseline, settings.verdict)
    search, found, estimates, fine = sure.search, sure.found, sure.estimates, sure.fine
    evidence, prior = search.evidence, search.prior
    groups = [item.group for item in found.named]
    gram = evidence.gram()
    before, after = project(gram, evidence, prior), project(gram, evidence, prior, groups)
    # What is reported of the URDF is said of it as it is; the search keeps to a prior that is tight, not singular.
    given = HeldOut(evidence, search.prior.tightened(AS_GIVEN * search.prior.error.scale))
    fixed = project(gram, evidence, given.prior)
    stage("what is left, and what could have been seen", 0.9, 1.0)
    series = compute_residuals(session, baseline, evidence, (before, after, fixed), groups, search.held_out)
    steady = [item.without_friction_level(evidence.spread) for item in series]
    ceilings = tuple(measure_ceiling(steady, j, one, settings.gap.ceiling) for j, one in enumerate(beside.left))
    open_gap = find_unexplained(found, ceilings, evidence, settings.verdict, settings.selection.least_own_share)
    left = open_gap.left
    floors = find_floors(evidence, ceilings, found.ladder[-1], settings.verdict)
    judged = np.where(left, np.minimum(settings.verdict.noise_margin * open_gap.noise, floors), floors)
    reach = measure_reach(search, given, found, series, baseline, floors, beside.explained, settings.gap)
    inflation = measure_inflation(evidence, after)
    links = measure_tuned_links(baseline, evidence, after, prior, inflation)
    # How far tuning went: for a usual URDF where one link alone is off, else for one as wrong as this one's is.
    usual = replace(search, prior=Prior.believing(evidence, baseline, UrdfError()))
    model = project(gram, evidence, usual.prior, groups)
    excess = measure_inflation(evidence, model)
    alone = one_link_is_wrong(usual, baseline, groups, excess)
    belief = (usual.prior, model, excess) if alone else (prior, after, inflation)
    tolerance = measure_tolerance(evidence, *belief, settings.selection)
    views = after, project(gram, evidence, search.fixed.prior, groups)
    limits = find_limits(search, found, views, inflation, session)
    untuned = search.fixed.score().rms, search.fixed.score(groups).rms
    laws = len(beside.laws)  # names after them are links'
    names = [*believed(estimates[:laws], beside.laws, settings.verdict), *estimates[laws:]]
    old, new = found.ladder[0].rms, found.ladder[-1].rms
    heldout = AllNames(old, new, measure_shrink(old, new, floors) if found.named else 0.0, reach)
    verdict = decide(found, names, left, judged, tolerance, untuned, settings.verdict)
    findings = sorted(_findings(found, names, arm, floors, reach, given), key=lambda one: -one.closed)
    far = doubt_replay(reach.forward, series, arm.joint_names, found.ladder[-1].rms, floors, settings)
    rng = np.random.default_rng(seed)
    maps = map_gap(series, arm.joint_names, evidence.whitening, rng, settings=settings.gap.map)
    harm = measure_harm(
        arm.joint_names,
        {"before": found.ladder[0].rms, "fixed": given.score().rms},
        tolerance.torque if tolerance.exceeded else np.zeros(arm.n),
        judged,
        [NamedPlace(one.joints, one.hidden) for one in findings]
        + [
            NamedPlace(one.joints, dict.fromkeys(one.joints, np.inf), True) for one in telemetry if one.issue == MISREAD
        ],
        settings.verdict.loud,
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
        gap=_gap(arm, (found.ladder[0].rms, given.score().rms), judged, ceilings, series, tolerance),
        where=() if verdict == "no_gap" else rank_places(maps, harm, settings.gap.map),
        findings=tuple(findings),
        heldout=heldout,
        not_testable=(
            *layout.silent,
            *(one.untestable(arm.joint_names) for one in limits if one.hidden and one.bound_by != "size"),
        ),
        reservations=sure.doubted + doubt_links(links) + far,
        details=Details(
            nearest=find_nearest(found, arm.joint_names),
            detectable=limits,
            maps=maps["before"],
            maps_fixed=maps["fixed"],
            baseline=tuned_beside(baseline, fine, estimates) if fine else tuned_alone(baseline, evidence, after),
            baseline_alone=tuned_alone(baseline, evidence, before),
            baseline_urdf=tuned_alone(baseline, evidence, fixed),
            outside_score=score_outside(verdict, names, heldout.shrink, open_gap.leftover),
            leftover=open_gap.leftover,
            tuned_links=links,
        ),
        catalogue=tuple(catalogue),
        settings=settings,
    )
    return Analysis(baseline, session, evidence, found, tuple(series), diagnosis)


@dataclass(frozen=True, eq=False)
class _WithDiscrepancy:
    """What a discrepancy says of a session."""

    # What it sees at each joint beside the names; None where nothing stands out of the noise.
    left: tuple[LeftAtJoint | None, ...]
    laws: tuple[Beside, ...]  # what each name is worth beside it
    explained: Float[Array, " n"]  # share of each joint's mean square that it explains in the names' place


def _beside_discrepancy(
    sure: Settled, session: SessionContext, baseline: Baseline, settings: DiagnosisSettings
) -> tuple[Settled, _WithDiscrepancy]:
    """Names that stand beside a discrepancy, and what it sees; a name that it explains as cheaply is none.

    Each is weighed beside all others: what one explains must not count against its neighbour when it goes. A name may
    be less likely without those that go.
    """
    beside = _weigh(sure, session, baseline, settings)
    laws = beside.laws
    while True:
        names = believed(sure.estimates, laws, settings.verdict)
        kept = [k for k, one in enumerate(names) if one.class_probability >= settings.verdict.even_odds]
        if len(kept) == len(names):
            break
        laws = tuple(laws[k] for k in kept)
        sure = keep_names(sure, kept, session, baseline, NO_LAW)
    if len(laws) < len(beside.laws):
        beside = replace(_weigh(sure, session, baseline, settings), laws=laws)
    return sure, beside


def _weigh(sure: Settled, session: SessionContext, baseline: Baseline, settings: DiagnosisSettings) -> _WithDiscrepancy:
    """A discrepancy beside the names, and in their place, where anything is named or stands out of the noise."""
    search, found = sure.search, sure.found
    loud = [stands_out(search.evidence, found.ladder[-1], j, settings.verdict) for j in range(session.n)]
    explained = np.zeros(session.n)
    if not (sure.estimates or any(loud)):
        return _WithDiscrepancy((None,) * session.n, (), explained)
    points = [estimate.refined for estimate in sure.estimates]
    acting = {j for item in found.named for j in item.shown}
    joints = sorted(acting | set(np.flatnonzero(loud).tolist()))
    posterior = Posterior.gather(session, baseline, search.evidence, search.prior, points, joints)
    left = tuple(posterior.left_at(j, posterior.names) if one else None for j, one in enumerate(loud))
    for j in acting:
        explained[j] = posterior.left_at(j, ()).share
    laws = [posterior.beside(k, item.shown) for k, item in enumerate(found.named)]
    return _WithDiscrepancy(left, tuple(laws), explained)


def _gap(
    arm: ArmModel,
    rms: tuple[Float[Array, " n"], Float[Array, " n"]],
    floors: Float[Array, " n"],
    ceilings: Sequence[Ceiling],
    series: Sequence[RunResidual],
    tolerance: Tolerance,
) -> dict[str, JointGap]:
    """The gap of each joint; `rms` is that of the tuned model and of the one with the URDF fixed."""
    energy = np.array([run_energy(item, item.unseen_before) for item in series])
    return {
        name: JointGap(
            rms=float(rms[0][j]),
            fixed_rms=float(rms[1][j]),
            noise_floor=float(floors[j]),
            ceiling_rms=float(max(floors[j], ceilings[j].rms)),
            unexplained=ceilings[j].kind,
            tuned_away=float(tolerance.torque[j]) if tolerance.exceeded else 0.0,
            energy_error=(float(energy[:, j].mean()), _spread(energy[:, j : j + 1])),
            slides=bool(arm.sliding_joints[j]),
        )
        for j, name in enumerate(arm.joint_names)
    }


def _findings(
    found: SearchResults,
    estimates: Sequence[Estimate],
    arm: ArmModel,
    floors: Float[Array, " n"],
    reach: Reach,
    given: HeldOut,
) -> tuple[Finding, ...]:
    """Findings of names; what tuning absorbs closes what it closes of the URDF as it is, `given`."""
    joints, findings, groups = arm.joint_names, [], [item.group for item in found.named]
    for k, (item, estimate, share) in enumerate(zip(found.named, estimates, reach.shares, strict=True)):
        sides = (given.score(groups[:k]), given.score(groups[: k + 1])) if item.absorbed else (item.before, item.after)
        old, new = (side.rms for side in sides)
        acts = item.shown
        findings.append(
            Finding(
                estimate=estimate,
                named=item,
                joints=joints_of(item, joints),
                rms_before={joints[j]: float(old[j]) for j in acts},
                rms_after={joints[j]: float(new[j]) for j in acts},
                energy_before=float(reach.energy_before[acts].sum()),
                energy_after=float(reach.energy_after[acts].sum()),
                energy_std=(_spread(reach.runs_before[:, acts]), _spread(reach.runs_after[:, acts])),
                shrink=measure_shrink(old[acts], new[acts], floors[acts]),
                share=float(share),
                slides=slides(item.group, arm),
            )
        )
    return tuple(findings)


def _spread(energies: Float[Array, "R k"]) -> float | None:
    """Standard deviation over the runs of what some joints err by together [J]; None of a single run."""
    found = spread_of_runs(energies.sum(axis=1))
    return None if found is None else float(found)
