"""Laws of what each joint's effort is: a motor's torque, a current, a command, or nothing known."""

from pathlib import Path

import numpy as np
import pytest

from ident.api.inspecting import inspect as inspect_files
from ident.recordings.recording import Recording, Session
from ident.recordings.save import write_session
from ident.robot.arm import ArmModel
from tests.ident.checks.faults import spoil


def frictionless(run: Recording, arm: ArmModel) -> Recording:
    """As a sensor behind the gear has it, with its noise: what a model explains to the last is no measurement."""
    ddq = np.gradient(np.asarray(run.velocity), run.time, axis=0)
    torque = arm.inverse_dynamics(run.position, np.asarray(run.velocity), ddq)
    bearings = 0.04 * torque.std(axis=0) * np.tanh(np.asarray(run.velocity) / 0.01)
    noise = 0.1 * torque.std(axis=0) * np.random.default_rng(0).normal(size=torque.shape)
    return run.replace(effort=torque + bearings + noise)


def at_rest(run: Recording) -> Recording:
    """The last joint stands still."""
    position, velocity = np.array(run.position), np.array(run.velocity)
    position[:, 5], velocity[:, 5] = 0.4, 0.0
    return run.replace(position=position, velocity=velocity)


KINDS = {
    "motor_torque": lambda run, arm: run,
    "joint_torque": frictionless,
    "motor_current": lambda run, arm: run.replace(current=run.effort / 12.0),
    "gravity_compensated": lambda run, arm: run.replace(effort=run.effort - arm.gravity(run.position)),
    "external_torque": lambda run, arm: run.replace(effort=np.random.default_rng(3).normal(size=run.effort.shape)),
    "commanded": lambda run, arm: run.replace(effort_command=run.effort),
    "unknown": lambda run, arm: at_rest(run),
}


# How the summary says them.
KINDS_IN_WORDS = {
    "motor_torque": "the motor's torque, with the gear's friction",
    "joint_torque": "torque at the joint, hardly any friction",
    "motor_current": "the motor's current",
    "gravity_compensated": "torque without gravity",
    "external_torque": "torque from outside: it follows neither gravity nor motion",
    "commanded": "a command",
    "unknown": "unknown",
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_joints_effort_has_a_verdict_with_evidence(
    kind: str, clean: Session, arm: ArmModel, tmp_path: Path
) -> None:
    """Law: `inspect` says of each joint what its effort is, and from which numbers; so do its JSON and its lines."""
    write_session(spoil(clean, lambda run: KINDS[kind](run, arm)), tmp_path / "session")
    found = inspect_files(tmp_path / "session", arm)
    (record,) = found.to_dict()["sessions"]
    seen = {one["joint"]: one for one in record["effort"]}
    assert tuple(seen) == arm.joint_names
    chosen = ("joint_6",) if kind == "unknown" else ("joint_2",) if kind == "external_torque" else arm.joint_names
    lines = " ".join(found.summary().split())
    for name in chosen:
        evidence = seen[name]["evidence"]
        assert seen[name]["kind"] == kind, seen[name]
        assert any(letter.isdigit() for letter in evidence) or kind == "unknown"
        shown = "see below" if kind in ("external_torque", "commanded") else evidence
        assert f"effort of {name}: {KINDS_IN_WORDS[kind]} ({shown})" in lines
        assert evidence in lines


def test_counts_are_no_torque_from_outside(clean: Session, arm: ArmModel, tmp_path: Path) -> None:
    """Law: an effort that follows the motion, in another unit, does not come from outside."""

    def count(run: Recording) -> Recording:
        effort = np.array(run.effort)
        effort[:, 5] = np.round(1000.0 * effort[:, 5])
        return run.replace(effort=effort)

    write_session(spoil(clean, count), tmp_path / "session")
    found = inspect_files(tmp_path / "session", arm)
    assert not found.is_fit
    lines = " ".join(found.summary().split())
    assert "effort of joint_6: unknown (see below)" in lines
    assert "torque from outside" not in lines
