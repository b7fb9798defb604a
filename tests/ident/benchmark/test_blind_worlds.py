"""Scores by the worlds of the cases."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from made_up_cases import answer, finding, result, truth

from ident.benchmark.cases import FULL_MIX, Slot, draw_case, draw_world_of, name_by_evidence, plan_slots
from ident.benchmark.run import edit_case, edited_arm, error_ratio, rms_left, tuned_arm, twins_of
from ident.benchmark.score_rules import EDIT_WITHIN
from ident.benchmark.scores import auroc, calibration_curve, calibration_error, mean, share
from ident.benchmark.scoring import Outcome, score_case
from ident.benchmark.summary import BlindReport
from ident.effects.transmission import SpringTorque
from ident.export.identified import IdentifiedArm
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.simulation.hardware import Hardware
from ident.simulation.simulate import SimulationOptions, simulate
from ident.simulation.world import PRESETS, World, draw_world_arm, find_worlds, noise_density
from tests.ident.diagnosis.planted import analyse, nothing, record, spring_on_3
from tests.schemas import check_record

RIGHT = finding("stribeck_friction", "joint_2", amplitude_Nm=(0.9, 1.1))
WRONG = finding("torque_delay", "joint_1", "joint_2")


def world_of(number: int, **changes: object) -> World:
    return replace(PRESETS["any"].draw(np.random.default_rng(number)), **{"copied_link": False, **changes})


def outcome(number: int, world: World, *found: dict, hidden: bool = True, verdict: str = "named") -> Outcome:  # type: ignore[type-arg]
    true = answer(*([truth(amplitude_Nm=1.0)] if hidden else []))
    slot = Slot(f"case_{number:02d}", "single" if hidden else "healthy", amplitude=3.0 if hidden else 0.0)
    return score_case(slot, replace(true, world=world.to_dict()), result(*found, verdict=verdict))


def fine_and_coarse() -> tuple[Outcome, ...]:
    """With fine encoders every effect is named and every arm healthy; with coarse ones none is."""
    cases = []
    for i in range(32):
        coarse, hidden = i % 2 == 1, i % 4 < 2
        noise = 5e-4 if coarse else 5e-6
        world = world_of(
            i, encoder_noise_rad=noise, encoder_bits=24, encoder_at="link", link_error=0.0, com_error_m=0.0
        )
        found = [WRONG] if coarse else [RIGHT] if hidden else []
        cases.append(outcome(i, world, *found, hidden=hidden, verdict="named" if found else "no_gap"))
    return tuple(cases)


def report_of(cases: tuple[Outcome, ...]) -> BlindReport:
    return BlindReport("several", 7, {}, cases, {})


def test_strata_part_the_worlds_that_differ() -> None:
    worlds = report_of(fine_and_coarse()).worlds
    fine, coarse = worlds["encoder_noise_rad"]
    assert (fine["low"], fine["high"]) == pytest.approx((1e-6, 1e-5))
    assert (coarse["low"], coarse["high"]) == pytest.approx((1e-4, 1e-3))
    assert [(one["strict"], one["told_gap"], one["cases"]) for one in (fine, coarse)] == [
        (1.0, 0.0, 16),
        (0.0, 1.0, 16),
    ]
    assert "encoder_at" not in worlds  # the same in all
    assert all(sum(one["cases"] for one in strata) == 32 for strata in worlds.values())


def test_the_worst_stratum_is_reported_and_thin_ones_are_not() -> None:
    worst = report_of(fine_and_coarse()).worst
    assert worst["strict"] == 0.0
    assert report_of(fine_and_coarse()[:8]).worst is None


def test_what_a_wrong_urdf_makes_true_is_no_false_name() -> None:
    link = finding("link_inertial_error", "joint_3")
    wrong, sound = world_of(1, link_error=0.2), world_of(1, link_error=0.01, com_error_m=0.001)
    excused, blamed = (outcome(1, world, link, hidden=False) for world in (wrong, sound))
    assert not excused.has_false_name
    assert excused.urdf_wrong
    assert blamed.has_false_name
    beside = outcome(2, wrong, link, RIGHT)
    assert beside.strict
    assert not beside.has_companion
    assert outcome(2, sound, RIGHT, link).has_companion


def test_the_curve_of_refusals() -> None:
    assert auroc([0.9, 0.8], [0.1, 0.2]).value == 1.0
    assert auroc([0.5, 0.5], [0.5]).value == 0.5
    assert auroc([0.1], [0.2, 0.05]).value == 0.5
    assert auroc([], [0.1]).value is None


def test_cases_take_the_worlds_in_turn_and_again_the_same() -> None:
    worlds = find_worlds("fine-encoder,hobby,scara")
    drawn = [draw_world_of(i, 4, worlds) for i in range(30)]
    assert [draw_world_of(i, 4, worlds) for i in range(30)] == drawn
    names = [one.name for one in drawn if one]
    assert all(set(names[i : i + 3]) == {"fine-encoder", "hobby", "scara"} for i in range(0, 30, 3))
    assert draw_world_of(0, 4, ()) is None
    # Where nothing shows as much as it should, another world is tried.
    again = [draw_world_of(0, 4, worlds, k) for k in range(3)]
    assert again[0] == drawn[0]
    assert {one.name for one in again if one} == set(names)


def test_a_case_is_what_its_world_says() -> None:
    world = world_of(5)
    base = SimulationOptions().in_world(world)
    slot = plan_slots(1, FULL_MIX, 1)[0]
    options, _ = draw_case(slot, 0, 1, base, ("a", "b"))
    assert (options.robot, options.runs, options.rate) == (world.robot, world.runs, world.rate_hz)
    assert options.world == world


def test_the_record_has_the_scores_over_each_property() -> None:
    report = report_of(fine_and_coarse())
    record = json.loads(json.dumps(report.to_dict(), allow_nan=False))
    first = record["worlds"]["encoder_noise_rad"][0]
    assert {"low", "high", "cases", "strict", "false_alarm", "told_gap"} <= set(first)
    assert record["worst_stratum"]["strict"] == 0.0


def ask(*signatures: tuple[float, ...]) -> float:
    rows = np.array(signatures)
    return name_by_evidence(rows @ rows.T, np.random.default_rng(1))


def test_what_is_large_and_alone_is_named() -> None:
    assert ask((12.0, 0.0, 0.0), (0.0, 9.0, 0.0), (0.0, 0.0, 20.0)) > 0.99


def test_twins_are_a_coin_and_what_is_hidden_is_not_named() -> None:
    assert ask((12.0, 0.0), (12.0, 0.0)) == pytest.approx(0.5, abs=0.3)
    assert ask((0.05, 0.0), (0.0, 9.0)) < 0.2


def test_the_density_of_noise_holds_its_variance() -> None:
    """Over all frequencies it adds up to the variance; above half of the log rate nothing is seen."""
    arm = ArmModel.load("tm5-900")
    world = replace(world_of(1, robot="tm5-900"), rate_hz=200.0, coloured_share=0.3, corner_hz=2.0)
    world = replace(world, encoder_noise_rad=1e-6, encoder_bits=24, encoder_at="motor")
    hardware: Hardware = draw_world_arm(arm, world, np.random.default_rng(2))
    hardware = hardware.replace(sensing=hardware.sensing.replace(count_noise=0.0, count=np.full(6, 1e-12)))
    f = np.linspace(0.0, 100.0, 20001)
    variance = np.trapezoid(noise_density(hardware, world, f), f, axis=0)
    np.testing.assert_allclose(np.sqrt(variance), hardware.sensing.noise_floor, rtol=0.02)
    assert np.isinf(noise_density(hardware, world, np.array([101.0]))).all()


def test_efficiency_is_ours_over_the_oracles() -> None:
    world = world_of(3)
    cases = [replace(outcome(i, world, *([RIGHT] if i < 2 else [])), oracle=0.8) for i in range(4)]
    report = BlindReport("several", 1, {}, tuple(cases), {})
    assert report.efficiency["3"].value == pytest.approx(0.5 / 0.8)
    assert report.to_dict()["scores"]["efficiency"] == {"3": pytest.approx(0.625)}
    assert "efficiency: 3x 0.625" in report.summary()


JOINT = 2  # of the spring


@pytest.fixture(scope="module")
def spring(three_joints: ArmModel) -> dict[str, Any]:
    """What a diagnosis says of an arm with a spring."""
    return analyse(three_joints, spring_on_3, [SpringTorque()]).diagnosis.to_dict()


@pytest.fixture(scope="module")
def healthy(three_joints: ArmModel) -> dict[str, Any]:
    """What it says of the same arm without."""
    return analyse(three_joints, nothing, [SpringTorque()]).diagnosis.to_dict()


@pytest.fixture(scope="module")
def motions(three_joints: ArmModel) -> Sequence[Motion]:
    return record(three_joints, nothing)


def ratio(model: IdentifiedArm, healthy: Mapping[str, Any], motions: Sequence[Motion], arm: ArmModel) -> float:
    return error_ratio(rms_left(model, motions)[[JOINT]], rms_left(tuned_arm(healthy, arm), motions)[[JOINT]])


def test_a_cause_with_right_figures_can_be_taken_out(
    three_joints: ArmModel, spring: dict[str, Any], healthy: dict[str, Any], motions: Sequence[Motion]
) -> None:
    """Law: the patched model less its cause is the model of the arm without it; with the cause left in it is not."""
    assert [one["effect"] for one in spring["findings"]] == ["spring_torque"]
    assert ratio(edited_arm(spring, three_joints, [0]), healthy, motions, three_joints) <= EDIT_WITHIN
    assert ratio(edited_arm(spring, three_joints), healthy, motions, three_joints) > 2.0


def test_a_cause_that_went_into_tuning_cannot(
    three_joints: ArmModel, spring: dict[str, Any], healthy: dict[str, Any], motions: Sequence[Motion]
) -> None:
    """Law: where tuning took the cause, taking the name out leaves what tuning took."""
    assert ratio(tuned_arm(spring, three_joints), healthy, motions, three_joints) > EDIT_WITHIN
    swapped = {**spring, "baseline": {**spring["baseline_alone"]}}
    swapped["baseline"]["joint_3"]["laws"] = spring["baseline"]["joint_3"]["laws"]
    assert ratio(edited_arm(swapped, three_joints, [0]), healthy, motions, three_joints) > EDIT_WITHIN


def test_the_twin_is_the_arm_of_the_case_without_its_cause() -> None:
    """Law: a case without a cause is its own twin, to the bit; a cause changes nothing of the twin; the other motions
    are others.
    """
    options = SimulationOptions(seed=5, runs=1, duration=3.0, motions=("spline",))
    twin, other = twins_of(options)
    case = simulate(options).session
    np.testing.assert_array_equal(case.runs[0].effort, twin.runs[0].effort)
    assert not np.array_equal(other.runs[0].position[:100], twin.runs[0].position[:100])
    shifted = twins_of(replace(options, effects=("torque_offset:joint_1:3.0",)))[0]
    np.testing.assert_array_equal(case.runs[0].effort, shifted.runs[0].effort)


def test_where_nothing_true_is_named_there_is_no_test() -> None:
    diagnosis = {"findings": [finding("payload", "joint_3")]}
    assert edit_case(SimulationOptions(), answer(truth()), diagnosis) == {"why": "nothing true was named"}


def test_edits_are_told_by_effect() -> None:
    """Law: the share passed counts the tests alone; without any there is no score."""
    world = world_of(3)
    ratios = (1.05, 1.3, None)
    cases = [
        replace(outcome(i, world, RIGHT), edit=None if r is None else {"edited": r, "tuned": 3.0, "unedited": 5.0})
        for i, r in enumerate(ratios)
    ]
    report = BlindReport("several", 1, {}, tuple(cases), {})
    assert report.scores["edit"].value == pytest.approx(0.5)
    seen = json.loads(json.dumps(report.to_dict()))["edits"]["stribeck_friction"]
    assert seen["cases"] == 2
    assert seen["median"]["edited"] == pytest.approx(1.175)
    assert "edit" not in BlindReport("several", 1, {}, tuple(cases[2:]), {}).scores


def test_wilsons_interval() -> None:
    """8 of 10 (Wilson 1927; Newcombe 1998): 0.490 to 0.943; it stays inside [0, 1]."""
    score = share([True] * 8 + [False] * 2)
    assert (score.low, score.high) == pytest.approx((0.4902, 0.9433), abs=1e-3)
    assert share([True] * 5).high == 1.0
    assert share([]).value is None


def test_a_mean_lies_in_its_interval() -> None:
    score = mean([1.0, 2.0, 3.0])
    assert score.value == 2.0
    assert 1.0 <= score.low < 2.0 < score.high <= 3.0  # type: ignore[operator]


def test_calibration_error_is_zero_when_probabilities_are_meant() -> None:
    said = [0.75] * 100 + [0.25] * 100
    right = [True] * 75 + [False] * 25 + [True] * 25 + [False] * 75
    assert calibration_error(said, right).value == pytest.approx(0.0)
    assert calibration_error([1.0] * 10, [True] * 5 + [False] * 5).value == pytest.approx(0.5)
    assert [score.count for *_, score in calibration_curve(said, right)] == [100, 100]


def outcomes() -> tuple[Outcome, ...]:
    """Two visible effects (one missed), a small one, two healthy sessions (one alarm), a refusal, a pair."""
    stribeck = answer(truth(amplitude_Nm=1.0))
    right = finding("stribeck_friction", "joint_2", amplitude_Nm=(0.9, 1.1))
    pair = answer(truth(), truth("payload", ""))
    return (
        score_case(Slot("case_0", "single", amplitude=3.0), stribeck, result(right)),
        score_case(Slot("case_1", "single", amplitude=1.0), stribeck, result(verdict="no_gap")),
        score_case(Slot("case_2", "single", amplitude=0.3), stribeck, result(right)),
        score_case(Slot("case_3", "healthy", amplitude=0.0), answer(), result(verdict="no_gap")),
        score_case(Slot("case_4", "healthy", amplitude=0.0), answer(), result(right)),
        score_case(Slot("case_5", "outside", amplitude=3.0), answer(truth("cable_drag")), result(verdict="partial")),
        score_case(Slot("case_6", "pair", amplitude=3.0), pair, result(right, finding("payload", "joint_3"))),
    )


@pytest.fixture
def report() -> BlindReport:
    cases = outcomes()
    return BlindReport("tm5-900", 7, {one.name: "ab" * 32 for one in cases}, cases, {"cases": len(cases)})


def test_scores_count_the_cases_that_they_speak_of(report: BlindReport) -> None:
    values = {name: (score.value, score.count) for name, score in report.scores.items()}
    assert values["strict"] == (0.5, 2)
    assert values["class_aware_small"] == (1.0, 1)
    assert values["false_alarm"] == (0.5, 2)
    assert values["false_alarm_decoy"] == (None, 0)
    assert values["refusal"] == (1.0, 1)
    assert values["set_f1"] == (1.0, 1)
    assert values["interval_coverage"] == (1.0, 2)


def test_the_record_is_the_contracts(report: BlindReport) -> None:
    record = check_record(report.to_dict())
    assert record["schema"] == "ident.blind/1"
    assert record["cases"] == 7
    assert record["confusion"] == {"stribeck_friction": {"stribeck_friction": 2, "no_gap": 1}}
    assert record["confidently_wrong"] == ["case_4"]
    assert record["baselines"]["lasso"]["strict"] == 0.0
    wanted = {"strict", "class_aware", "joint", "mean_class_size", "false_alarm", "refusal", "set_f1"}
    wanted |= {"shrink_vs_oracle", "calibration_error", "interval_coverage"}
    assert wanted <= record["scores"].keys()
    assert record["intervals"]["strict"] == pytest.approx([0.0945, 0.9055], abs=1e-3)
    assert np.isclose(record["seconds_per_case"], 5.0)
