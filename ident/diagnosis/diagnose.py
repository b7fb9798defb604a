"""The whole diagnosis: from motions and an arm to a verdict with evidence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.baseline_record import tuned_beside, tuned_record
from ident.diagnosis.explained import Explained, measure_shrink
from ident.diagnosis.gap.gap_map import Place, map_gap, maps_record, told
from ident.diagnosis.gap.improvement import Reach, measure_reach, run_energy
from ident.diagnosis.gap.residuals import RunResidual, compute_residuals
from ident.diagnosis.gap.trees import Ceiling, measure_ceiling
from ident.diagnosis.next_experiment import next_experiment
from ident.diagnosis.regression.baseline import Baseline, fit_baseline
from ident.diagnosis.regression.cross_validation import HeldOut
from ident.diagnosis.regression.design import build_layout
from ident.diagnosis.regression.gram import Evidence, gather
from ident.diagnosis.regression.least_squares import Prior, project
from ident.diagnosis.regression.runs import build_session, leftover_torque
from ident.diagnosis.reservations import Reservation, doubt_replay, joints_of
from ident.diagnosis.selection.intervals import Estimate, inflation
from ident.diagnosis.selection.prior_check import Tolerance, measure_tolerance
from ident.diagnosis.selection.refine import Refined
from ident.diagnosis.selection.search import Named, Search, SearchResults
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.diagnosis.settle import settle
from ident.diagnosis.verdict import decide, find_floors, find_unexplained, nearest_record, stands_out
from ident.effects.base import Effect, SessionContext
from ident.effects.catalogue import CATALOGUE
from ident.motion.motion import Motion
from ident.motion.out_of_core import runs_recorded
from ident.recordings.recording import TelemetryIssue
from ident.results import Result
from ident.robot.arm import ArmModel
from ident.robot.names import robot_argument

SCHEMA = "ident.diagnosis/1"


@dataclass(frozen=True, eq=False)
class Finding(Explained):
    """A named effect with its evidence.

    Attributes:
        named: How it was judged.
        energy_before, energy_after: Mean energy error of a run at its joints, without and with it [J].
        energy_std: Standard deviation over the runs of both [J].
        share: Its order-free share of what all names close.
    """

    named: Named
    energy_before: float
    energy_after: float
    energy_std: tuple[float, float]
    share: float

    def to_dict(self) -> dict[str, Any]:
        return {
            **self.told(),
            "heldout": {
                "rms_before_Nm": self.rms_before,
                "rms_after_Nm": self.rms_after,
                "energy_error_before_J": self.energy_before,
                "energy_error_after_J": self.energy_after,
                "energy_error_before_std_J": self.energy_std[0],
                "energy_error_after_std_J": self.energy_std[1],
                "gain_rms_Nm": self.gain,
                "shrink": self.shrink,
                "share": self.share,
            },
            "evidence": {
                "p_value": self.named.gates.p_value,
                "log_score_gain": self.named.gates.log_score[0],
                "log_score_error": self.named.gates.log_score[1],
                "log_evidence": self.named.gates.evidence,
                "judged_against": "urdf" if self.named.absorbed else "tuned",
            },
        }


@dataclass(frozen=True, eq=False)
class Diagnosis(Result):
    """The answer: where, which, how far; or why not.

    Attributes:
        robot: Name of the robot.
        joints: Joint names.
        verdict: `no_gap`, `named`, `partial`, `none_of_catalogue`, `not_testable` or `refused`.
        session: Runs, samples, duration.
        telemetry: Findings of the telemetry check.
        gap: For each joint its residual, noise and ceiling.
        where: Cells of the map.
        findings: Named effects.
        heldout: Before and after, all effects together.
        not_testable: What these recordings can't show, and why.
        reservations: Names that were not believed, and other reasons to doubt.
        extra: Further figures.
        catalogue: The effects that were asked for.
        settings: The numbers by which it was decided.
        robot_option: What `--robot` takes for the robot.
    """

    robot: str
    joints: tuple[str, ...]
    verdict: str
    session: dict[str, float]
    telemetry: tuple[TelemetryIssue, ...]
    gap: dict[str, dict[str, Any]] = field(default_factory=dict)
    where: tuple[Place, ...] = ()
    findings: tuple[Finding, ...] = ()
    heldout: dict[str, Any] = field(default_factory=dict)
    not_testable: tuple[dict[str, Any], ...] = ()
    reservations: tuple[Reservation, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)
    catalogue: tuple[Effect, ...] = CATALOGUE
    settings: DiagnosisSettings = USUAL
    robot_option: str = ""

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.joints),
            "session": self.session,
            "telemetry": [issue.to_dict() for issue in self.telemetry],
            "verdict": self.verdict,
            "gap": self.gap,
            "where": [place.to_dict() for place in self.where],
            "findings": [finding.to_dict() for finding in self.findings],
            "heldout": self.heldout,
            "not_testable": list(self.not_testable),
            "reservations": [one.to_dict() for one in self.reservations],
            "next_experiment": next_experiment(
                [one.to_dict() for one in self.findings],
                self.not_testable,
                self.catalogue,
                self.robot_option or self.robot,
            ),
            **self.extra,
            "provenance": self.provenance.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class Analysis:
    """All that the diagnosis computed on the way, for reports, the next experiment and patches."""

    baseline: Baseline
    session: SessionContext
    evidence: Evidence
    search: SearchResults
    series: tuple[RunResidual, ...]
    ceilings: tuple[Ceiling, ...]
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
        motions: All runs, smoothed.
        arm: The user's arm, without payload.
        catalogue: The effects to be asked for.
        common_clock: Whether time goes on from run to run.
        telemetry: What the telemetry check found, passed on.
        seed: Of the sign flips.
        inertia_share: How well the arm's inertias are known, as the share of each link's scale; as a URDF's if None.
        settings: The numbers by which it decides.
    """
    baseline = fit_baseline(motions, arm, inertia_share, settings.regression)
    session = build_session(baseline, motions, common_clock)
    leftover = leftover_torque(session)
    layout = build_layout(session, baseline.base.rank, [effect.screened(session, leftover) for effect in catalogue])
    evidence = gather(session, baseline, layout)
    prior = Prior.of(evidence, baseline.prior)
    first = Search(evidence, prior, HeldOut(evidence, prior), seed, settings=settings.selection)
    sure = settle(first, session, baseline)
    search, found, estimates, fine = sure.search, sure.found, sure.estimates, sure.fine
    evidence, prior = search.evidence, search.prior
    groups = [item.group for item in found.named]
    gram = evidence.gram()
    before, after = project(gram, evidence, prior), project(gram, evidence, prior, groups)
    fixed = project(gram, evidence, search.fixed.prior)
    series = compute_residuals(session, baseline, evidence, (before, after, fixed), groups, search.held_out)
    steady = [item.without_friction_level(evidence.spread) for item in series]
    ceilings = tuple(
        measure_ceiling(steady, j, settings.gap.trees)
        if stands_out(evidence, found.ladder[-1], j, settings.verdict)
        else Ceiling.untried(series, j)
        for j in range(arm.n)
    )
    left, noise = find_unexplained(found, ceilings, evidence, settings.verdict)
    floors = find_floors(evidence, ceilings, found.ladder[-1], settings.verdict)
    judged = np.where(left, np.minimum(settings.verdict.noise_margin * noise, floors), floors)
    reach = measure_reach(search, found, series, baseline, floors, settings.gap)
    tolerance = measure_tolerance(evidence, prior, after, inflation(evidence, after), settings.selection)
    findings = _findings(found, estimates, arm.joint_names, floors, reach)
    far = doubt_replay(reach.forward, series, arm.joint_names, found.ladder[-1].rms, floors, settings)
    rng = np.random.default_rng(seed)
    maps = map_gap(series, arm.joint_names, evidence.whitening, rng, settings=settings.gap.map)
    diagnosis = Diagnosis(
        robot=arm.name,
        robot_option=robot_argument(arm.name, arm.source),
        joints=arm.joint_names,
        verdict=decide(found, left, judged, tolerance, settings.verdict),
        session=_session_facts(motions),
        telemetry=tuple(telemetry),
        gap=_gap(arm.joint_names, search, found, judged, ceilings, series, tolerance),
        where=told(maps["before"], settings.gap.map),
        findings=findings,
        heldout=_together(found, arm.joint_names, floors) | reach.to_dict(arm.joint_names),
        not_testable=tuple(item.to_dict(arm.joint_names) for item in layout.silent),
        reservations=sure.doubted + far,
        extra={
            "nearest": nearest_record(found, arm.joint_names),
            "maps": maps_record(maps["before"]),
            "maps_fixed": maps_record(maps["fixed"]),
            "baseline": _beside(baseline, fine, estimates) if fine else tuned_record(baseline, evidence, after),
            "baseline_alone": tuned_record(baseline, evidence, before),
            "baseline_urdf": tuned_record(baseline, evidence, fixed),
        },
        catalogue=tuple(catalogue),
        settings=settings,
    )
    return Analysis(baseline, session, evidence, found, tuple(series), ceilings, diagnosis)


def _beside(baseline: Baseline, fine: Refined, estimates: Sequence[Estimate]) -> dict[str, dict[str, Any]]:
    """The tuned baseline that goes with the figures that are told."""
    evidence = fine.search.evidence
    alone = project(evidence.gram(), evidence, fine.search.prior)
    told, coefficients = [e.told for e in estimates], [e.coefficients for e in estimates]
    return tuned_beside(baseline, evidence, alone, told, coefficients)


def _session_facts(motions: Sequence[Motion]) -> dict[str, float]:
    return {
        "runs": runs_recorded(motions),
        "samples": int(sum(len(motion.time) for motion in motions)),
        "duration_s": float(sum(motion.time[-1] - motion.time[0] for motion in motions)),
    }


def _gap(
    joints: Sequence[str],
    search: Search,
    found: SearchResults,
    floors: Float[Array, " n"],
    ceilings: Sequence[Ceiling],
    series: Sequence[RunResidual],
    tolerance: Tolerance,
) -> dict[str, dict[str, Any]]:
    start, fixed = found.ladder[0].rms, search.fixed.score().rms
    energy = np.array([run_energy(item, item.unseen_before) for item in series])
    return {
        name: {
            "rms_Nm": float(start[j]),
            "fixed_rms_Nm": float(fixed[j]),
            "noise_floor_Nm": float(floors[j]),
            "ceiling_rms_Nm": float(max(floors[j], ceilings[j].rms)),
            "unexplained": ceilings[j].kind,
            "tuned_away_Nm": float(tolerance.torque[j]) if tolerance.exceeded else 0.0,
            "energy_error_J": {"mean": float(energy[:, j].mean()), "std": float(energy[:, j].std())},
        }
        for j, name in enumerate(joints)
    }


def _findings(
    found: SearchResults,
    estimates: Sequence[Estimate],
    joints: Sequence[str],
    floors: Float[Array, " n"],
    reach: Reach,
) -> tuple[Finding, ...]:
    findings = []
    for item, estimate, share in zip(found.named, estimates, reach.shares, strict=True):
        old, new = item.before.rms, item.after.rms
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
            )
        )
    return tuple(sorted(findings, key=lambda finding: -finding.closed))


def _spread(energies: Float[Array, "R k"]) -> float:
    """Standard deviation over the runs of what some joints err by together [J]."""
    return float(energies.sum(axis=1).std())


def _together(found: SearchResults, joints: Sequence[str], floors: Float[Array, " n"]) -> dict[str, Any]:
    old, new = found.ladder[0].rms, found.ladder[-1].rms
    return {
        "rms_before_Nm": dict(zip(joints, map(float, old), strict=True)),
        "rms_after_Nm": dict(zip(joints, map(float, new), strict=True)),
        "shrink": measure_shrink(old, new, floors) if found.named else 0.0,
    }
