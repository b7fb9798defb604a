"""What is left at each joint beside the accepted effects: errors, noise floors, places."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Float
from ident.checks.report import MISREAD
from ident.diagnosis.gap.ceiling import Ceiling, find_repeated, measure_ceiling
from ident.diagnosis.gap.gap_map import Place, View
from ident.diagnosis.gap.improvement import (
    Improvement,
    energy_spread,
    measure_improvement,
    run_energy,
)
from ident.diagnosis.gap.place_ranking import ReportedCause, measure_excess_errors, rank_places
from ident.diagnosis.gap.replay import replay
from ident.diagnosis.gap.residuals import RunResidual, compute_residuals
from ident.diagnosis.result import Finding, JointGap
from ident.diagnosis.settings import DiagnosisSettings
from ident.diagnosis.tolerance import Tolerance, measure_tolerance
from ident.diagnosis.tuned_links import TunedLink, measure_tuned_links
from ident.effects.base import SessionContext
from ident.inference.conclusion import EVEN_ODDS, Conclusion
from ident.recordings.recording import TelemetryIssue
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection, project
from ident.regression.run_spread import measure_inflation
from ident.robot.arm import ArmModel

# Divisor of the URDF's tolerance for reported errors of the untuned model: a larger one changes no
# digit of them.
FIXED_URDF_FACTOR = 1e5


@dataclass(frozen=True, eq=False)
class Models:
    """The tuned model without and with the names, and the URDF's, on the whole session's sums."""

    evidence: Evidence
    groups: list[Group]  # the names
    before: Projection  # the tuned model
    after: Projection  # the same with the names
    fixed: Projection  # with the URDF's inertias, without names
    given: HeldOut  # scores models with the URDF's inertias
    # Held-out error of the tuned model, and of that with the URDF's inertias [N m].
    errors: tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]
    inflation: float  # variance inflation beside the names

    @classmethod
    def of(cls, conclusion: Conclusion) -> Models:
        """The models of a conclusion, solved on the whole session's sums."""
        evidence = conclusion.evidence
        prior = conclusion.prior
        groups = conclusion.groups
        gram = evidence.gram()
        after = project(gram, evidence, prior, groups)
        # Errors of the untuned model are reported with the URDF as it is.
        tightened = prior.tightened(FIXED_URDF_FACTOR * prior.error.scale)
        given = conclusion.held_out.believing(tightened)
        return cls(
            evidence=evidence,
            groups=groups,
            before=project(gram, evidence, prior),
            after=after,
            fixed=project(gram, evidence, given.prior),
            given=given,
            errors=(conclusion.ladder[0].rms, given.score().rms),
            inflation=measure_inflation(evidence, after),
        )


@dataclass(frozen=True, eq=False)
class Remaining:
    """What is left at each joint, how much of it is noise, and what tuning absorbed."""

    series: tuple[RunResidual, ...]  # residuals of every run
    ceilings: tuple[Ceiling, ...]  # what a flexible function explains of each joint's error
    conclusion: Conclusion  # the names, with what repeats by the angle among what is left
    gap_probability: Float[np.ndarray, " n"]  # that a cause without a name is left at each joint
    floors: Float[np.ndarray, " n"]  # what no model of the names goes below [N m]
    noise: Float[np.ndarray, " n"]  # the torque's noise and friction's variation [N m]
    improvement: Improvement  # what the names improve, in torque and energy
    links: dict[str, TunedLink]  # change of each link's inertia by tuning
    tolerance: Tolerance  # whether these exceed the URDF's tolerance


def measure_remaining(
    conclusion: Conclusion,
    models: Models,
    session: SessionContext,
    baseline: Baseline,
    settings: DiagnosisSettings,
    seed: int,
) -> Remaining:
    """Measures what is left.

    Args:
        conclusion, models: The names, and their models.
        session, baseline, settings, seed: The runs, the tuned model, thresholds, and seed of drawn
            orders.
    """
    evidence = models.evidence
    views = models.before, models.after, models.fixed
    series = compute_residuals(
        session, baseline, evidence, views, models.groups, conclusion.held_out
    )
    steady = [item.without_friction_level(evidence.spread) for item in series]
    repeated = [find_repeated(steady, j, settings.gap.ceiling) for j in range(session.n)]
    conclusion = conclusion.with_repeated(repeated)
    probability = conclusion.gap_probability()
    is_open = probability >= EVEN_ODDS
    ceilings = []
    for j, again in enumerate(repeated):
        if is_open[j]:
            ceilings.append(measure_ceiling(steady, j, *_largest_share(conclusion, j, again.share)))
        else:
            ceilings.append(measure_ceiling(steady, j, 0.0, None))
    # Of a joint without a cause that has no name, whatever is left is noise.
    last = conclusion.ladder[-1].rms
    shown = np.array([ceiling.ratio for ceiling in ceilings]) * last
    noise = np.minimum(evidence.floor, last)
    floors = np.where(is_open, np.minimum(noise, shown), last)
    prior = conclusion.prior
    forward = replay(series, baseline, settings.gap.replay)
    return Remaining(
        series=tuple(series),
        ceilings=tuple(ceilings),
        conclusion=conclusion,
        gap_probability=probability,
        floors=floors,
        noise=np.where(is_open, floors, np.maximum(noise, np.minimum(floors, last))),
        improvement=measure_improvement(conclusion, models.given, series, forward, floors, seed),
        links=measure_tuned_links(baseline, evidence, models.after, prior, models.inflation),
        tolerance=measure_tolerance(
            evidence, prior, models.after, models.inflation, settings.tolerance
        ),
    )


def _largest_share(conclusion: Conclusion, joint: int, repeated: float) -> tuple[float, str | None]:
    """What a flexible function explains of a joint's residual squares, and the kind of its inputs.

    Args:
        conclusion, joint: What the inference says of the joint's discrepancy, and the joint.
        repeated: What the same angles of other runs explain of it.
    """
    discrepancy = conclusion.joints.get(joint)
    share = 0.0 if discrepancy is None else discrepancy.share
    if repeated > share:
        return repeated, "state"
    return share, None if discrepancy is None else discrepancy.kind


def reported_causes(
    arm: ArmModel,
    remaining: Remaining,
    findings: Sequence[Finding],
    telemetry: Sequence[TelemetryIssue],
) -> list[ReportedCause]:
    """What is reported of joints: findings, causes without a name, and torques off by a factor."""
    causes = [ReportedCause(finding.joints, finding.hidden_torque) for finding in findings]
    without_name = np.flatnonzero(remaining.gap_probability >= EVEN_ODDS)
    causes += [ReportedCause((arm.joint_names[j],), {}) for j in without_name]
    for issue in telemetry:
        if issue.issue == MISREAD:
            hidden = dict.fromkeys(issue.joints, np.inf)
            causes.append(ReportedCause(issue.joints, hidden, is_factor=True))
    return causes


def find_places(
    arm: ArmModel,
    maps: Mapping[View, Sequence[Place]],
    models: Models,
    remaining: Remaining,
    causes: Sequence[ReportedCause],
    settings: DiagnosisSettings,
) -> tuple[Place, ...]:
    """Places of the gap, those of the largest error beyond noise first.

    Args:
        arm, maps: The user's arm, and all cells of the gap's map.
        models, remaining: The models, and what is left at each joint.
        causes: What is reported of joints.
        settings: Thresholds.
    """
    tolerance = remaining.tolerance
    tuned_away = tolerance.torque if tolerance.exceeded else np.zeros(arm.n)
    tuned, untuned = models.errors
    excess_errors = measure_excess_errors(
        arm.joint_names,
        {"before": tuned, "fixed": untuned},
        tuned_away,
        remaining.noise,
        causes,
        settings.verdict.loud,
    )
    return rank_places(maps, excess_errors, settings.gap.map)


def joint_gaps(arm: ArmModel, models: Models, remaining: Remaining) -> dict[str, JointGap]:
    """The gap of each joint, by joint name.

    Args:
        arm: The user's arm.
        models: The models without and with the names.
        remaining: What is left at each joint.
    """
    energy = np.array([run_energy(item, item.unseen_before) for item in remaining.series])
    tuned, untuned = models.errors
    noise = remaining.noise
    ceilings = remaining.ceilings
    tolerance = remaining.tolerance
    gaps: dict[str, JointGap] = {}
    for j, name in enumerate(arm.joint_names):
        gaps[name] = JointGap(
            rms=float(tuned[j]),
            fixed_rms=float(untuned[j]),
            noise_floor=float(noise[j]),
            ceiling_rms=float(max(noise[j], ceilings[j].rms)),
            unexplained=ceilings[j].kind,
            tuned_away=float(tolerance.torque[j]) if tolerance.exceeded else 0.0,
            energy_error=(float(energy[:, j].mean()), energy_spread(energy[:, j : j + 1])),
            friction_spread=float(models.evidence.spread[j]),
            slides=bool(arm.sliding_joints[j]),
        )
    return gaps
