"""Laws of what is told of a joint that is left without a name."""

import pytest

from ident.inference.joints_left import BESIDE, COMPARED, NOT_TESTED, JointLeft, Repeated, beside_others

ALIKE = dict.fromkeys(COMPARED, 1.5)


def test_what_all_joints_have_makes_none_stand_out() -> None:
    """Law: an error of the whole arm leaves no difference, one joint's is its own to the full."""
    sound = beside_others([ALIKE] * 6)
    assert all(joint[f"{name}{BESIDE}"] == 0.0 for joint in sound for name in COMPARED)
    worse = {**ALIKE, "smooth_share": 4.0}
    with_one = beside_others([*[ALIKE] * 5, worse])
    assert with_one[5][f"smooth_share{BESIDE}"] == pytest.approx(2.5)
    assert all(joint[f"smooth_share{BESIDE}"] == 0.0 for joint in with_one[:5])


def test_an_only_joint_has_nothing_to_stand_out_from() -> None:
    (joint,) = beside_others([ALIKE])
    assert all(joint[f"{name}{BESIDE}"] == 0.0 for name in COMPARED)
    assert joint["smooth_share"] == 1.5


def test_what_repeats_by_the_angle_speaks_for_a_cause_and_never_against_one() -> None:
    left = JointLeft(0, dict(ALIKE), None)
    none = left.with_repeated(NOT_TESTED).features
    worse = left.with_repeated(Repeated(-0.3, 0.01)).features
    sure = left.with_repeated(Repeated(0.3, 0.01)).features
    unsure = left.with_repeated(Repeated(0.3, 0.3)).features
    assert none == worse
    assert sure["repeated_in_errors"] > unsure["repeated_in_errors"] > none["repeated_in_errors"]
    assert sure["repeated_share"] == unsure["repeated_share"] == 0.3
