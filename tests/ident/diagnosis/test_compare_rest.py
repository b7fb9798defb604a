"""Laws of comparing by holds: poses alone tell what gravity tells; what is used of each joint is reported."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from ident.arrays import Array
from ident.checks.report import TelemetryReport
from ident.diagnosis.change.compare import compare
from ident.diagnosis.change.from_reports import as_compared, as_explained
from ident.diagnosis.change.result import ArmChange, ArmComparison, Side
from ident.diagnosis.change.static_joints import find_static_joints
from ident.effects.catalogue import find_effect
from ident.motion.motion import Motion
from ident.recordings.recording import Payload, Session, TelemetryIssue
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.show.report.diagnosis_pages import render_comparison_report
from ident.show.terminal import (
    describe_known,
    describe_notes,
    describe_spread,
    describe_used,
    without_still,
)
from tests.ident.diagnosis.planted import (
    COULOMB,
    NOISE,
    ROTOR,
    SLIP,
    VISCOUS,
    Plant,
    at_joint,
    carrying,
    healthy_torque,
    load_arm,
    nothing,
)
from tests.ident.made_up import exact_motion, multisine
from tests.schemas import check_record

RATE, HOLD_S, SPEED, POSES = 50.0, 2.0, 0.3, 16
LOAD = Payload(1.2, (0.05, 0.0, 0.06))
ZERO, SPRING, TILT = 0.06, 15.0, 0.05  # [rad], [N m/rad], [rad]


def with_tilt(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    gravity = float(np.linalg.norm(np.asarray(arm.model.gravity.linear))) * np.array([np.sin(TILT), 0, -np.cos(TILT)])
    return arm.with_gravity(gravity).gravity(q) - arm.gravity(q)


def with_zero(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    return arm.gravity(q + ZERO * np.eye(3)[1]) - arm.gravity(q)


def session(arm: ArmModel, plant: Plant, seed: int) -> list[Motion]:
    """One run of poses: each hold has a friction torque of its own, anything up to the Coulomb level."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-1.2, 1.2, (POSES, arm.n))
    parts = [_resting(poses[0])]
    for old, new in pairwise(poses):
        parts += [_moving(old, new), _resting(new)]
    q, dq, ddq = (np.concatenate(part) for part in zip(*parts, strict=True))
    friction = COULOMB * np.tanh(dq / SLIP)
    part = np.repeat(np.arange(len(parts)), [len(one[0]) for one in parts])
    for hold in range(0, len(parts), 2):
        friction[part == hold] = rng.uniform(-1.0, 1.0, arm.n) * COULOMB
    tau = arm.inverse_dynamics(q, dq, ddq) + ROTOR * ddq + VISCOUS * dq + friction + plant(arm, q, dq, ddq)
    tau += NOISE * rng.standard_normal(q.shape)
    return [exact_motion(np.arange(len(q)) / RATE, (q, dq, ddq), tau, arm.joint_names, f"poses_{seed}")]


def _resting(pose: Array) -> tuple[Array, Array, Array]:
    q = np.tile(pose, (int(HOLD_S * RATE), 1))
    return q, np.zeros_like(q), np.zeros_like(q)


def _moving(old: Array, new: Array) -> tuple[Array, Array, Array]:
    length = float(np.abs(new - old).max()) / SPEED * 1.875
    s = (np.arange(int(length * RATE)) / (length * RATE))[:, None]
    q = old + (10 * s**3 - 15 * s**4 + 6 * s**5) * (new - old)
    dq = (30 * s**2 - 60 * s**3 + 30 * s**4) * (new - old) / length
    return q, dq, (60 * s - 180 * s**2 + 120 * s**3) * (new - old) / length**2


def compared(plant: Plant) -> ArmComparison:
    arm = load_arm()
    return compare(session(arm, nothing, 100), session(arm, plant, 200), arm, (Side(), Side()))


def test_poses_alone_weigh_a_load_and_say_what_was_used() -> None:
    found = compared(carrying(LOAD))
    (change,) = found.changes
    assert "payload" in change.estimate.rivals
    mass = change.estimate.parameters["mass_kg" if change.effect == "payload" else "mass_change_kg"]
    assert mass.low <= LOAD.mass_kg <= mass.high
    record = check_record(found.to_dict() | {"provenance": Provenance("ident compare").to_dict()})
    for one in record["samples_used"]:
        assert one["in_motion"] + one["at_rest"] + one["turning"] + one["left_out"] == pytest.approx(1.0)
        assert one["holds"] == 2 * POSES
    assert len(describe_used(record)) == sum(one["in_motion"] < 0.5 for one in record["samples_used"])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "effect", "figure", "size"),
    [
        (with_tilt, "gravity_misalignment", "tilt_y_rad", TILT),
        (with_zero, "encoder_offset", "offset_rad", ZERO),
        (lambda arm, q, dq, ddq: at_joint(1, SPRING * q[:, 1]), "spring_torque", "stiffness_Nm_rad", SPRING),
    ],
)
def test_poses_alone_tell_what_is_static(plant: Plant, effect: str, figure: str, size: float) -> None:
    (change,) = compared(plant).changes
    assert effect in change.estimate.rivals
    if change.effect == effect:
        told = change.estimate.parameters[figure]
        assert told.low <= size <= told.high


@pytest.mark.slow
def test_poses_of_an_arm_that_did_not_change_tell_nothing() -> None:
    assert compared(nothing).verdict == "no_change"


def report(*issues: TelemetryIssue) -> TelemetryReport:
    return TelemetryReport(Session("made_up", ()), issues)


def test_what_is_wrong_before_and_after_alike_is_no_reason_to_refuse() -> None:
    """A URDF of guessed masses; an arm that stands still. A log whose unit changed in between stays refused."""
    masses = TelemetryIssue("effort_not_torque", ("a",), "fatal", "follows gravity at 4.7 of its size", "give torque")
    still = TelemetryIssue("insufficient_excitation", ("a",), "fatal", "hardly any motion", "move")
    torn = TelemetryIssue("time_gap", (), "fatal", "a pause", "record without")
    assert as_compared(masses, [report(masses)], [report(masses)]).severity == "warning"
    assert as_compared(masses, [report(masses)], [report()]).severity == "fatal"
    assert as_compared(still, [report(still)], [report()]).severity == "warning"
    assert as_compared(torn, [report(torn)], [report(torn)]).severity == "fatal"


@pytest.mark.parametrize(("effect", "where", "explained"), [("payload", "ab", True), ("payload", "a", False)])
def test_a_factor_that_a_change_explains_is_no_warning(effect: str, where: str, explained: bool) -> None:
    """Law: of the later set, at joints that feel a change of load; what the earlier set read stays a warning."""
    off = TelemetryIssue("torque_scale", ("a", "b"), "warning", "a reads 1.32", "check its gain")
    estimate = SimpleNamespace(group=SimpleNamespace(effect=find_effect(effect)))
    change = cast(ArmChange, SimpleNamespace(estimate=estimate, rms_before=dict.fromkeys(where, 1.0)))
    found = ArmComparison("made_up", ("a", "b"), "changed", changes=(change,))
    for before in (report(), report(replace(off, evidence="a reads 1.12"))):
        assert (as_explained(off, [before], found).severity == "note") is explained
    assert as_explained(off, [report(off)], found) is off


STILL, ANGLE, OFFSET = 2, 0.4, 0.7  # a joint, [rad], [N m]


def runs_held(arm: ArmModel, plant: Plant, seeds: range, held: bool) -> list[Motion]:
    """Runs in which the last joint is held at an angle, or moves like the others."""
    found = []
    for seed in seeds:
        rng, time = np.random.default_rng(seed), np.arange(400) / 50.0
        q, dq, ddq = multisine(rng, time, arm.n)
        if held:
            q[:, STILL], dq[:, STILL], ddq[:, STILL] = ANGLE, 0.0, 0.0
        tau = healthy_torque(arm, q, dq, ddq) + plant(arm, q, dq, ddq) + NOISE * rng.standard_normal(q.shape)
        found.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{seed}"))
    return found


def steady(joint: int, torque: float) -> Plant:
    return lambda arm, q, dq, ddq: at_joint(joint, np.full(len(q), torque))


with_offset = steady(0, OFFSET)
held_by_friction = steady(STILL, COULOMB[STILL])  # at rest a joint's torque may be any that dry friction takes up
pushed = steady(STILL, 8.0 * COULOMB[STILL])  # a hand on the joint at rest, far beyond its static friction


def compared_held(arm: ArmModel, plant: Plant, held: tuple[bool, bool]) -> ArmComparison:
    before = runs_held(arm, nothing, range(100, 104), held[0])
    return compare(before, runs_held(arm, plant, range(110, 114), held[1]), arm, (Side(), Side()))


@pytest.mark.parametrize(
    ("held", "when"),
    [((True, False), "before"), ((False, True), "after"), ((True, True), "before and after")],
)
def test_the_rest_of_the_arm_is_compared(three_joints: ArmModel, held: tuple[bool, bool], when: str) -> None:
    found = compared_held(three_joints, with_offset, held)
    (change,) = found.changes
    # In motion alone an offset is nearly the same as friction that differs by the direction.
    assert "torque_offset" in change.estimate.rivals
    assert change.joints == ("joint_1",)
    if change.effect == "torque_offset":
        told = change.estimate.parameters["offset_Nm"]
        assert told.low <= OFFSET <= told.high
    assert [(one.name, one.when, one.crept) for one in found.still] == [("joint_3", when, False)]
    assert set(found.rms_before) == set(found.noise) == set(three_joints.joint_names)
    assert "friction_change" in {one.effect.id for one in found.not_testable if one.joint == STILL}


@pytest.mark.parametrize("held", [(True, False), (False, True)])
def test_what_friction_may_hold_is_no_change(three_joints: ArmModel, held: tuple[bool, bool]) -> None:
    found = compared_held(three_joints, held_by_friction, held)
    assert (found.verdict, found.changes) == ("no_change", ())
    record = check_record(found.to_dict() | {"provenance": Provenance("ident compare").to_dict()})
    line = describe_notes(record)[-1]
    assert line.startswith("of joint_3 only torque beyond its static friction shows: it stood still")
    assert all("stood still" not in one["reason"] for one in without_still(record))
    page = render_comparison_report(record)
    told = (f"{line[0].upper()}{line[1:]}.", "; a change of friction may", "is assumed, for single runs", "What to do:")
    assert all(words in page for words in told)
    assert "with the changes" not in page
    assert "is assumed" not in describe_spread(record | {"before": {"runs": 3}})


def test_a_push_far_beyond_static_friction_is_told_of_a_joint_at_rest(three_joints: ArmModel) -> None:
    found = compared_held(three_joints, pushed, (True, True))
    assert found.changes
    assert {joint for one in found.changes for joint in one.joints} == {"joint_3"}


def test_a_joint_that_creeps_is_told_from_one_at_rest(three_joints: ArmModel) -> None:
    """An encoder so coarse that its noise moves faster than the joint does."""
    runs = runs_held(three_joints, nothing, range(2), False)
    std = np.array(runs[0].std)
    std[1, 1] = 10.0
    coarse = [replace(motion, std=std) for motion in runs]
    assert find_static_joints(runs, runs) == ()
    (one,) = find_static_joints(runs, coarse)
    assert (one.joint, one.when, one.crept) == (1, "after", True)
    assert "encoder" in one.reason


def side(*loads: float, gravity: list[float] | None = None) -> dict[str, Any]:
    return {"payload_kg": list(loads), "gravity_mps2": gravity}


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        (side(0.0), side(0.0, 0.0), "payload none before and after; the base as the URDF has it"),
        (side(0.0), side(2.6), "payload none before, 2.6 kg after; the base"),
        (side(0.0, 2.6), side(2.6), "payload 0 to 2.6 kg before, 2.6 kg after; the base"),
        (side(gravity=[9.81, 0.0, 0.0]), side(gravity=[9.81, 0.0, 0.0]), "under gravity along [9.81, 0.00, 0.00]"),
        (side(gravity=[9.81, 0.0, 0.0]), side(), "the base under gravity along [9.81, 0.00, 0.00] m/s²."),
        (side(), side(gravity=[9.81, 0.0, 0.0]), "read under gravity along [9.81, 0.00, 0.00] m/s²: that is not"),
    ],
)
def test_what_was_taken_as_known_is_said(before: dict[str, Any], after: dict[str, Any], told: str) -> None:
    """Law: the loads of both sets and the mount are told, and a later mount that is not used."""
    assert told in describe_known({"before": before, "after": after})
