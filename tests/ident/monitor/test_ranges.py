"""Ranges for randomisation: they hold other days' torque, and are no wider than the arm changes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest

from ident.monitor.estimates import HABIT, Estimates, ParameterEstimate, estimate_session, find_ranges, pool_days
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel
from tests.ident.made_up import made_motions, two_joint_arm
from tests.schemas import check_record

NOISE = 0.2


@pytest.fixture(scope="module")
def arm() -> ArmModel:
    return two_joint_arm()


def day(arm: ArmModel, seed: int, factor: float) -> Sequence[Motion]:
    """Three runs of a day on which friction is so many times what it usually is."""

    def law(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> np.ndarray:
        losses = 0.5 * ddq + factor * (4.0 * dq + 6.0 * np.tanh(dq / 1e-3))
        return arm.inverse_dynamics(q, dq, ddq) + losses + 0.3

    return made_motions(arm, law, [10 * seed, 10 * seed + 1, 10 * seed + 2], 10.0, noise=NOISE)


def days_of(arm: ArmModel, spread: float, count: int = 8) -> dict[str, Sequence[Motion]]:
    factors = np.exp(spread * np.random.default_rng(4).standard_normal(count))
    return {f"day_{k}": day(arm, k, float(factor)) for k, factor in enumerate(factors)}


def test_held_out_torque_lies_inside_and_the_ranges_are_narrower_than_the_habit(arm: ArmModel) -> None:
    found = find_ranges(days_of(arm, 0.04), arm)
    assert all(share >= 0.95 for share in found.inside.values())
    assert found.narrower > 2.0
    friction = found.ranges["joint_1", "coulomb"]
    assert friction.source == "days"
    assert friction.low < 6.0 < friction.high
    record = check_record(found.to_dict())
    assert record["ranges"]["joint_1/coulomb"]["unit"] == "N m"
    assert "narrower than ±30%" in found.summary()


def test_an_arm_that_changes_more_gets_wider_ranges(arm: ArmModel) -> None:
    """And where nothing changes from day to day the parameter's own interval counts; one day has that alone."""
    widths = []
    for spread in (0.0, 0.03, 0.12):
        found = find_ranges(days_of(arm, spread, 5), arm)
        one = found.ranges["joint_2", "coulomb"]
        widths.append(one.high - one.low)
    assert widths == sorted(widths)
    assert widths[0] < 0.05 * 2 * HABIT * 6.0 * 4
    alone = find_ranges(days_of(arm, 0.04, 1), arm)
    assert {one.source for one in alone.ranges.values()} == {"interval"}
    assert not alone.inside
    assert alone.to_dict()["heldout"]["narrower_than_habit"] is None
    assert "not checked" in alone.summary()


def test_the_range_is_the_wider_of_interval_and_days() -> None:
    """Two days far apart make it wide by themselves; two days alike leave it to the interval."""

    def day(value: float) -> Estimates:
        return {("joint_1", "viscous"): ParameterEstimate(value, value - 1.0, value + 1.0, 0.5)}

    near, far = (pool_days([day(a), day(b)])["joint_1", "viscous"] for a, b in ((5.0, 5.0), (4.0, 6.0)))
    assert (near.low, near.high, near.source) == (4.0, 6.0, "interval")
    assert far.source == "days"
    assert far.high - far.value == pytest.approx(12.706 * np.sqrt(2.0) * np.sqrt(1.5), rel=1e-3)
    assert far.low == 0.0


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
