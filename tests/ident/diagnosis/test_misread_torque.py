"""A joint whose log reads its torque at another size: friction that grows with the load is found beside it."""

from __future__ import annotations

from ident.arrays import Array
from ident.diagnosis.diagnose import diagnose
from ident.effects.catalogue import CATALOGUE
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import at_joint, healthy_torque, load_friction_on_2, record

READS = 1.25


def misread_load_friction(arm: ArmModel, q: Array, dq: Array, ddq: Array) -> Array:
    """Joint 2 has friction of 0.16 |τ_rigid,₂|, and its log reads 1.25 times the torque."""
    friction = 2.0 * load_friction_on_2(arm, q, dq, ddq)
    return READS * friction + at_joint(1, (READS - 1.0) * healthy_torque(arm, q, dq, ddq)[:, 1])


def test_load_friction_is_named_beside_a_wrong_scale(short_arm: ArmModel) -> None:
    joint = short_arm.joint_names[1]
    alarm = TelemetryIssue("torque_scale", (joint,), "warning", "reads 1.25 of the model", "check its gain")
    motions = record(short_arm, misread_load_friction)
    found = diagnose(motions, short_arm, CATALOGUE, common_clock=False, telemetry=[alarm]).diagnosis
    names = {(one.effect, name) for one in found.findings for name in one.joints}
    assert ("load_dependent_friction", joint) in names
