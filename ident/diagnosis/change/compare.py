"""What changed between two sets of recordings of one arm: from motions to changes with evidence.
Both sets share one baseline: the arm's inertias with a loose prior, its losses, and every law in
all runs alike. Errors of the model that are the same before and after cancel in it. The candidates
are the same laws in the later set alone, and what changed is inferred from them as a session's
causes are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

from ident.arrays import Array, Float
from ident.diagnosis.change.candidates import OF_FRICTION
from ident.diagnosis.change.change_features import against_runs
from ident.diagnosis.change.foretold import find_unforetold
from ident.diagnosis.change.gain_uncertainty import STATED, GainUncertainty
from ident.diagnosis.change.laws import UNLISTED
from ident.diagnosis.change.looks import TwoSets, look_twice
from ident.diagnosis.change.name_changes import ToldChanges, other_places, tell_changes
from ident.diagnosis.change.paired_design import PairedDesign
from ident.diagnosis.change.permuted_sets import parts_of
from ident.diagnosis.change.result import ArmChange, ArmComparison, Side
from ident.diagnosis.change.risen_residual import find_risen
from ident.diagnosis.change.settings import CHANGE
from ident.diagnosis.change.static_joints import SamplesUsed, count_samples, find_static_joints
from ident.diagnosis.heldout_gain import measure_shrink, slides
from ident.diagnosis.reservations import joints_of, unlikely_reservations
from ident.inference.conclusion import Named
from ident.motion.motion import Motion
from ident.progress import stage
from ident.regression.design import NotTestable
from ident.regression.least_squares import project
from ident.regression.run_spread import squares_left
from ident.regression.settings import USUAL_REGRESSION
from ident.robot.arm import ArmModel

TOO_FEW = (
    "both sets together have fewer samples in the encoders' band than the model has parameters"
)
# Why a change at a joint can't be tested.
ONE_RUN_A_SIDE = (
    "it moves in one run a side at most: how much friction differs from run to run is not known"
)
TOO_DIFFERENT = (
    "the two sets move too differently for a URDF that may be wrong; a correct one would show it"
)


def compare(
    before: Sequence[Motion],
    after: Sequence[Motion],
    arm: ArmModel,
    sides: tuple[Side, Side],
    seed: int = 0,
    gain_uncertainty: GainUncertainty = STATED,
) -> ArmComparison:
    """Compares two sets of runs.

    Args:
        before, after: Motions of both sets, of the same joints and with the same filter.
        arm: The user's arm, without payload.
        sides: Description of the sets, for the record.
        seed: Seed of the permutations of runs.
        gain_uncertainty: Uncertainty of the gains of the torque readings, which limits that of a
            body's size.
    """
    stage("torques of every law", 0.1, 0.5)
    still = find_static_joints(before, after)
    used = count_samples([*before, *after])
    earlier, later = sides
    sessions = max(1, len(earlier.sessions)), max(1, len(later.sessions))
    sets = TwoSets(before, after, arm, still, sessions, gain_uncertainty, seed)
    design = sets.design()
    evidence = design.sums.evidence
    if evidence.samples.sum() <= evidence.layout.tuned:
        return _too_few(design, arm, sides, used)
    stage("searching for what changed", 0.5, 1.0)
    told = tell_changes(look_twice(sets, design))
    hidden = _find_untestable(told.likely.design, used)
    sliding = tuple(compress(arm.joint_names, arm.sliding_joints))
    return replace(_result(told, arm, sides, hidden), used=used, slides=sliding)


def _too_few(
    design: PairedDesign, arm: ArmModel, sides: tuple[Side, Side], used: tuple[SamplesUsed, ...]
) -> ArmComparison:
    """The record of sets with fewer samples than the baseline has columns."""
    untestable = {(entry.effect.id, entry.joint): entry for entry in design.untestable}
    for group in design.sums.evidence.layout.groups:
        untestable[group.effect.id, group.joint] = NotTestable(group.effect, group.joint, TOO_FEW)
    return ArmComparison(
        robot=arm.name,
        joints=arm.joint_names,
        verdict="not_testable",
        sides=sides,
        not_testable=tuple(untestable.values()),
        still=design.still,
        used=used,
    )


def _find_untestable(design: PairedDesign, used: Sequence[SamplesUsed]) -> list[NotTestable]:
    """Changes that these two sets cannot show, with the reason."""
    evidence = design.sums.evidence
    untestable = list(design.untestable)
    gram = evidence.gram()
    correct_urdf = design.prior.tightened(CHANGE.urdf_share / USUAL_REGRESSION.inertia_share)
    model = project(gram, evidence, design.prior)
    model_of_correct_urdf = project(gram, evidence, correct_urdf)
    first = {group.key: group for group in reversed(evidence.layout.groups)}
    for group in reversed(first.values()):
        seen = float(model.visibility(group.columns).max())
        seen_by_correct_urdf = float(model_of_correct_urdf.visibility(group.columns).max())
        if group.effect.id in OF_FRICTION and design.moves_once[group.joint]:
            reason = ONE_RUN_A_SIDE
        elif seen >= CHANGE.least_seen:
            continue
        elif seen_by_correct_urdf >= 2.0 * CHANGE.least_seen:
            reason = TOO_DIFFERENT
        elif group.effect.rows == "own" and used[group.joint].in_motion < 0.5:
            share = 100.0 * used[group.joint].in_motion
            moves = f"in {share:.0f} % of its samples the joint moves far from stops and turns"
            reason = f"{moves}; the rest can't show it"
        else:
            reason = "the two sets have too little motion in common to show it"
        untestable.append(NotTestable(group.effect, group.joint, reason))
    return untestable


def _result(
    told: ToldChanges, arm: ArmModel, sides: tuple[Side, Side], hidden: Sequence[NotTestable]
) -> ArmComparison:
    """The comparison's record from the changes."""
    design = told.likely.design
    joints = arm.joint_names
    evidence = design.sums.evidence
    changes = [_change(name, told, arm) for name in told.names]
    changes.sort(key=lambda change: -change.closed)
    with_rows = design.joints_with_rows

    def by_joint(values: Float[Array, " n"]) -> dict[str, float]:
        return {joints[j]: float(values[j]) for j in with_rows}

    model = project(evidence.gram(), evidence, design.prior, [name.group for name in told.names])
    label = parts_of(design.sides)
    later = design.sides.later_blocks
    squares = squares_left(evidence, model)
    risen = find_risen(squares, evidence.rows, evidence.held_rows, label, later, joints)
    unforetold = find_unforetold(design, told.likely.chosen)
    verdict = "not_testable" if design.sides.too_short else "no_change"
    if changes or risen or unforetold:
        verdict = "changed_unexplained"
    if any(change.effect != UNLISTED for change in changes):
        verdict = "changed"
    return ArmComparison(
        robot=arm.name,
        joints=joints,
        verdict=verdict,
        sides=sides,
        changes=tuple(changes),
        rms_before=by_joint(told.ladder[0].rms),
        rms_after=by_joint(told.ladder[-1].rms),
        noise=by_joint(evidence.floor),
        run_spread=by_joint(evidence.spread),
        not_testable=tuple(hidden),
        reservations=unlikely_reservations(told.unlikely, joints),
        still=design.still,
        risen=risen,
        unforetold=unforetold,
        told=told,
    )


def _change(name: Named, told: ToldChanges, arm: ArmModel) -> ArmChange:
    """The record of one change."""
    likely = told.likely
    joints = arm.joint_names
    acts = name.affected_joints
    old = name.before.rms[acts]
    new = name.after.rms[acts]
    names = [joints[j] for j in acts]
    against = against_runs(likely, name.group)
    tests = len({group.key for group in likely.search.names.groups})
    elsewhere = []
    for effect, joint in other_places(name.described, told.calibration.temper):
        elsewhere.append((effect, "" if joint < 0 else joints[joint]))
    return ArmChange(
        estimate=name.estimate,
        joints=joints_of(name, joints),
        rms_before=dict(zip(names, map(float, old), strict=True)),
        rms_after=dict(zip(names, map(float, new), strict=True)),
        shrink=measure_shrink(old, new, likely.evidence.floor[acts]),
        slides=slides(name.group, arm),
        p_value=min(1.0, tests * against.p_value),
        log_score=name.log_score,
        evidence=name.log_evidence,
        run_spread=against.run_deviation(likely.design.sides.counts),
        elsewhere=tuple(elsewhere),
    )
