"""The map of the gap: shares add up, a planted gap is found where it is, an even one nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.arm import ArmModel
from ident.arrays import Array
from ident.diagnosis.axes import session_axes
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.residuals import RunResidual
from ident.diagnosis.where import SIGNIFICANT, Place, map_gap, maps_record, told

JOINTS = ("joint_1", "joint_2", "joint_3")


def with_gap(analysis: Analysis, seed: int, axis: str, low: float, high: float, ratio: float = 3.0) -> list[Place]:
    """The map of white noise of twice the level, `ratio` times as strong where joint 2's axis is in [low, high]."""
    rng = np.random.default_rng(seed)
    level = analysis.evidence.whitening.level
    pick = session_axes(analysis.series)[axis]

    def noisy(item: RunResidual) -> Array:
        left = 2.0 * level * rng.standard_normal(item.before.shape)
        values = pick(item, 1)
        left[:, 1] *= np.where((values >= low) & (values <= high), ratio, 1.0)
        return left

    series = [replace(item, before=noisy(item)) for item in analysis.series]
    return map_gap(series, JOINTS, analysis.evidence.whitening, np.random.default_rng(0))


def sure(places: list[Place]) -> set[tuple[str, str]]:
    """Joint and axis of the significant cells; frequency aside: white noise is not the recordings' noise."""
    return {(p.joint, p.axis) for p in places if p.p_value <= SIGNIFICANT and p.axis != "frequency"}


@pytest.mark.parametrize(("axis", "low", "high"), [("speed", 0.0, 0.2), ("load", 0.0, 30.0), ("pose", 0.0, 0.75)])
def test_a_gap_is_found_where_it_is(healthy: Analysis, axis: str, low: float, high: float) -> None:
    """Law: where the residual is thrice as large in one part of an axis, that axis has a significant cell there."""
    places = with_gap(healthy, 1, axis, low, high)
    (best,) = told([p for p in places if p.axis == axis and p.joint == "joint_2"], 1)
    assert best.p_value <= SIGNIFICANT
    assert best.low < high
    assert best.high > low
    assert best.share_of_gap > 1.3 * best.share_of_time


def test_a_gap_that_is_everywhere_is_nowhere_dense(healthy: Analysis) -> None:
    """Law: of residuals that depend on nothing, at most one joint in twenty has a significant cell, whatever the axis.

    Of 3 joints × 10 seeds, five false joints have a probability below 2 %.
    """
    false = sum(len({joint for joint, _ in sure(with_gap(healthy, seed, "speed", 0, 0))}) for seed in range(10))
    assert false <= 4


def test_shares_add_up(healthy: Analysis) -> None:
    """Law: along every axis the shares of gap and time are one, and the joules are those of the whole session."""
    places = with_gap(healthy, 3, "speed", 0.0, 0.3)
    strips = maps_record(places)
    assert {strip["axis"] for strip in strips} >= {"speed", "direction", "load", "position", "pose", "reversal", "time"}
    for strip in strips:
        assert sum(strip["share_of_gap"]) == pytest.approx(1.0)
        assert sum(strip["share_of_time"]) == pytest.approx(1.0)
        assert np.all(np.diff(strip["edges"]) > 0)
        assert len(strip["edges"]) == len(strip["p_value"]) + 1
    for joint in JOINTS:
        totals = [sum(s["energy_J"]) for s in strips if s["joint"] == joint and s["axis"] != "frequency"]
        np.testing.assert_allclose(totals, totals[0], rtol=1e-9)


def test_a_healthy_arm_has_no_map(healthy: Analysis) -> None:
    """Law: a joint without a gap is not on the map."""
    assert healthy.diagnosis.to_dict()["maps"] == []
    assert healthy.diagnosis.where == ()


def test_reach_is_the_distance_of_the_last_link(healthy: Analysis, short_arm: ArmModel) -> None:
    """Law: the pose axis is the last link's distance from the base, interpolated to a millimetre."""
    item = healthy.series[0]
    pick = session_axes([item])["pose"]
    q = item.run.motion.q[item.run.motion.coarse]
    for at in (0, 17, 101, len(q) - 1):
        place = short_arm.forward_kinematics(q[at])[short_arm.links[-1]][:3, 3]
        assert pick(item, 0)[at] == pytest.approx(np.linalg.norm(place), abs=2e-3)
