"""The map of the gap: shares add up, a planted gap is found where it is, an even one nowhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ident.arrays import Array
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.axes import session_axes
from ident.diagnosis.gap.gap_map import Place, map_gap
from ident.diagnosis.gap.places import Harm, NamedPlace, measure_harm, rank_places
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_MAP

JOINTS = ("joint_1", "joint_2", "joint_3")


def with_gap(analysis: Analysis, seed: int, axis: str, size: float = 2.0, ratio: float = 3.0) -> list[Place]:
    """The map of white noise of `size` levels, `ratio` times as strong in the lowest 30 % of an axis of joint 2."""
    rng = np.random.default_rng(seed)
    level = analysis.evidence.whitening.level
    pick = session_axes(analysis.series)[axis]
    low = np.quantile(np.concatenate([pick(item, 1)[item.counts[:, 1]] for item in analysis.series]), 0.3)

    def noisy(item: RunResidual) -> Array:
        left = size * level * rng.standard_normal(item.before.shape)
        left[:, 1] *= np.where(pick(item, 1) <= low, ratio, 1.0)
        return left

    series = [replace(item, before=noisy(item)) for item in analysis.series]
    return map_gap(series, JOINTS, analysis.evidence.whitening, np.random.default_rng(0))["before"]


def sure(places: list[Place]) -> set[tuple[str, str]]:
    """Joint and axis of the significant cells; frequency aside: white noise is not the recordings' noise."""
    return {(p.joint, p.axis) for p in places if p.p_value <= USUAL_MAP.significant and p.axis != "frequency"}


@pytest.mark.parametrize("axis", ["speed", "load", "pose"])
def test_a_gap_is_found_where_it_is(healthy: Analysis, axis: str) -> None:
    """Law: where the residual is thrice as large at an axis's low end, the lowest cell is significant and dense."""
    places = [p for p in with_gap(healthy, 1, axis) if p.axis == axis and p.joint == "joint_2"]
    (best,) = rank_places({"before": places}, {"joint_2": Harm(2.0)}, replace(USUAL_MAP, places_told=1))
    assert best == replace(places[0], beyond_noise_Nm=2.0)
    assert best.p_value <= USUAL_MAP.significant
    assert best.share_of_gap > 1.5 * best.share_of_time


def test_a_gap_that_is_everywhere_is_nowhere_dense(healthy: Analysis) -> None:
    """Law: of residuals that depend on nothing, at most one joint in twenty has a significant cell, whatever the axis.

    Of 3 joints × 10 seeds, five false joints have a probability below 2 %.
    """
    false = sum(len({joint for joint, _ in sure(with_gap(healthy, seed, "speed", ratio=1.0))}) for seed in range(10))
    assert false <= 4


def place(joint: str, axis: str, gap: float, time: float, low: float = 0.0, p_value: float = 0.001) -> Place:
    return Place(joint, axis, low, low + 1.0, gap, time, None, p_value)


def test_joints_stand_in_the_order_of_harm_and_none_without_a_gap() -> None:
    """Law: by torque beyond noise, in the view in which the names were judged, whoever is named first."""
    errors = {"before": np.array([2.0, 1.05, 5.0]), "fixed": np.array([2.5, 4.0, 9.0])}
    noise, none = np.ones(3), np.zeros(3)

    def harm(*names: NamedPlace, away: Array = none) -> dict[str, Harm]:
        return measure_harm(JOINTS, errors, away, noise, names, loud=1.15)

    assert list(harm()) == ["joint_3", "joint_1"]
    assert harm()["joint_3"].torque == pytest.approx(np.sqrt(24.0))
    own = NamedPlace(("joint_1",), ("joint_1",), absorbed=False)
    assert list(harm(own)) == ["joint_3", "joint_1"]
    hidden = harm(NamedPlace(("joint_2",), ("joint_2", "joint_3"), absorbed=True))
    assert list(hidden) == ["joint_3", "joint_2", "joint_1"]
    assert hidden["joint_2"] == Harm(pytest.approx(np.sqrt(15.0)), "fixed")
    assert harm(away=np.array([0.0, 2.0, 0.0]))["joint_2"].view == "fixed"


def test_a_cell_that_is_no_denser_than_its_time_is_no_place() -> None:
    """Law: cells are denser in gap than in time, the slowest frequencies are none, and each axis has one at most."""
    cells = [
        place("joint_1", "frequency", 0.9, 0.3),
        place("joint_1", "speed", 0.22, 0.2),
        place("joint_1", "load", 0.5, 0.2),
        place("joint_1", "load", 0.3, 0.2, low=1.0),
        place("joint_1", "pose", 0.9, 0.2, p_value=0.4),
        place("joint_2", "speed", 0.4, 0.2),
        place("joint_3", "frequency", 0.9, 0.3),
        place("joint_3", "time", 0.24, 0.2, p_value=0.7),
        place("joint_3", "time", 0.16, 0.2, low=1.0),
    ]
    ranked = rank_places({"before": cells}, {"joint_3": Harm(3.0), "joint_1": Harm(1.0)})
    assert [(p.joint, p.axis, p.share_of_gap) for p in ranked] == [("joint_3", "time", 0.24), ("joint_1", "load", 0.5)]
    assert [p.beyond_noise_Nm for p in ranked] == [3.0, 1.0]
