"""The edit test: a cause that is told by right figures can be taken out again; one that went into tuning can't."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from made_up_cases import answer, finding, truth
from test_blind_worlds import RIGHT, outcome, world_of

from ident.benchmark.pages import write_blind_pages
from ident.benchmark.run import edit_case, edited_arm, error_ratio, rms_left, tuned_arm, twins_of
from ident.benchmark.summary import EDIT_WITHIN, BlindReport
from ident.effects.transmission import SpringTorque
from ident.export.identified import IdentifiedArm
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from ident.simulation.simulate import SimulationOptions, simulate
from tests.ident.diagnosis.planted import analyse, load_arm, nothing, record, spring_on_3

JOINT = 2  # of the spring


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return load_arm()


@pytest.fixture(scope="module")
def spring(arm: ArmModel) -> dict[str, Any]:
    """What a diagnosis says of an arm with a spring."""
    return analyse(arm, spring_on_3, [SpringTorque()]).diagnosis.to_dict()


@pytest.fixture(scope="module")
def healthy(arm: ArmModel) -> dict[str, Any]:
    """What it says of the same arm without."""
    return analyse(arm, nothing, [SpringTorque()]).diagnosis.to_dict()


@pytest.fixture(scope="module")
def motions(arm: ArmModel) -> Sequence[Motion]:
    return record(arm, nothing)


def ratio(model: IdentifiedArm, healthy: Mapping[str, Any], motions: Sequence[Motion], arm: ArmModel) -> float:
    return error_ratio(rms_left(model, motions)[[JOINT]], rms_left(tuned_arm(healthy, arm), motions)[[JOINT]])


def test_a_cause_with_right_figures_can_be_taken_out(
    arm: ArmModel, spring: dict[str, Any], healthy: dict[str, Any], motions: Sequence[Motion]
) -> None:
    """Law: the patched model less its cause is the model of the arm without it; with the cause left in it is not."""
    assert [one["effect"] for one in spring["findings"]] == ["spring_torque"]
    assert ratio(edited_arm(spring, arm, [0]), healthy, motions, arm) <= EDIT_WITHIN
    assert ratio(edited_arm(spring, arm), healthy, motions, arm) > 2.0


def test_a_cause_that_went_into_tuning_cannot(
    arm: ArmModel, spring: dict[str, Any], healthy: dict[str, Any], motions: Sequence[Motion]
) -> None:
    """Law: where tuning took the cause, taking the name out leaves what tuning took."""
    assert ratio(tuned_arm(spring, arm), healthy, motions, arm) > EDIT_WITHIN
    swapped = {**spring, "baseline": {**spring["baseline_alone"]}}
    swapped["baseline"]["joint_3"]["laws"] = spring["baseline"]["joint_3"]["laws"]
    assert ratio(edited_arm(swapped, arm, [0]), healthy, motions, arm) > EDIT_WITHIN


def test_nothing_but_the_chosen_names_is_taken_out(arm: ArmModel, spring: dict[str, Any]) -> None:
    """Law: tuning is the same with a name and without; names that are not chosen stay."""
    whole, without = edited_arm(spring, arm), edited_arm(spring, arm, [0])
    assert len(whole.changes) == 1
    assert not without.changes
    np.testing.assert_array_equal(whole.links.tuned, without.links.tuned)
    np.testing.assert_array_equal(whole.losses.coulomb, without.losses.coulomb)


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


def test_edits_are_told_by_effect(tmp_path: Path) -> None:
    """Law: the share passed counts the tests alone; without any there is no score."""
    world = world_of(3)
    ratios = (1.05, 1.3, None)
    cases = [
        replace(outcome(i, world, RIGHT), edit=None if r is None else {"edited": r, "tuned": 3.0, "unedited": 5.0})
        for i, r in enumerate(ratios)
    ]
    report = BlindReport("several", 1, {}, tuple(cases), {})
    assert report.scores["edit"].value == pytest.approx(0.5)
    told = json.loads(json.dumps(report.to_dict()))["edits"]["stribeck_friction"]
    assert told["cases"] == 2
    assert told["median"]["edited"] == pytest.approx(1.175)
    assert "Take the cause out again" in write_blind_pages(report, {}, tmp_path).read_text(encoding="utf-8")
    assert "edit" not in BlindReport("several", 1, {}, tuple(cases[2:]), {}).scores
