"""Intervals: what chance makes, what signs hold at zero, which ends are open, and what laws may differ by."""

import re
from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.effects.base import Variant
from ident.effects.catalogue import find_effect
from ident.inference.profile import Profile
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


def test_a_figure_held_at_zero_by_its_sign_is_not_told_as_certain(short_arm: ArmModel) -> None:
    """Law: whatever signs hold at zero, all coefficients keep a variance, and none is negative that mustn't be."""
    analysis = analyse(short_arm, load_friction_on_2, [find_effect("load_dependent_friction")])
    search = analysis.conclusion.fine.search
    (group,) = analysis.conclusion.groups
    # A law of the opposite sign: all that may not be negative is held at zero.
    sign = np.append(np.ones(len(search.rest) - 1), -1.0)
    opposite = replace(search, rest=search.rest * sign[:, None] * sign)
    for sums in (search, opposite):
        coefficients = sums.coefficients([group])[group]
        assert np.all(coefficients[list(group.effect.nonnegative)] >= 0.0)
        assert np.all(np.diag(sums.covariance([group], group)) > 0.0)
    assert np.all(opposite.coefficients([group])[group][list(group.signed)] == 0.0)


@pytest.mark.parametrize(
    ("falls", "open_", "words"),
    [
        ((-9.0, -3.0, 0.0, -3.0, -9.0), "", r"^0.06 rad/s \["),
        ((-9.0, -6.0, -3.0, -0.5, 0.0), "high", "^at least"),
        ((0.0, -0.5, -3.0, -6.0, -9.0), "low", "^at most"),
        ((-0.3, -0.1, 0.0, -0.1, -0.2), "both", "the recordings leave it open"),
    ],
)
def test_an_end_that_was_not_tried_is_open(falls: tuple[float, ...], open_: str, words: str) -> None:
    """Law: an interval ends half a step beyond the grid, and says which end the recordings leave open."""
    effect, speeds = find_effect("stribeck_friction"), (0.015, 0.03, 0.06, 0.12, 0.24)
    points = [Group(effect, 0, Variant({"stribeck_velocity_rad_s": v, "exponent": 1.0}), np.arange(1)) for v in speeds]
    best = points[int(np.argmax(falls))]
    many = (np.ones(1),) * 5, (np.eye(1),) * 5
    found = Profile(best, tuple(points), np.array(falls), *many).inner_parameters()["stribeck_velocity_rad_s"]
    assert found.open == open_
    assert 0.015 / 2**0.51 < found.low <= found.value <= found.high < 0.24 * 2**0.51
    assert re.search(words, found.words("rad/s"))
    assert found.to_dict().get("open", "") == open_


@pytest.mark.parametrize("size", [1.0, 1e24])
@pytest.mark.parametrize(("orders", "reach"), [((1.0, 2.0, 3.0), 0.0), ((20.8, 21.0, 21.2), 0.1)])
def test_a_line_of_a_spectrum_is_known_up_to_the_next_ones(
    orders: tuple[float, ...], reach: float, size: float
) -> None:
    """Law: of whole numbers the likeliest is told as it is; between the lines that were tried anything may be; however
    large the evidence.
    """
    effect = find_effect("torque_ripple")
    points = tuple(Group(effect, 0, Variant({"order": order}), np.arange(2)) for order in orders)
    falls = size * np.array([60.0, 100.0, 50.0])
    many = (np.ones(2),) * 3, (np.eye(2),) * 3
    told = Profile(points[1], points, falls, *many).inner_parameters()["order"]
    assert (told.low, told.value, told.high) == pytest.approx((orders[1] - reach, orders[1], orders[1] + reach))
