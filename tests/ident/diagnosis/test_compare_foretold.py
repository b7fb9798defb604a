"""Laws of the verdict: nothing changed only where the model of either set foretells the other."""

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.change.change_sets import choose_set
from ident.diagnosis.change.compare import compare
from ident.diagnosis.change.foretold import find_unforetold
from ident.diagnosis.change.looks import hidden_changes
from ident.diagnosis.change.paired_design import build_design
from ident.diagnosis.change.result import ArmComparison, Side
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.show.report.diagnosis_pages import render_comparison_report
from ident.show.terminal import headline
from tests.ident.diagnosis.planted import COULOMB, NOISE, SLIP, Plant, at_joint, carrying, healthy_torque, record
from tests.ident.made_up import exact_motion, multisine
from tests.schemas import check_record

LOAD = Payload(1.2, (0.05, 0.0, 0.06))
PUSH, HELD, ANGLE = 50.0, 2, 0.4  # [N m], a joint, [rad]


def wrong_everywhere(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """What no column of the baseline is, before and after: a spring that hardens, heavier links, an offset."""
    spring = at_joint(2, 1.5 * np.sin(2 * q[:, 2])) + at_joint(0, np.full(len(q), 0.8))
    return spring + 0.15 * arm.inverse_dynamics(q, dq, ddq)


def beside(plant: Plant) -> Plant:
    return lambda arm, *states: wrong_everywhere(arm, *states) + plant(arm, *states)


def rubs_more(share: float) -> Plant:
    return beside(lambda arm, q, dq, ddq: at_joint(1, share * COULOMB[1] * np.tanh(dq[:, 1] / SLIP)))


with_load = beside(carrying(LOAD))
with_offset = beside(lambda arm, q, dq, ddq: at_joint(0, np.full(len(q), 0.7)))


def unforetold(arm: ArmModel, plant: Plant, seed: int, runs: int) -> set[str]:
    """Joints of which one of two sets of a few runs does not foretell the other."""
    before = record(arm, wrong_everywhere, range(seed, seed + runs))
    after = record(arm, plant, range(seed + 50, seed + 50 + runs))
    design = build_design(before, after, arm)
    likely = choose_set(design, hidden_changes(design))
    return {one.joint for one in find_unforetold(design, likely.chosen)}


@pytest.mark.parametrize("seed", [0, 100, 200, 300])
def test_an_arm_that_did_not_change_is_foretold(three_joints: ArmModel, seed: int) -> None:
    """Law: however wrong the model, of an arm that is the same each set foretells the other, two runs a side too."""
    assert unforetold(three_joints, wrong_everywhere, seed, 2) == set()


@pytest.mark.parametrize(
    ("plant", "joint"), [(with_load, "joint_2"), (with_offset, "joint_1"), (rubs_more(0.5), "joint_2")]
)
@pytest.mark.parametrize("seed", [0, 100])
def test_what_changed_is_not_foretold_by_two_runs(three_joints: ArmModel, plant: Plant, joint: str, seed: int) -> None:
    """Law: a load, an offset and friction of half as much again are changes, whether two runs let a law be named."""
    found = unforetold(three_joints, plant, seed, 2)
    assert joint in found


def test_friction_of_a_warm_day_is_foretold(three_joints: ArmModel) -> None:
    """Law: a joint that rubs by 5 % more is as joints are from day to day."""
    assert unforetold(three_joints, rubs_more(0.05), 0, 4) == set()


def test_an_error_of_many_times_the_noise_is_a_change_by_no_law(three_joints: ArmModel) -> None:
    """Law: what neither set's model can say, its own least of all, is still no `no_change`, of two runs a side."""
    before = record(three_joints, wrong_everywhere, range(2))
    law = beside(lambda arm, q, dq, ddq: at_joint(1, 4.0 * np.sin(11.0 * q[:, 0] * q[:, 2])))
    found = compare(before, record(three_joints, law, range(50, 52)), three_joints, (Side(), Side()))
    assert found.verdict == "changed_unexplained"
    assert {one.joint for one in (*found.unforetold, *found.risen)} == {"joint_2"}


def test_what_is_not_foretold_is_told_where_and_by_how_much(three_joints: ArmModel) -> None:
    """Law: record, line and page say the joint and its error, whether a law was named or none."""
    sets = record(three_joints, wrong_everywhere, range(2)), record(three_joints, with_load, range(50, 52))
    found = compare(*sets, three_joints, (Side(), Side()))
    assert found.verdict.startswith("changed")
    provenance = {"provenance": Provenance("ident compare").to_dict()}
    (row,) = [one for one in check_record(found.to_dict() | provenance)["unforetold"] if one["joint"] == "joint_2"]
    assert row["low"] < row["ratio"] < row["high"]
    assert row["usual_Nm"] == pytest.approx(row["error_Nm"] / row["ratio"])
    nameless = replace(found, changes=(), verdict="changed_unexplained").to_dict() | provenance
    words, order = headline(check_record(nameless))
    assert "joint_2 is off by" in words
    assert "alone" in order
    assert words in render_comparison_report(nameless)


def held(arm: ArmModel, push: float, seeds: range) -> list[Motion]:
    """Runs in which the last joint is held at an angle, and hangs on a weight; friction takes up what it likes."""
    found = []
    for seed in seeds:
        rng, time = np.random.default_rng(seed), np.arange(400) / 50.0
        q, dq, ddq = multisine(rng, time, arm.n)
        q[:, HELD], dq[:, HELD], ddq[:, HELD] = ANGLE, 0.0, 0.0
        stuck = rng.uniform(-1.0, 1.0) * COULOMB[HELD]
        tau = healthy_torque(arm, q, dq, ddq) + at_joint(HELD, np.full(len(q), push + stuck))
        tau = tau + NOISE * rng.standard_normal(q.shape)
        found.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{seed}"))
    return found


def compared_at_rest(arm: ArmModel, push: float) -> ArmComparison:
    sets = held(arm, 0.0, range(100, 103)), held(arm, push, range(110, 113))
    return compare(*sets, arm, (Side(), Side()))


def test_a_level_at_rest_that_moves_is_a_change_whatever_friction_does(three_joints: ArmModel) -> None:
    """Law: dry friction takes up its level, not ten times that."""
    found = compared_at_rest(three_joints, PUSH)
    assert found.verdict in ("changed", "changed_unexplained")
    (row,) = [one for one in found.unforetold if one.joint == three_joints.joint_names[HELD]]
    assert row.error == pytest.approx(PUSH, rel=0.2)


def test_what_friction_takes_up_at_rest_is_foretold(three_joints: ArmModel) -> None:
    found = compared_at_rest(three_joints, 0.0)
    assert found.verdict == "no_change"
    assert found.unforetold == ()
