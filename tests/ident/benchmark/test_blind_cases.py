"""Which cases are drawn."""

from collections import Counter
from typing import Any

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.benchmark.cases import FULL_MIX, TWINS, Slot, draw_case, parse_mix, plan_slots
from ident.benchmark.real_check import rows_of, tables
from ident.benchmark.real_check import score as score_real
from ident.benchmark.scoring import score_case
from ident.benchmark.truth import comparable
from ident.errors import InputError
from ident.simulation.causes import CATALOGUE, OUTSIDE
from ident.simulation.request import EffectRequest
from ident.simulation.simulate import POOR, SimulationOptions

JOINTS = tuple(f"joint_{i}" for i in range(1, 7))


def draw(slot, number=0, seed=1, attempt=0):  # type: ignore[no-untyped-def]
    return draw_case(slot, number, seed, SimulationOptions(), JOINTS, attempt)


def ids(case) -> list[str]:  # type: ignore[no-untyped-def]
    return [one.effect for one in case[0].effects if isinstance(one, EffectRequest)]


def test_the_full_check_holds_every_effect_in_every_size_and_motion() -> None:
    slots = plan_slots(480, FULL_MIX, seed=1)
    singles = [slot for slot in slots if slot.kind == "single"]
    cells = Counter((slot.effect, slot.amplitude, slot.rich) for slot in singles)
    assert {effect for effect, _, _ in cells} == set(CATALOGUE)
    assert all(cells[effect, size, True] == 3 and cells[effect, size, False] == 1 for effect, size, _ in cells)
    assert Counter(slot.kind for slot in slots) == FULL_MIX


def test_the_same_seed_draws_the_same_cases_and_another_does_not() -> None:
    slots = plan_slots(30, FULL_MIX, 5)
    assert slots == plan_slots(30, FULL_MIX, 5)
    assert [draw(slot, i) for i, slot in enumerate(slots)] == [draw(slot, i) for i, slot in enumerate(slots)]
    assert [draw(slot, i, 5)[0].seed for i, slot in enumerate(slots)] != [
        draw(slot, i, 6)[0].seed for i, slot in enumerate(slots)
    ]


def test_kinds_are_what_they_say() -> None:
    for number, slot in enumerate(plan_slots(200, FULL_MIX, 3)):
        options, excluded = case = draw(slot, number, 3)
        found = ids(case)
        count = {"healthy": 0, "decoy": 0, "pair": 2, "triple": 3}.get(slot.kind, 1)
        assert len(set(found)) == count
        assert bool(options.decoys) == (slot.kind == "decoy")
        assert all(one in (OUTSIDE if slot.kind == "outside" else CATALOGUE) for one in found)
        assert (options.motions == POOR) == (not slot.rich)
        assert bool(excluded) == (slot.kind == "excluded")
        if excluded:
            assert excluded == (found[0], *TWINS.get(found[0], ()))


@pytest.mark.parametrize("text", ["nonsense", "single=x", "single=0", "single=-1", ""])
def test_a_mix_that_means_nothing_is_the_users_error(text: str) -> None:
    with pytest.raises(InputError, match="--mix"):
        parse_mix(text)


def test_a_mix_is_read() -> None:
    assert parse_mix("single=2, healthy") == {"single": 2.0, "healthy": 60.0}


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
    seen = finding(
        "position_dependent_friction",
        "joint_2",
        amplitude_Nm=(1.1, 1.2),
        order=(1.4, 2.8),
        phase_rad=(-np.pi - 0.2, -np.pi + 0.2),
    )
    one = score(answer(true), result(seen))
    assert {cover["parameter"]: cover["inside"] for cover in one.coverage} == {
        "amplitude_Nm": False,
        "order": True,
        "phase_rad": True,
    }


def test_a_push_is_timed_on_the_clock_of_the_session() -> None:
    true = truth("external_contact", "joint_2", run=2.0, start_s=1.0, end_s=2.0, force_N=20.0)
    seen = finding("external_contact", "joint_2", start_s=(30.9, 31.1), end_s=(31.9, 32.1), force_N=(1.0, 2.0))
    one = score(answer(true), result(seen), starts=(0.0, 30.0))
    assert [(cover["parameter"], cover["inside"]) for cover in one.coverage] == [("start_s", True), ("end_s", True)]


def test_shrink_is_measured_against_the_true_name_alone() -> None:
    """Closing half of what the truth closes is a half, whatever the other view says."""
    none, half, full = [0.1, 0.5, *[0.1] * 4], [0.1, np.sqrt(0.13), *[0.1] * 4], [0.1] * 6
    alone = {"stribeck_friction:joint_2": {"view": "tuned", "rms": full}}
    heldout = {"tuned": {"none": none, "named": half}, "fixed": {"none": none, "named": none}, "alone": alone}
    one = score(answer(truth()), result(finding("stribeck_friction", "joint_2"), heldout=heldout))
    assert one.shrink_share == pytest.approx(0.5)
    assert score(answer(truth("payload", "")), result(heldout=heldout)).shrink_share is None


@pytest.mark.parametrize(
    ("effect", "name", "true", "seen"),
    [
        ("encoder_offset", "offset_rad", 0.02, -0.02),  # read too much; to be added
        ("gravity_misalignment", "tilt_x_rad", 0.01, -0.01),  # gravity turns; the base stands
        ("torque_delay", "delay_s", 0.004, 0.004),
    ],
)
def test_signs_of_the_plant_and_of_the_diagnosis(effect: str, name: str, true: float, seen: float) -> None:
    assert comparable(truth(effect, "joint_2", **{name: true}), ())[name] == seen


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


def _finding(effect: str, joint: str, p: float = 0.9, **more: Any) -> dict[str, Any]:
    return {"effect": effect, "class": [effect], "joints": [joint], "probability": p, "parameters": {}, **more}


def _answer(kind: str, *effects: dict[str, Any]) -> dict[str, Any]:
    return {"kind": kind, "arm": "a", "control": "control", "effects": list(effects)}


PLANTED = {
    "effect": "spring_torque",
    "asked": 3.0,
    "in_catalogue": True,
    "joints": ["j2"],
    "may_stand_at": ["j2"],
    "parameters": {"stiffness_Nm_rad": 2.0, "other_joint": "j1"},
}
CONTROL = {"diagnosis": {"verdict": "partial", "findings": [_finding("stribeck_friction", "j1")]}}


def _rows(kind: str, findings: list[dict[str, Any]], *effects: dict[str, Any]) -> Any:
    seen = {"control": CONTROL, "case": {"diagnosis": {"verdict": "named", "findings": findings}}}
    return rows_of({"control": _answer("control"), "case": _answer(kind, *effects)}, seen)


def test_a_name_that_the_untouched_arm_has_is_none() -> None:
    for findings, alarm in ([_finding("stribeck_friction", "j1")], 0.0), ([_finding("payload", "j1")], 1.0):
        assert score_real(*_rows("untouched", findings))["scores"]["false_alarm"] == alarm


@pytest.mark.parametrize(
    ("finding", "named", "strict"),
    [
        (_finding("spring_torque", "j2"), 1.0, 1.0),
        (_finding("spring_torque", "j1"), 0.0, 0.0),
        (_finding("spring_torque", "j2", 0.4), 0.0, 0.0),
        (_finding("spring_torque", "j2", 0.4, class_probability=0.6), 1.0, 1.0),
        (_finding("torque_offset", "j2", **{"class": ["torque_offset", "spring_torque"]}), 1.0, 0.0),
    ],
)
def test_the_planted_effect_is_found_in_the_class_at_its_joint(finding: Any, named: float, strict: float) -> None:
    found = score_real(*_rows("single", [finding], PLANTED))["scores"]
    assert (found["class_aware"], found["strict"]) == (named, strict)


@pytest.mark.parametrize(("high", "inside"), [(2.5, 1.0), (1.9, 0.0)])
def test_intervals_are_held_against_what_was_planted(high: float, inside: float) -> None:
    figures = {"stiffness_Nm_rad": {"value": 1.8, "low": 1.0, "high": high}}
    rows = _rows("single", [_finding("spring_torque", "j2", parameters=figures)], PLANTED)
    assert score_real(*rows)["scores"]["interval_coverage"] == inside
    assert any("spring_torque" in line for line in tables(*rows))
