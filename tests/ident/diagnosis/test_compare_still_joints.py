"""A joint that stands still in one of two sets: only torque beyond its static friction shows, the rest is compared."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.change.compare import compare
from ident.diagnosis.change.result import ArmComparison, Side
from ident.diagnosis.change.static_joints import find_static_joints
from ident.motion.motion import Motion
from ident.recordings.recording import Payload
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.show.changes import describe_still, without_still
from ident.show.report.diagnosis_pages import render_comparison_report
from tests.ident.diagnosis.planted import COULOMB, NOISE, Plant, at_joint, healthy_torque, load_arm, nothing
from tests.ident.made_up import exact_motion, multisine
from tests.schemas import check_record

STILL, ANGLE = 2, 0.4
OFFSET = 0.7  # [N m]
LOAD = Payload(1.2, (0.05, 0.0, 0.06))


def runs_of(arm: ArmModel, plant: Plant, seeds: range, held: bool) -> list[Motion]:
    """Runs in which the last joint is held at an angle, or moves like the others."""
    found = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        time = np.arange(400) / 50.0
        q, dq, ddq = multisine(rng, time, arm.n)
        if held:
            q[:, STILL], dq[:, STILL], ddq[:, STILL] = ANGLE, 0.0, 0.0
        tau = healthy_torque(arm, q, dq, ddq) + plant(arm, q, dq, ddq) + NOISE * rng.standard_normal(q.shape)
        found.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{seed}"))
    return found


def with_offset(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return at_joint(0, np.full(len(q), OFFSET))


def with_load(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return arm.with_payload(LOAD).inverse_dynamics(q, dq, ddq) - arm.inverse_dynamics(q, dq, ddq)


def held_by_friction(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """At rest a joint's torque may be any that dry friction takes up."""
    return at_joint(STILL, np.full(len(q), COULOMB[STILL]))


def pushed(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """A hand on the joint at rest, far beyond its static friction."""
    return at_joint(STILL, np.full(len(q), 8.0 * COULOMB[STILL]))


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return load_arm()


def compared(arm: ArmModel, plant: Plant, held: tuple[bool, bool]) -> ArmComparison:
    before = runs_of(arm, nothing, range(100, 104), held[0])
    return compare(before, runs_of(arm, plant, range(110, 114), held[1]), arm, (Side(), Side()))


@pytest.mark.parametrize(
    ("held", "when"),
    [((True, False), "before"), ((False, True), "after"), ((True, True), "before and after")],
)
def test_the_rest_of_the_arm_is_compared(arm: ArmModel, held: tuple[bool, bool], when: str) -> None:
    found = compared(arm, with_offset, held)
    assert [(one.effect, one.joints) for one in found.changes] == [("torque_offset", ("joint_1",))]
    told = found.changes[0].estimate.parameters["offset_Nm"]
    assert told.low <= OFFSET <= told.high
    assert [(one.name, one.when, one.crept) for one in found.still] == [("joint_3", when, False)]
    assert set(found.rms_before) == set(found.noise) == set(arm.joint_names)
    silent = {one.effect.id for one in found.not_testable if one.joint == STILL}
    assert "friction_change" in silent


def test_a_load_is_weighed_by_the_joints_that_move(arm: ArmModel) -> None:
    (change,) = compared(arm, with_load, (True, False)).changes
    assert "payload" in change.estimate.rivals
    figure = change.estimate.parameters["mass_kg" if change.effect == "payload" else "mass_change_kg"]
    assert figure.low <= LOAD.mass_kg <= figure.high


@pytest.mark.parametrize("held", [(True, False), (False, True)])
def test_what_friction_may_hold_is_no_change(arm: ArmModel, held: tuple[bool, bool]) -> None:
    found = compared(arm, held_by_friction, held)
    assert (found.verdict, found.changes) == ("no_change", ())
    record = check_record(found.to_dict() | {"provenance": Provenance("ident compare").to_dict()})
    (line,) = describe_still(record)
    assert line.startswith("of joint_3 only torque beyond its static friction shows: it stood still")
    assert all("stood still" not in one["reason"] for one in without_still(record))
    assert f"{line[0].upper()}{line[1:]}." in render_comparison_report(record)


def test_a_push_far_beyond_static_friction_is_told_of_a_joint_at_rest(arm: ArmModel) -> None:
    found = compared(arm, pushed, (True, True))
    assert found.changes
    assert {joint for one in found.changes for joint in one.joints} == {"joint_3"}


def test_a_joint_that_creeps_is_told_from_one_at_rest(arm: ArmModel) -> None:
    """An encoder so coarse that its noise moves faster than the joint does."""
    runs = runs_of(arm, nothing, range(2), False)
    std = np.array(runs[0].std)
    std[1, 1] = 10.0
    coarse = [replace(motion, std=std) for motion in runs]
    assert find_static_joints(runs, runs) == ()
    (one,) = find_static_joints(runs, coarse)
    assert (one.joint, one.when, one.crept) == (1, "after", True)
    assert "encoder" in one.reason
