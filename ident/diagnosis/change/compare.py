"""What changed between two sets of recordings of one arm: from motions to changes with their evidence.

Both sets share one baseline: the arm's inertias with a loose prior, its losses, and every law in all runs alike. Errors
of the model that are the same before and after cancel in it. The candidates are the same laws in the later set alone.
They are selected stepwise as in a diagnosis, but by a test against the differences between runs of one set (`search`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import OF_FRICTION, finer_grids
from ident.diagnosis.change.confounded_links import find_confounded, place_bodies
from ident.diagnosis.change.foretold import find_unforetold
from ident.diagnosis.change.friction_drift import may_be_gain
from ident.diagnosis.change.gain_uncertainty import BODIES, STATED, GainUncertainty, solve_body
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.paired_design import PairedDesign, build_design
from ident.diagnosis.change.permuted_sets import parts_of
from ident.diagnosis.change.result import ArmChange, ArmComparison, Side
from ident.diagnosis.change.risen_residual import find_risen
from ident.diagnosis.change.search import ChangeSearch, LaterHeldOut, Significance
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.change.static_joints import SamplesUsed, count_samples, find_static_joints
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.reservations import Reservation, find_implausible, joints_of
from ident.diagnosis.selection.criteria import SearchResults
from ident.diagnosis.selection.estimates import Estimate, Refined, estimate_effects
from ident.diagnosis.selection.settings import SelectionSettings
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.motion.motion import Motion
from ident.progress import stage
from ident.regression.design import Group, Key, NotTestable
from ident.regression.least_squares import project
from ident.regression.run_spread import squares_left
from ident.regression.settings import USUAL_REGRESSION
from ident.robot.arm import ArmModel

ANOTHER_RUN = "runs of one set differ by as much among themselves"
TOO_UNSURE = "these runs are too few, or move too alike, to tell its size from zero"
ANOTHER_DAY = "friction differs by as much from day to day; sessions of several days on both sides would tell"
TOO_FEW = "both sets together have fewer samples in the encoders' band than the model has parameters"


@dataclass(frozen=True, eq=False)
class _Changes:
    """Significant changes, and what else the search found."""

    found: SearchResults  # the changes
    estimates: tuple[Estimate, ...]  # one for each change
    significances: tuple[Significance, ...]  # one for each change
    reservations: tuple[Reservation, ...]  # rejected changes
    confounded: tuple[tuple[Group, ...], ...]  # for each change the effects and places that explain it as well
    implausible: bool  # whether a significant change was rejected for parameters that no arm has
    tests: int  # number of changes that were tested


def compare(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    sides: tuple[Side, Side],
    seed: int = 0,
    settings: DiagnosisSettings = USUAL,
    gain_uncertainty: GainUncertainty = STATED,
) -> ArmComparison:
    """Compares two sets of runs.

    Args:
        before, after: Motions of both sets, of the same joints and with the same filter.
        arm: The user's arm, without payload.
        sides: Description of the sets, for the record.
        seed, settings: Seed of the permutations of runs; thresholds and priors.
        gain_uncertainty: Uncertainty of the gains of the torque readings, which limits that of a body's size.
    """
    stage("torques of every law", 0.1, 0.5)
    still, used = find_static_joints(before, after), count_samples([*before, *after])
    one_clock = len(sides[1].sessions) <= 1
    first = build_design(before, after, arm, still=still, one_clock=one_clock)
    first = replace(first, gain_uncertainty=gain_uncertainty, seed=seed)
    if first.sums.evidence.samples.sum() <= first.sums.evidence.layout.tuned:
        few = [NotTestable(group.effect, group.joint, TOO_FEW) for group in first.sums.evidence.layout.groups]
        hidden = {one.effect.id + str(one.joint): one for one in (*first.untestable, *few)}.values()
        found = ArmComparison(arm.name, arm.joint_names, "not_testable", sides, not_testable=tuple(hidden))
        return replace(found, still=still, used=used)
    stage("searching for what changed", 0.5, 1.0)
    search = _search(first, settings.selection, sides, first_look=True)
    changes = _find_changes(search)
    groups = [one.group for one in changes.estimates]
    if groups:
        bodies = [one for one in groups if one.effect.id in BODIES]
        finer = finer_grids(groups, first.session, first.later_session)
        if bodies or finer:
            others = [one for one in groups if one not in bodies]
            effects = place_bodies(search, others, first.session, first.effects) if bodies else first.effects
            first = build_design(
                before, after, arm, first.estimates, effects, still=first.still, one_clock=one_clock, finer=finer
            )
            first = replace(first, gain_uncertainty=gain_uncertainty, seed=seed)
        changes = _find_changes(_search(first, settings.selection, sides))
    sliding = tuple(compress(arm.joint_names, arm.sliding_joints))
    return replace(_result(changes, first, arm, sides, _find_untestable(first, used)), used=used, slides=sliding)


def _search(
    design: PairedDesign, settings: SelectionSettings, sides: tuple[Side, Side], first_look: bool = False
) -> ChangeSearch:
    """The search over a design, laws of friction excluded at joints that move in one run a side at most."""
    evidence = design.sums.evidence
    held_out = LaterHeldOut(evidence, design.prior, design.sides.later_folds)
    sessions = max(1, len(sides[0].sessions)), max(1, len(sides[1].sessions))
    return ChangeSearch(
        evidence,
        design.prior,
        held_out,
        once_moved(design),
        settings=settings,
        design=design,
        sessions=sessions,
        first_look=first_look,
    )


def once_moved(design: PairedDesign) -> frozenset[Key]:
    """Laws of friction at joints that move in one run a side at most: how much it differs from run to run is open."""
    once = design.moves_once
    groups = design.sums.evidence.layout.groups
    return frozenset(one.key for one in groups if one.effect.id in OF_FRICTION and once[one.joint])


def _find_changes(search: ChangeSearch) -> _Changes:
    """Significant and plausible changes, each with its class and with the places that it is confounded with."""
    design, joints = search.design, search.design.baseline.nominal.joint_names
    reservations: list[Reservation] = []
    implausible = False
    while True:
        tested, failed = search.find()
        found = _results(search, [one.group for one in tested])
        fine = Refined(search, tuple(item.group for item in found.accepted))
        wider = [one.significance.widening for one in tested]
        raw = estimate_effects(fine, design.later_session, found.accepted, wider) if tested else []
        estimates = [_with_gain_uncertainty(*each, fine, design) for each in zip(raw, wider, strict=True)]
        refused = find_implausible(dict(enumerate(zip(found.accepted, estimates, strict=True))), design.session)
        if not refused:
            break
        implausible |= any(estimates[k].undefined is None for k in refused)
        reservations += [Reservation.of(found.accepted[k], estimates[k], joints, why) for k, why in refused.items()]
        search = replace(search, excluded=search.excluded | {found.accepted[k].group.key for k in refused})
    accepted = [item.group for item in found.accepted]
    keys = {group.key for group in accepted}
    for group, significance in ((one.group, one.significance) for key, one in failed.items() if key not in keys):
        where = (joints[group.joint],) if group.effect.scope == "joint" else joints
        why = ANOTHER_RUN if significance.mostly_between_runs else TOO_UNSURE
        why = ANOTHER_DAY if significance.mostly_between_days else why
        reservations.append(Reservation(group.effect.id, where, why, {}))
    confounded = tuple(find_confounded(search, accepted, slot) for slot in range(len(accepted)))
    gains = [may_be_gain(one.refined, design.session, one.coefficients, one.covariance) for one in estimates]
    estimates = [search.with_class(one, tested, k, confounded[k], gains[k]) for k, one in enumerate(estimates)]
    significances = tuple(one.significance for one in tested)
    return _Changes(found, tuple(estimates), significances, tuple(reservations), confounded, implausible, search.tests)


def _results(search: ChangeSearch, names: Sequence[Group]) -> SearchResults:
    """The changes as results of a search, each scored beside those before it."""
    found, gram = [], search.evidence.gram()
    ladder = [search.held_out.score(names[:k]) for k in range(len(names) + 1)]
    for slot in range(len(names)):
        item = search.evaluate_beside(gram, names, slot)
        found.append(replace(item, before=ladder[slot], after=ladder[slot + 1]))
    return SearchResults(tuple(found), tuple(ladder))


def _with_gain_uncertainty(estimate: Estimate, widening: float, fine: Refined, design: PairedDesign) -> Estimate:
    """The estimate of a body with each joint's gain uncertain; other estimates as they are.

    Args:
        estimate, widening: The estimate, and the factor by which differences between runs exceed those between blocks.
        fine, design: All changes on fine grids, and both sets of runs.
    """
    group = estimate.refined
    if group.effect.id not in BODIES:
        return estimate
    evidence = fine.search.evidence
    model = project(evidence.gram(), evidence, fine.search.prior, fine.groups)
    scale = evidence.scale[group.columns]
    scaled, covariance = solve_body(evidence, model, group, estimate.coefficients * scale, design.gain_uncertainty)
    beta, cells = scaled / scale, covariance / np.outer(scale, scale)
    cells = cells + (1.0 - widening**-2.0) * estimate.covariance
    context = design.later_session
    estimates = group.effect.parameters(context, group.joint, group.variant, beta, cells)
    return replace(estimate, parameters=dict(estimates), coefficients=beta, covariance=cells)


def _find_untestable(design: PairedDesign, used: Sequence[SamplesUsed]) -> list[NotTestable]:
    """Changes that these two sets cannot show, with the reason."""
    evidence, found, gram = design.sums.evidence, list(design.untestable), design.sums.evidence.gram()
    loose = project(gram, evidence, design.prior)
    right = project(gram, evidence, design.prior.tightened(CHANGE.urdf_share / USUAL_REGRESSION.inertia_share))
    first = {group.key: group for group in reversed(evidence.layout.groups)}
    for group in reversed(first.values()):
        seen = [float(one.visibility(group.columns).max()) for one in (loose, right)]
        if group.effect.id in OF_FRICTION and design.moves_once[group.joint]:
            reason = "it moves in one run a side at most: how much friction differs from run to run is not known"
        elif seen[0] >= CHANGE.least_seen:
            continue
        elif seen[1] >= 2.0 * CHANGE.least_seen:
            reason = "the two sets move too differently for a URDF that may be wrong; a correct one would show it"
        elif group.effect.rows == "own" and used[group.joint].in_motion < 0.5:
            share = 100.0 * used[group.joint].in_motion
            reason = f"in {share:.0f} % of its samples the joint moves far from stops and turns; the rest can't show it"
        else:
            reason = "the two sets have too little motion in common to show it"
        found.append(NotTestable(group.effect, group.joint, reason))
    return found


def _result(
    changes: _Changes, design: PairedDesign, arm: ArmModel, sides: tuple[Side, Side], hidden: Sequence[NotTestable]
) -> ArmComparison:
    """The comparison's record from the changes."""
    evidence, joints = design.sums.evidence, arm.joint_names
    floor, found = evidence.floor, []
    each = zip(changes.found.accepted, changes.estimates, changes.significances, changes.confounded, strict=True)
    for item, estimate, significance, confounded in each:
        acts = item.affected_joints
        old, new = item.before.rms[acts], item.after.rms[acts]
        names = [joints[j] for j in acts]
        found.append(
            ArmChange(
                estimate=estimate,
                joints=joints_of(item, joints),
                rms_before=dict(zip(names, map(float, old), strict=True)),
                rms_after=dict(zip(names, map(float, new), strict=True)),
                shrink=measure_shrink(old, new, floor[acts]),
                slides=slides(item.group, arm),
                p_value=min(1.0, changes.tests * significance.p_value),
                log_score=item.criteria.log_score,
                evidence=item.criteria.log_evidence,
                run_spread=significance.run_std,
                elsewhere=tuple(
                    (one.effect.id, joints[one.joint] if one.effect.scope == "joint" else "") for one in confounded
                ),
            )
        )
    found.sort(key=lambda change: -change.closed)
    with_rows = design.joints_with_rows

    def by_joint(values: Float[Array, " n"]) -> dict[str, float]:
        return {joints[j]: float(values[j]) for j in with_rows}

    model = project(evidence.gram(), evidence, design.prior, [one.refined for one in changes.estimates])
    label, later = parts_of(design.sides), design.sides.later_blocks
    risen = find_risen(squares_left(evidence, model), evidence.rows, label, later, joints)
    verdict = "not_testable" if design.sides.too_short else "no_change"
    unforetold = find_unforetold(design)
    verdict = "changed_unexplained" if found or changes.implausible or risen or unforetold else verdict
    return ArmComparison(
        robot=arm.name,
        joints=joints,
        verdict="changed" if any(change.effect != UNLISTED for change in found) else verdict,
        sides=sides,
        changes=tuple(found),
        rms_before=by_joint(changes.found.ladder[0].rms),
        rms_after=by_joint(changes.found.ladder[-1].rms),
        noise=by_joint(floor),
        run_spread=by_joint(design.sums.evidence.spread),
        not_testable=tuple(hidden),
        reservations=changes.reservations,
        still=design.still,
        risen=risen,
        unforetold=unforetold,
    )
