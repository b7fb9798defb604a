"""Laws of gravity's torque along the axes of an arm's base."""

import numpy as np
import pytest

from ident.robot.arm import ArmModel
from ident.robot.gravity import gravity_along_axes


@pytest.mark.parametrize("name", ["tm5-900", "panda", "tiago:arm_7_joint"])  # the last slides first
def test_gravity_s_torque_is_that_of_the_rigid_arm_under_each_axis(name: str) -> None:
    """Law: the inverse dynamics of the arm at rest, gravity turned to each axis of its base."""
    arm = ArmModel.load(name)
    q = np.random.default_rng(3).uniform(-1.5, 1.5, (20, arm.n))
    along = gravity_along_axes(arm.chain, q)
    for axis, direction in enumerate(np.eye(3)):
        np.testing.assert_allclose(along[..., axis], arm.with_gravity(direction).gravity(q), atol=1e-10)


def test_any_gravity_is_a_sum_of_the_three() -> None:
    arm = ArmModel.load("tm5-900")
    q = np.random.default_rng(4).uniform(-1.5, 1.5, (10, arm.n))
    vector = np.array([1.0, -2.0, 9.0])
    expected = arm.with_gravity(vector).gravity(q)
    np.testing.assert_allclose(gravity_along_axes(arm.chain, q) @ vector, expected, atol=1e-10)
