"""Laws of the regressor: τ = Y π."""

import numpy as np
import pinocchio as pin
import pytest

from ident.robot.arm import ArmModel
from tests.ident.made_up import random_states, sliding_arm


@pytest.mark.parametrize("robot", ["tm5-900", "panda", "ur10", "z1", "xarm7", "sliding"])
def test_regressor_times_parameters_is_the_torque(robot: str) -> None:
    """Y π = inverse dynamics to 1e-11 of the torque's size, turning and sliding joints, gravity askew."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(1), 300, arm.n)
    for tilted in (arm, arm.with_gravity(np.array([1.0, -2.0, 4.0]))):
        torque = tilted.inverse_dynamics(*states)
        product = tilted.regressor(*states) @ arm.inertial_parameters
        assert np.allclose(product, torque, rtol=0, atol=1e-11 * np.abs(torque).max())


@pytest.mark.parametrize("robot", ["panda", "sliding"])
def test_regressor_equals_pinocchios_own(robot: str) -> None:
    """Every column, not only the sum, is Pinocchio's joint torque regressor to 1e-11 of the largest."""
    arm = sliding_arm() if robot == "sliding" else ArmModel.load(robot)
    states = random_states(np.random.default_rng(2), 20, arm.n)
    data = arm.model.createData()
    expected = np.array(
        [pin.computeJointTorqueRegressor(arm.model, data, *state) for state in zip(*states, strict=True)]
    )
    assert np.allclose(arm.regressor(*states), expected, rtol=0, atol=1e-11 * np.abs(expected).max())


def test_a_link_moves_no_joint_beyond_it() -> None:
    """Y is block upper triangular: joint j does not feel links before it."""
    arm = ArmModel.load("tm5-900")
    blocks = arm.regressor(*random_states(np.random.default_rng(3), 10, 6)).reshape(10, 6, 6, 10)
    for j in range(6):
        assert np.all(blocks[:, j, :j] == 0.0)
        assert np.any(blocks[:, j, j:] != 0.0)


def test_some_columns_are_those_of_all_in_the_order_asked() -> None:
    arm = ArmModel.load("panda")
    states = random_states(np.random.default_rng(3), 20, arm.n)
    chosen = (41, 3, 10, 69)
    assert np.array_equal(arm.regressor(*states, chosen), arm.regressor(*states)[:, :, list(chosen)])
