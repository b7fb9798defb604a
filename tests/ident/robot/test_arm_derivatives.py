"""Derivatives of inverse dynamics against differences."""

from __future__ import annotations

import numpy as np
import pytest

from ident.robot.arm import ArmModel


@pytest.mark.parametrize("outer", [1.0, -3.0])
def test_derivatives_are_those_of_inverse_dynamics(outer: float) -> None:
    """Central differences by each joint's position, velocity and acceleration; the mass matrix is symmetric. So it is
    where tuning makes the outer links weigh less than nothing.
    """
    arm = ArmModel.load("tm5-900")
    scale = np.ones(10 * arm.n)
    scale[-30::10] = outer
    arm = arm.with_inertial_parameters(scale * arm.inertial_parameters)
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5, arm.n))
    found = arm.derivatives(*states)
    for which in range(3):
        for joint in range(arm.n):
            step = np.zeros_like(states)
            step[which, :, joint] = 1e-5
            slope = (arm.inverse_dynamics(*(states + step)) - arm.inverse_dynamics(*(states - step))) / 2e-5
            np.testing.assert_allclose(found[which][:, :, joint], slope, atol=1e-6)
    np.testing.assert_allclose(found[2], np.swapaxes(found[2], 1, 2))
