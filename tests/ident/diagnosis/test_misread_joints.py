"""Where a joint's whole torque is off by a factor, friction that grows with the load is not asked about there."""

from __future__ import annotations

from ident.diagnosis.diagnose import diagnose
from ident.effects.catalogue import CATALOGUE
from ident.recordings.recording import TelemetryIssue
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import record, stribeck_on_1

BY_LOAD = [effect for effect in CATALOGUE if effect.rubs_by_load]


def test_friction_by_load_waits_until_the_torque_has_its_size(short_arm: ArmModel) -> None:
    """Other joints, and other laws at that joint, are tested as they were."""
    motions = record(short_arm, stribeck_on_1)
    joint = short_arm.joint_names[0]
    issue = TelemetryIssue("torque_scale", (joint,), "warning", "reads 1.3 of the model", "check its gain")
    plain = diagnose(motions, short_arm, CATALOGUE, common_clock=False).diagnosis
    off = diagnose(motions, short_arm, CATALOGUE, common_clock=False, telemetry=[issue]).diagnosis
    assert BY_LOAD
    before, after = ({(one.effect.id, one.joint) for one in found.not_testable} for found in (plain, off))
    assert after - before <= {(effect.id, 0) for effect in BY_LOAD}
    assert {(effect.id, 0) for effect in BY_LOAD} <= after
    assert [one.effect for one in off.findings] == [one.effect for one in plain.findings] == ["stribeck_friction"]
