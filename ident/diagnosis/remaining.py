"""What is left at each joint beside the accepted effects: models, errors, noise floors, and places of the gap."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Float
from ident.checks.report import MISREAD
from ident.diagnosis.alternate import Selection
from ident.diagnosis.gap.ceiling import Ceiling, measure_ceiling
from ident.diagnosis.gap.gap_map import Place, View
from ident.diagnosis.gap.improvement import Improvement, energy_spread, measure_improvement, run_energy
from ident.diagnosis.gap.place_ranking import ReportedCause, measure_excess_errors, rank_places
from ident.diagnosis.gap.residuals import RunResidual, compute_residuals
from ident.diagnosis.result import Finding, JointGap
from ident.diagnosis.selection.search import Search
from ident.diagnosis.selection.tolerance import Tolerance, measure_tolerance
from ident.diagnosis.selection.urdf_scale import one_link_is_wrong
from ident.diagnosis.settings import DiagnosisSettings
from ident.diagnosis.tuned_links import TunedLink, measure_tuned_links
from ident.diagnosis.verdict import ResidualExcess, find_floors, find_unexplained
from ident.effects.base import SessionContext
from ident.recordings.recording import TelemetryIssue
from ident.regression.baseline import Baseline, UrdfError
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
from ident.regression.posterior import LeftAtJoint
from ident.regression.run_spread import measure_inflation
from ident.robot.arm import ArmModel

# Divisor of the URDF's tolerance for reported errors of the untuned model: a larger one changes no digit of them.
FIXED_URDF_FACTOR = 1e5


@dataclass(frozen=True, eq=False)
class Models:
    """The tuned model without and with the effects, and the URDF's, on the sums of the whole session."""

    evidence: Evidence
    groups: list[Group]  # the accepted effects
    before: Projection  # the tuned model
    after: Projection  # the same with the effects
    after_fixed: Projection  # with the effects, and the inertias of the search's own fixed prior
    fixed: Projection  # with the URDF's inertias, without effects
    given: HeldOut  # scores models with the URDF's inertias
    # Held-out error of the tuned model, and of that with the URDF's inertias [N m].
    errors: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]
    # Held-out error with the inertias of the search's own fixed prior, without and with the effects [N m].
    with_fixed_inertias: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]
    inflation: float  # variance inflation beside the effects

    @classmethod
    def of(cls, selected: Selection) -> Models:
        """The models of a selection."""
        search, evidence, prior = selected.search, selected.search.evidence, selected.search.prior
        gram, groups = evidence.gram(), [item.group for item in selected.found.accepted]
        after = project(gram, evidence, prior, groups)
        # Errors of the untuned model are reported with the URDF as it is; the search's fixed prior is less tight.
        given = HeldOut(evidence, prior.tightened(FIXED_URDF_FACTOR * prior.error.scale))
        return cls(
            evidence=evidence,
            groups=groups,
            before=project(gram, evidence, prior),
            after=after,
            after_fixed=project(gram, evidence, search.fixed.prior, groups),
            fixed=project(gram, evidence, given.prior),
            given=given,
            errors=(selected.found.ladder[0].rms, given.score().rms),
            with_fixed_inertias=(search.fixed.score().rms, search.fixed.score(groups).rms),
            inflation=measure_inflation(evidence, after),
        )


@dataclass(frozen=True, eq=False)
class Remaining:
    """What is left at each joint, how much of it is noise, and what tuning absorbed."""

    series: tuple[RunResidual, ...]  # residuals of every run
    ceilings: tuple[Ceiling, ...]  # what a discrepancy explains of each joint's error
    excess: ResidualExcess  # which of it is significant
    floors: Float[np.ndarray, " n"]  # noise floor [N m]
    noise: Float[np.ndarray, " n"]  # the same, lower where a significant residual shows that less is possible [N m]
    improvement: Improvement  # what the effects improve, in torque and energy
    links: dict[str, TunedLink]  # change of each link's inertia by tuning
    tolerance: Tolerance  # whether these exceed the URDF's tolerance


def measure_remaining(
    selected: Selection,
    models: Models,
    left: Sequence[LeftAtJoint | None],
    explained: Float[np.ndarray, " n"],
    session: SessionContext,
    baseline: Baseline,
    settings: DiagnosisSettings,
) -> Remaining:
    """Measures what is left.

    Args:
        selected, models: The selection, and its models.
        left, explained: Of each joint what a discrepancy finds beside the effects, and what in their place.
        session, baseline, settings: The runs, the tuned model, and thresholds.
    """
    search, found, evidence = selected.search, selected.found, models.evidence
    views = models.before, models.after, models.fixed
    series = compute_residuals(session, baseline, evidence, views, models.groups, search.held_out)
    steady = [item.without_friction_level(evidence.spread) for item in series]
    ceilings = tuple(measure_ceiling(steady, j, one, settings.gap.ceiling) for j, one in enumerate(left))
    excess = find_unexplained(found, ceilings, evidence, settings.verdict, settings.selection.least_own_share)
    floors = find_floors(evidence, ceilings, found.ladder[-1], settings.verdict)
    # What a function of the state explains is no noise, though the noise was estimated with it.
    shown = np.array([one.ratio for one in ceilings]) * found.ladder[-1].rms
    lower = np.minimum.reduce([settings.verdict.noise_margin * excess.noise, floors, shown])
    return Remaining(
        series=tuple(series),
        ceilings=ceilings,
        excess=excess,
        floors=floors,
        noise=np.where(excess.present, lower, floors),
        improvement=measure_improvement(search, models.given, found, series, baseline, floors, explained, settings.gap),
        links=measure_tuned_links(baseline, evidence, models.after, search.prior, models.inflation),
        tolerance=_measure_tolerance(search, models, baseline, settings),
    )


def _measure_tolerance(search: Search, models: Models, baseline: Baseline, settings: DiagnosisSettings) -> Tolerance:
    """Tests with the usual prior whether a single link is wrong; else with the URDF's error as estimated."""
    evidence = models.evidence
    usual = replace(search, prior=Prior.believing(evidence, baseline, UrdfError()))
    model = project(evidence.gram(), evidence, usual.prior, models.groups)
    inflation = measure_inflation(evidence, model)
    if one_link_is_wrong(usual, baseline, models.groups, inflation):
        return measure_tolerance(evidence, usual.prior, model, inflation, settings.selection)
    return measure_tolerance(evidence, search.prior, models.after, models.inflation, settings.selection)


def find_places(
    arm: ArmModel,
    maps: Mapping[View, Sequence[Place]],
    models: Models,
    remaining: Remaining,
    findings: Sequence[Finding],
    telemetry: Sequence[TelemetryIssue],
    settings: DiagnosisSettings,
) -> tuple[Place, ...]:
    """Places of the gap, those of the largest error beyond noise first."""
    tolerance, misread = remaining.tolerance, [one.joints for one in telemetry if one.issue == MISREAD]
    excess_errors = measure_excess_errors(
        arm.joint_names,
        {"before": models.errors[0], "fixed": models.errors[1]},
        tolerance.torque if tolerance.exceeded else np.zeros(arm.n),
        remaining.noise,
        [ReportedCause(one.joints, one.hidden_torque) for one in findings]
        + [ReportedCause((arm.joint_names[j],), {}) for j in np.flatnonzero(remaining.excess.present)]
        + [ReportedCause(one, dict.fromkeys(one, np.inf), is_factor=True) for one in misread],
        settings.verdict.loud,
    )
    return rank_places(maps, excess_errors, settings.gap.map)


def joint_gaps(arm: ArmModel, models: Models, remaining: Remaining) -> dict[str, JointGap]:
    """The gap of each joint."""
    energy = np.array([run_energy(item, item.unseen_before) for item in remaining.series])
    tuned, untuned = models.errors
    noise, ceilings, tolerance = remaining.noise, remaining.ceilings, remaining.tolerance
    return {
        name: JointGap(
            rms=float(tuned[j]),
            fixed_rms=float(untuned[j]),
            noise_floor=float(noise[j]),
            ceiling_rms=float(max(noise[j], ceilings[j].rms)),
            unexplained=ceilings[j].kind,
            tuned_away=float(tolerance.torque[j]) if tolerance.exceeded else 0.0,
            energy_error=(float(energy[:, j].mean()), energy_spread(energy[:, j : j + 1])),
            slides=bool(arm.sliding_joints[j]),
        )
        for j, name in enumerate(arm.joint_names)
    }
