"""What tuning absorbed is reported: which link of the URDF is off, by how much, and only what recordings determine."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import diagnose
from ident.diagnosis.result import Diagnosis
from ident.diagnosis.tuned_links import turning_moment
from ident.effects.catalogue import find_effect
from ident.effects.effect_info import Interval
from ident.model.inertia import base_parameters
from ident.robot.arm import ArmModel
from tests.ident.diagnosis.planted import nothing, record

# Links are flagged at 95 % intervals of several numbers: each holds the truth within this many of its half-widths.
WITHIN = 1.6


def diagnosed(arm: ArmModel, numbers: Array) -> Diagnosis:
    """The diagnosis of a healthy arm by a URDF of other inertial numbers."""
    urdf = arm.with_inertial_parameters(numbers)
    effects = [find_effect("stribeck_friction")]
    return diagnose(record(arm, nothing), urdf, effects, common_clock=False).diagnosis


def holds(one: Interval, true: float) -> bool:
    return abs(one.value - true) <= WITHIN * (one.high - one.value)


@pytest.mark.parametrize(("wrong", "factor"), [(None, 1.0), (1, 1.5), (2, 1.6), (2, 0.6)])
def test_the_link_that_is_off_is_named_and_no_other(short_arm: ArmModel, wrong: int | None, factor: float) -> None:
    """Law: every reported change holds the true one, and the links beyond tolerance are those that are off by half."""
    true = short_arm.inertial_parameters
    numbers = true.copy()
    if wrong is not None:
        numbers[10 * wrong : 10 * wrong + 10] *= factor
    diagnosis = diagnosed(short_arm, numbers)
    assert diagnosis.details is not None
    links = diagnosis.details.tuned_links
    for k, (name, link) in enumerate(links.items()):
        own = (true - numbers)[10 * k : 10 * k + 4]
        reported = {"xyz".index(axis) + 1: one for axis, one in link.moment.items()}
        reported |= {} if link.mass is None else {0: link.mass}
        assert all(holds(one, own[i]) for i, one in reported.items()), (name, own, reported)
        if link.about_axis is not None:
            axis = short_arm.joint_axes[k]
            rows = (np.eye(3) - np.outer(axis, axis)) @ turning_moment(short_arm, k)
            urdf = rows @ numbers
            assert holds(link.about_axis, float(urdf @ rows @ (true - numbers) / np.linalg.norm(urdf)))
        assert link.beyond_tolerance == (k == wrong)
    doubted = [one for one in diagnosis.reservations if "URDFs are" in one.reason]
    assert [one.joints for one in doubted] == ([] if wrong is None else [(short_arm.joint_names[wrong],)])
    record_ = diagnosis.to_dict()["tuned_links"]
    assert record_["link_2"]["about_axis_share"].keys() == {"value", "low", "high"}
    assert "mass_kg" not in record_["link_1"]  # a link behind an upright axis shows none of its mass


def test_the_moment_about_an_axis_is_what_the_torques_show(short_arm: ArmModel) -> None:
    """Law: across a level axis the turning moment is a combination of base parameters; across the upright one none."""
    base = base_parameters(short_arm).mapping

    def shown(joint: int) -> bool:
        axis = short_arm.joint_axes[joint]
        rows = (np.eye(3) - np.outer(axis, axis)) @ turning_moment(short_arm, joint)
        left = rows.T - base.T @ np.linalg.lstsq(base.T, rows.T, rcond=None)[0]
        return bool(np.linalg.norm(left) < 1e-9 * np.linalg.norm(rows))

    assert [shown(joint) for joint in range(3)] == [False, True, True]
