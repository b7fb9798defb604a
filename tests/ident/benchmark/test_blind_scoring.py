"""What was said against what was true."""

from __future__ import annotations

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.benchmark.cases import Slot
from ident.benchmark.scoring import comparable, score_case


def score(truth_, result_, kind="single", starts=()):  # type: ignore[no-untyped-def]
    return score_case(Slot("case_000", kind), truth_, result_, starts)


STRIBECK, PAYLOAD = finding("stribeck_friction", "joint_2"), finding("payload", "joint_1")
ALIKE = finding("presliding_hysteresis", "joint_2", rivals=("stribeck_friction",))
ELSEWHERE = finding("stribeck_friction", "joint_5")


@pytest.mark.parametrize(
    ("names", "strict", "class_aware", "joint", "right", "class_size", "wrong"),
    [
        ([STRIBECK], True, True, True, (True,), 1, False),
        ([ALIKE], False, True, True, (False,), 2, True),  # a class that holds the truth is right as a class only
        ([ELSEWHERE], True, True, False, (False,), 1, True),  # at another joint it is no true name
        ([PAYLOAD, STRIBECK], False, False, False, (False, True), 1, True),  # the first name counts
    ],
)
def test_the_first_name_counts_by_itself_by_its_class_and_by_its_joint(
    names, strict, class_aware, joint, right, class_size, wrong
) -> None:  # type: ignore[no-untyped-def]
    one = score(answer(truth()), result(*names))
    assert (one.strict, one.class_aware, one.joint) == (strict, class_aware, joint)
    assert (one.right, one.class_size, one.confidently_wrong) == (right, class_size, wrong)


def test_an_effect_of_the_whole_arm_is_named_where_it_shows() -> None:
    one = score(answer(truth("payload", "")), result(finding("payload", "joint_3")))
    assert one.joint
    assert one.truth == (("payload", ""),)


@pytest.mark.parametrize(
    ("verdict", "worst", "refused"),
    [
        ("none_of_catalogue", "joint_2", True),
        ("partial", "joint_2", True),
        ("none_of_catalogue", "joint_6", False),
        ("named", "joint_2", False),
        ("no_gap", "joint_2", False),
    ],
)
def test_a_refusal_must_point_at_the_right_joint(verdict: str, worst: str, refused: bool) -> None:
    one = score(answer(truth("cable_drag")), result(verdict=verdict, worst=worst), kind="outside")
    assert one.refused is refused


def test_a_failed_diagnosis_is_no_success_and_keeps_its_place() -> None:
    one = score(answer(truth()), {"error": "ValueError: no"})
    assert one.verdict == "failed"
    assert not one.strict
    assert one.truth


def test_intervals_are_compared_in_the_conventions_of_the_diagnosis() -> None:
    """The plant's phase leads, the diagnosis's lags; angles wrap."""
    true = truth("position_dependent_friction", amplitude_Nm=1.0, order=2.0, phase_rad=-np.pi + 0.05)
    told = finding(
        "position_dependent_friction",
        "joint_2",
        amplitude_Nm=(1.1, 1.2),
        order=(1.4, 2.8),
        phase_rad=(-np.pi - 0.2, -np.pi + 0.2),
    )
    one = score(answer(true), result(told))
    assert {cover.parameter: cover.inside for cover in one.coverage} == {
        "amplitude_Nm": False,
        "order": True,
        "phase_rad": True,
    }


def test_a_push_is_timed_on_the_clock_of_the_session() -> None:
    true = truth("external_contact", "joint_2", run=2.0, start_s=1.0, end_s=2.0, force_N=20.0)
    told = finding("external_contact", "joint_2", start_s=(30.9, 31.1), end_s=(31.9, 32.1), force_N=(1.0, 2.0))
    one = score(answer(true), result(told), starts=(0.0, 30.0))
    assert [(cover.parameter, cover.inside) for cover in one.coverage] == [("start_s", True), ("end_s", True)]


def test_shrink_is_measured_against_the_true_name_alone() -> None:
    """Closing half of what the truth closes is a half, whatever the other view says."""
    none, half, full = [0.1, 0.5, *[0.1] * 4], [0.1, np.sqrt(0.13), *[0.1] * 4], [0.1] * 6
    alone = {"stribeck_friction:joint_2": {"view": "tuned", "rms": full}}
    heldout = {"tuned": {"none": none, "named": half}, "fixed": {"none": none, "named": none}, "alone": alone}
    one = score(answer(truth()), result(finding("stribeck_friction", "joint_2"), heldout=heldout))
    assert one.shrink_share == pytest.approx(0.5)
    assert score(answer(truth("payload", "")), result(heldout=heldout)).shrink_share is None


@pytest.mark.parametrize(
    ("effect", "name", "true", "told"),
    [
        ("encoder_offset", "offset_rad", 0.02, -0.02),  # read too much; to be added
        ("gravity_misalignment", "tilt_x_rad", 0.01, -0.01),  # gravity turns; the base stands
        ("torque_delay", "delay_s", 0.004, 0.004),
    ],
)
def test_signs_of_the_plant_and_of_the_diagnosis(effect: str, name: str, true: float, told: float) -> None:
    assert comparable(truth(effect, "joint_2", **{name: true}), ())[name] == told


def test_figures_of_another_meaning_are_not_compared() -> None:
    """The plant's shear-thinning law has no exponent; its thermal changes refer to rated load."""
    viscous = truth("nonlinear_viscous_friction", "joint_2", exponent=0.4, eyring_Nm=1.0)
    assert "exponent" not in comparable(viscous, ())
    assert comparable(truth("thermal_friction", "joint_2", viscous_change=-0.9, time_constant_s=90.0), ()) == {
        "time_constant_s": 90.0
    }


def test_a_coupling_named_at_both_joints_is_found_once() -> None:
    """Either joint names it; two names at its two joints are one cause, none wrong; a wrong name beside them costs."""
    true = answer(truth("joint_coupling", "joint_2", other_joint="joint_1"))
    both = [finding("joint_coupling", joint) for joint in ("joint_1", "joint_2")]
    assert score(true, result(both[0])).right == (True,)
    assert score(true, result(*both)).set_f1 == pytest.approx(1.0)
    assert score(true, result(*both, finding("spring_torque", "joint_6"))).set_f1 == pytest.approx(0.8)
    assert score(answer(truth()), result(PAYLOAD, STRIBECK)).set_f1 == pytest.approx(2 / 3)
