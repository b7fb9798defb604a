"""What speaks for and against each chosen effect, in numbers that carry over between arms.

Log evidence of a Gaussian model is too sure wherever noise is not as it is modelled, by far on real
arms. So it is one of several things that are looked at, each without unit: what the effect gains on
runs that it never saw, in standard errors; in how many parts of the session; the share of the gap
that it closes; what a flexible function would gain in its place; whether another start leads to it,
too; what else stands at the joint. A calibration turns them into a probability (`calibration`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import SessionContext, impossible
from ident.inference.components import ModelSums
from ident.inference.held_out_views import HeldOutView, Scorers, Turns
from ident.inference.infer import Inference, Inferred
from ident.inference.revision import discrepancy_at, friction_beside
from ident.inference.rivals import find_rivals, of_rivals, share_of_plain_law
from ident.inference.scales import signed_log, squashed
from ident.inference.search import SetSearch, rest_of
from ident.inference.simple import SimplestSet
from ident.inference.solution import Solution
from ident.regression.design import Group, Key

# Name of the feature that says what a smooth function still finds beside a law.
SHAPE_LEFT = "log_shape_left"


@dataclass(frozen=True, eq=False)
class Described:
    """A chosen effect with its features and rivals.

    Attributes:
        group: The effect at its point of the fine grid.
        coarse: The same effect at its point of the coarse grid.
        solution: Sums of the set in which it is described.
        joints: Indices of the joints where it shows.
        view: Held-out scores without and with it.
        features: What speaks for and against it, by name.
        rivals: For other effects by id, and for the same effect at other joints, by how many nats
            each explains less in its place.
    """

    group: Group
    coarse: Group
    solution: Solution
    joints: tuple[int, ...]
    view: HeldOutView
    features: Mapping[str, float]
    rivals: Mapping[Key, float] = field(default_factory=dict)


def describe(inference: Inference, refined: Inference, session: SessionContext) -> list[Described]:
    """Features and rivals of every effect that a start leads to, in the likeliest set that has it.

    Args:
        inference: What was reached on coarse grids.
        refined: The same sets on fine grids, in the same order.
        session: The runs.
    """
    described = []
    taken: set[Key] = set()
    turns = Turns.of(refined)
    for coarse, fine in zip(inference.reached, refined.reached, strict=True):
        new = [group for group in fine.chosen if group.key not in taken]
        if new:
            described += _describe_set(inference, coarse, fine, new, session, turns)
        taken |= {group.key for group in new}
    return described


def _describe_set(
    inference: Inference,
    coarse: Inferred,
    fine: Inferred,
    new: Sequence[Group],
    session: SessionContext,
    turns: Turns,
) -> list[Described]:
    """Features and rivals of some effects of one set."""
    scorers = Scorers.of(fine)
    smooth_share = fine.model.smooth_share(fine.chosen)
    residual = fine.model.residual(fine.chosen)
    smooth_power = residual.by_block.sum(axis=1)
    solution = Solution.of(fine)
    described = []
    for group in new:
        point = coarse.member(group.key)
        assert point is not None
        view = _held_out(scorers, fine.chosen, group)
        joints = shows_at(group, view, fine.model.sums.evidence.layout.n)
        dispersion = residual_dispersion(fine.model, joints)
        features = {
            **_of_evidence(fine, group, joints, smooth_power),
            **_beside_other_joints(scorers, view, joints),
            **of_held_out(view, scorers, joints, group),
            "size_in_errors": _size_in_errors(scorers, fine.chosen, group, view),
            **_of_shape(fine, group, session, joints, smooth_power),
            **_of_others(inference, coarse, fine, group, joints),
            **_of_simplest(inference.simplest, turns, group, joints),
            "smooth_share": float(smooth_share[list(joints)].max()),
            "log_dispersion": float(np.log(dispersion)),
        }
        features["share_of_plain_law"] = share_of_plain_law(coarse.search, coarse.chosen, point)
        rivals = find_rivals(coarse.search, coarse.chosen, point)
        features |= of_rivals(rivals, point)
        effect = Described(
            group=group,
            coarse=point,
            solution=solution,
            joints=joints,
            view=view,
            features=features,
            rivals=rivals,
        )
        described.append(effect)
    return described


def residual_dispersion(model: ModelSums, joints: Sequence[int]) -> float:
    """Largest dispersion, a factor of the noise variance, of some joints given by index."""
    return float(model.components.dispersion[list(joints)].max())


def _held_out(scorers: Scorers, chosen: Sequence[Group], group: Group) -> HeldOutView:
    """Scores without and with an effect; of one that inertias can imitate in the view in which it
    closes more.
    """
    others = rest_of(chosen, group)
    joints = group.acts_on(len(scorers.tuned.evidence.layout.local))
    tuned = HeldOutView(
        before=scorers.tuned.score(others),
        after=scorers.tuned.score(chosen),
        fixed=False,
    )
    if not group.effect.inertia_like:
        return tuned
    fixed = HeldOutView(
        before=scorers.fixed.score(others),
        after=scorers.fixed.score(chosen),
        fixed=True,
    )
    return max(tuned, fixed, key=lambda view: view.closed(joints))


def shows_at(group: Group, view: HeldOutView, n: int) -> tuple[int, ...]:
    """Indices of the joints where an effect shows.

    Its own joint; or of an effect of the whole arm those where it closes at least a third of what
    it closes at the joint where that is most, and that joint at least.

    Args:
        group: The effect.
        view: Held-out scores without and with it.
        n: Number of joints.
    """
    if group.effect.rows == "own":
        return (group.joint,)
    if n == 0:
        return (0,)
    fall = view.after.fall_from(view.before)
    if group.effect.event:  # it may happen at rest, where torque error is not counted
        misfit = view.before.misfit - view.after.misfit
        fall = misfit.sum(axis=0)
    largest = float(fall.max(initial=0.0))
    shown = np.flatnonzero(fall >= max(largest / 3.0, 1e-6))
    if len(shown) == 0:
        return (int(np.argmax(fall)),)
    return tuple(shown.tolist())


def _of_evidence(
    fine: Inferred, group: Group, joints: Sequence[int], smooth_power: Float[Array, " n"]
) -> dict[str, float]:
    """Log evidence that an effect adds, discrepancy and friction's levels as they are, and free to
    take the effect's place; and what the discrepancy still finds beside it.

    Args:
        fine, group, joints: The set, one of its effects, and where that shows.
        smooth_power: Whitened squares of each joint's discrepancy beside the whole set.
    """
    model = fine.model
    here = list(joints)
    others = rest_of(fine.chosen, group)
    whole = fine.search.nats(fine.chosen)
    alone = whole - fine.search.nats(others)
    loose = friction_beside(model, joints, others)
    changed = {}
    for joint in joints:
        variances, _ = discrepancy_at(loose, joint, others)
        changed[joint] = variances
    freed = loose.with_discrepancy(changed)
    without = freed.log_evidence(()) + SetSearch.of(freed).nats(others)
    beside = min(fine.log_evidence - without, alone)
    rows = max(float(model.sums.evidence.samples[here].sum()), 1.0)
    smooth_before = float(freed.residual(others).by_block[here].sum())
    smooth_after = float(smooth_power[here].sum())
    share_of_smooth = (smooth_before - smooth_after) / (1.0 + smooth_before)
    added = max(alone, 0.1)
    return {
        "share_of_smooth": float(np.clip(share_of_smooth, -1.0, 1.0)),
        "log_nats": signed_log(alone),
        "log_nats_beside": signed_log(beside),
        "log_share_of_evidence": float(np.log(added / max(whole, 1.0))),
        "log_nats_a_row": float(np.log(added / rows)),
        "log_rows": float(np.log(rows)),
    }


def of_held_out(
    view: HeldOutView, scorers: Scorers, joints: Sequence[int], group: Group
) -> dict[str, float]:
    """What an effect gains on parts of the session that it never saw."""
    here = list(joints)
    evidence = scorers.tuned.evidence
    gain, error = view.after.gain_over(view.before, here)
    closed, closed_error = view.after.closed_over(view.before, here)
    fall = view.before.misfit - view.after.misfit
    by_fold = 0.5 * fall[:, here].sum(axis=1)
    floor = evidence.floor[here]
    old = view.before.rms[here]
    new = view.after.rms[here]
    most = int(np.argmax(old**2 - new**2))
    square = float(old[most] ** 2)
    fell = float(old[most] ** 2 - new[most] ** 2)
    reducible = float(old[most] ** 2 - floor[most] ** 2)
    reducible = max(reducible, 1e-3 * square, 1e-300)
    level = max(float(evidence.whitening.level[here][most]), 1e-12)
    size = np.sqrt(max(fell, 1e-6 * level**2))
    left = max(float(new[most]), 1e-12)
    return {
        "gain_in_errors": squashed(gain, error),
        "closed_in_errors": squashed(closed, closed_error),
        "folds_that_gain": float(np.mean(by_fold > 0.0)),
        "share_of_square": float(np.clip(fell / max(square, 1e-300), -1.0, 1.0)),
        "share_of_gap": float(np.clip(fell / reducible, -1.0, 1.0)),
        "log_size_over_noise": float(np.log(size / level)),
        "log_left_over_noise": float(np.log(left / level)),
    }


def _beside_other_joints(
    scorers: Scorers, view: HeldOutView, joints: Sequence[int]
) -> dict[str, float]:
    """How far an effect's joints are off beside the others, before and after it."""
    evidence = scorers.tuned.evidence
    level = np.maximum(evidence.whitening.level, 1e-12)
    before = np.log(np.maximum(view.before.rms / level, 1e-3))
    after = np.log(np.maximum(view.after.rms / level, 1e-3))
    with_rows = np.flatnonzero(evidence.samples >= 1.0)
    others = np.setdiff1d(with_rows, joints)
    usual = float(np.median(after[others])) if len(others) else 0.0
    here = list(joints)
    return {
        "stands_out": float(before[here].max()) - usual,
        "left_above_others": float(after[here].max()) - usual,
    }


def _size_in_errors(
    scorers: Scorers, chosen: Sequence[Group], group: Group, view: HeldOutView
) -> float:
    """How large an effect is beside the error of its size that its variation between parts shows.

    The error is the jackknife's over solutions that leave out one part each, along the mean
    solution, in which a coefficient counts by its column's power.

    Of what happens once other parts say nothing.

    Source: Efron and Tibshirani 1993, chapter 11.
    """
    if group.effect.event:
        return 0.0
    scorer = scorers.fixed if view.fixed else scorers.tuned
    solved = scorer.weights(chosen)
    places = np.flatnonzero(np.isin(solved.columns, group.columns))
    deviation = np.sqrt(scorer.power(group.columns))
    sizes = -solved.values[:, places] * deviation
    mean = sizes.mean(axis=0)
    length = float(np.linalg.norm(mean))
    along = sizes @ mean / max(length, 1e-300)
    parts = len(along)
    squares = np.sum((along - length) ** 2)
    error = np.sqrt((parts - 1) / parts * squares)
    return squashed(length, max(float(error), 1e-6 * length))


def power_at(
    model: ModelSums, group: Group, scaled: Float[Array, " k"], joints: Sequence[int]
) -> float:
    """Whitened squares of an effect's own torque at some joints.

    Args:
        model, group, joints: The sums, the effect, and the joints.
        scaled: Its coefficients in the scale of its columns.

    Returns:
        The sum over the joints, in units of the noise variance.
    """
    power = 0.0
    for j in joints:
        places = model.sums.evidence.layout.places[j]
        here = np.array([column in places for column in group.columns])
        inside = [places[int(column)] for column in group.columns[here]]
        sums = model.whole[j][np.ix_(inside, inside)]
        power += float(scaled[here] @ sums @ scaled[here])
    return power


def _of_shape(
    fine: Inferred,
    group: Group,
    session: SessionContext,
    joints: Sequence[int],
    smooth_power: Float[Array, " n"],
) -> dict[str, float]:
    """How large an effect is beside what is expected, which share of it tuning can't absorb, and
    what a smooth function still finds beside it.

    Args:
        fine, group, joints: The set, one of its effects, and where that shows.
        session: The runs.
        smooth_power: Whitened squares of each joint's discrepancy beside the whole set.
    """
    search = fine.search
    model = fine.model
    estimate = search.coefficients(fine.chosen)[group]
    columns = group.columns
    inside = columns - search.names.first
    scaled = estimate * search.scale[inside]
    certain = np.zeros((len(estimate), len(estimate)))
    parameters = group.effect.parameters(session, group.joint, group.variant, estimate, certain)
    unlike_any_arm = impossible(group.effect, session, group.joint, parameters)
    deviation = np.maximum(model.names.deviation[group], 1e-12)
    largest = float(np.max(np.abs(scaled) / deviation))
    power = float(scaled @ model.gram[np.ix_(columns, columns)] @ scaled)
    left = float(scaled @ search.rest[np.ix_(inside, inside)] @ scaled)
    visibility = left / max(power, 1e-300)
    smooth_left = float(smooth_power[list(joints)].sum())
    power_here = power_at(model, group, scaled, joints)
    return {
        SHAPE_LEFT: float(np.log((1.0 + smooth_left) / (1.0 + power_here))),
        "log_size_over_usual": float(np.log(max(largest, 1e-6))),
        "visibility": float(np.clip(visibility, 0.0, 1.0)),
        "unlike_any_arm": float(unlike_any_arm is not None),
        "inertia_like": float(group.effect.inertia_like),
        "event": float(group.effect.event),
        "whole_arm": float(group.effect.scope == "arm"),
        "columns": float(len(columns)),
    }


def _of_others(
    inference: Inference, coarse: Inferred, fine: Inferred, group: Group, joints: Sequence[int]
) -> dict[str, float]:
    """What stands beside an effect, and whether the other starts lead to it, too."""
    n = fine.model.sums.evidence.layout.n
    others = [reached for reached in inference.reached if reached is not coarse]
    again = [reached.member(group.key) is not None for reached in others]
    beside = [other for other in rest_of(fine.chosen, group) if other.effect.rows == "own"]
    near = [other for other in beside if other.joint in joints]
    best = inference.best
    components = best.model.components
    behind = best.log_evidence - coarse.log_evidence
    spread = components.friction[list(joints)].max()
    return {
        "log_urdf_scale": float(np.log(components.urdf.scale)),
        "log_friction_spread": float(np.log(spread)),
        "from_every_start": float(np.mean(again)),
        "start_behind": float(np.log1p(max(behind, 0.0))),
        "others_here": float(len(near)),
        "names_a_joint": len(fine.chosen) / n,
    }


def _of_simplest(
    simplest: SimplestSet, turns: Turns, group: Group, joints: Sequence[int]
) -> dict[str, float]:
    """What an effect is to the simplest set that explains."""
    alone = simplest.alone.get(group.key, 0.0)
    rows = float(simplest.model.sums.evidence.samples[list(joints)].sum())
    nats_a_row = max(alone, 0.0) / max(rows, 1.0)
    behind = simplest.most_like(group) - alone
    view = turns.view(group)
    closed, error = view.after.closed_over(view.before, joints)
    return {
        "log_nats_alone": signed_log(alone),
        "share_alone": float(-np.expm1(-2.0 * nats_a_row)),
        "alone_behind": signed_log(max(behind, 0.0)),
        "log_nats_in_turn": signed_log(simplest.nats_in_turn(group.key)),
        "share_in_turn": float(np.clip(view.closed(joints), -1.0, 1.0)),
        "turn_in_errors": squashed(closed, error),
    }
