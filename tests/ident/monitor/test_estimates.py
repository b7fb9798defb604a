"""Estimates of a session: what was put in comes out, within its interval."""

from __future__ import annotations

import numpy as np
import pytest

from ident.monitor.estimates import ParameterEstimate, estimate_session
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, two_joint_arm


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def estimates_of(
    arm: ArmModel, gain: float = 1.0, viscous: float = 9.0, coulomb: float = 6.0
) -> dict[tuple[str, str], ParameterEstimate]:
    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        return gain * arm.inverse_dynamics(q, dq, ddq) + 0.4 * ddq + viscous * dq + coulomb * np.sign(dq) + 1.5

    return estimate_session(made_motions(arm, law, [1, 2], noise=0.5), arm)


def test_estimates_come_back_within_their_intervals(arm: ArmModel) -> None:
    """Joint 2 is moved by gravity: its gain too. Joint 1's axis is upright: there its inertia is the rotor's."""
    found = estimates_of(arm, gain=1.08)
    true = {"gain": 1.08, "rotor": 0.4, "viscous": 9.0, "coulomb": 6.0, "offset": 1.5}
    for name, value in true.items():
        one = found["joint_2", name]
        assert abs(one.value - value) < 4.0 * one.std, name
        assert one.low < one.value < one.high
    assert ("joint_1", "gain") not in found
    assert abs(found["joint_1", "viscous"].value - 9.0) < 4.0 * found["joint_1", "viscous"].std


def test_what_no_parameter_explains_is_the_gap(arm: ArmModel) -> None:
    """White noise of 0.5 N m, of which the filter lets a part through; friction does not change it."""
    first, second = estimates_of(arm)["joint_2", "gap"], estimates_of(arm, viscous=14.0)["joint_2", "gap"]
    assert 0.05 < first.value < 0.5
    assert first.value == pytest.approx(second.value, rel=1e-6)
