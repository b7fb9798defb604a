"""Intervals: what chance makes, what signs hold at zero, which ends are open, and what laws may differ by."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.selection.candidates import Candidates
from ident.diagnosis.selection.estimates import Refined, is_significant, solve_effects, widen_interval
from ident.diagnosis.selection.profile import Profile as ChangeProfile
from ident.effects.base import Interval, Variant
from ident.effects.catalogue import find_effect
from ident.effects.effect_info import LAW_SHARE
from ident.inference.profile import Profile
from ident.regression.block_sums import SymmetricSums
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import analyse, at_joint, load_friction_on_2, named


def curved_on_1(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """τ₁ = 6 asinh(dq₁ / 0.2) N m: friction that bends over speed, by another law than the catalogue's."""
    return at_joint(0, 6.0 * np.arcsinh(dq[:, 0] / 0.2))


def test_what_a_law_leaves_between_the_points_of_its_grid_needs_no_name(short_arm: ArmModel) -> None:
    """Law: what a coarse point left is no second name once the grid is fine; two causes are both needed."""
    alone = ("nonlinear_viscous_friction", "joint_1")
    assert named(analyse(short_arm, curved_on_1)) == {alone}
    both = analyse(short_arm, lambda *states: curved_on_1(*states) + load_friction_on_2(*states))
    assert named(both) == {alone, ("load_dependent_friction", "joint_2")}


def test_certain_is_what_chance_makes_in_one_of_twenty() -> None:
    """Law: Wald's test keeps its error, sees what any direction of the columns shows, and asks for columns."""
    rng = np.random.default_rng(3)
    root = np.array([[1.0, 0.0, 0.0], [0.9, 0.4, 0.0], [-0.3, 0.2, 2.0]])
    cells = root @ root.T
    draws = rng.normal(size=(2000, 3)) @ root.T
    assert np.mean([is_significant(one, cells, (0, 2)) for one in draws]) == pytest.approx(0.05, abs=0.015)
    # Neither is far from zero alone; their difference is.
    assert is_significant(np.array([1.0, -1.0, 0.0]), cells, (0, 1))
    assert not is_significant(np.array([9.0, 9.0, 9.0]), cells, ())


def test_a_figure_held_at_zero_by_its_sign_is_not_told_as_certain(short_arm: ArmModel) -> None:
    """Law: whatever signs hold at zero, all coefficients keep a variance, and none is negative that mustn't be."""
    analysis = analyse(short_arm, load_friction_on_2, [find_effect("load_dependent_friction")])
    scorer = analysis.conclusion.held_out
    fine = Refined(Candidates(scorer.evidence, scorer.prior, scorer), tuple(analysis.conclusion.groups))
    effect = fine.groups[0].effect
    # A law of the opposite sign: all that may not be negative is held at zero.
    evidence = fine.search.evidence
    sums = tuple(SymmetricSums.of(mirrored(one.part(np.arange(one.size)))) for one in evidence.free)
    tied = replace(evidence.friction, sums=tuple(pieces * signs_of(pieces) for pieces in evidence.friction.sums))
    for one in (evidence, replace(evidence, free=sums, friction=tied)):
        again = replace(fine, search=Candidates(one, fine.search.prior, HeldOut(one, fine.search.prior)))
        ((beta, cells),), _ = solve_effects(again, [False])
        assert np.all(beta[list(effect.nonnegative)] >= 0.0)
        assert np.all(np.diag(cells) > 0.0)


def signs_of(sums: Array) -> Array:
    """Minus one for the torque, one for all columns."""
    return np.append(np.ones(sums.shape[-1] - 1), -1.0)


def mirrored(sums: Array) -> Array:
    """Sums of the same columns with the torque of the opposite sign."""
    sign = signs_of(sums)
    return sums * sign[:, None] * sign


DROP = 1.92


@pytest.mark.parametrize("kind", [Profile, ChangeProfile])
@pytest.mark.parametrize(
    ("falls", "open_", "words"),
    [
        ((-9.0, -3.0, 0.0, -3.0, -9.0), "", r"^0.06 rad/s \["),
        ((-9.0, -6.0, -3.0, -0.5, 0.0), "high", "^at least"),
        ((0.0, -0.5, -3.0, -6.0, -9.0), "low", "^at most"),
        ((-0.3, -0.1, 0.0, -0.1, -0.2), "both", "or anything else"),
    ],
)
def test_an_end_that_was_not_tried_is_open(
    kind: type[Profile] | type[ChangeProfile], falls: tuple[float, ...], open_: str, words: str
) -> None:
    """Law: an interval ends half a step beyond the grid, and says which end the recordings leave open."""
    effect, speeds = find_effect("stribeck_friction"), (0.015, 0.03, 0.06, 0.12, 0.24)
    points = [Group(effect, 0, Variant({"stribeck_velocity_rad_s": v, "exponent": 1.0}), np.arange(1)) for v in speeds]
    best = points[int(np.argmax(falls))]
    many = (np.ones(1),) * 5, (np.eye(1),) * 5
    found = kind(best, tuple(points), np.array(falls), *many, DROP).inner_parameters()["stribeck_velocity_rad_s"]
    assert found.open == open_
    assert 0.015 / 2**0.51 < found.low <= found.value <= found.high < 0.24 * 2**0.51
    assert re.search(words, found.words("rad/s"))
    assert found.to_dict().get("open", "") == open_


def test_intervals_hold_what_laws_may_differ() -> None:
    """Law: no interval is narrower than an arm's own law may be off, but of parameters that are counted."""
    sharp = Interval(2.0, 1.99, 2.01)
    doubt = find_effect("torque_ripple").doubt
    wide = widen_interval(sharp, doubt.of("amplitude_Nm", 2.0))
    assert wide.value == 2.0
    assert wide.high - wide.value == pytest.approx(np.hypot(0.01, LAW_SHARE * 2.0))
    assert widen_interval(sharp, doubt.of("order", 2.0)) == sharp
    # A size that may be nothing is never less: a knee in speed is not a negative speed. A place may lie on either side.
    edge = Interval(2.0, 0.0, 3.0)
    assert widen_interval(edge, doubt.of("amplitude_Nm", 2.0)).low == 0.0
    assert widen_interval(edge, doubt.of("phase_rad", 2.0), place=True).low < 0.0
    assert widen_interval(sharp, doubt.of("phase_rad", 2.0)).high == pytest.approx(2.0 + np.hypot(0.01, 0.4))
