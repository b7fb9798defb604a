"""Ranges of few days: what joints have in common of their day-to-day spread makes up for days that are missing."""

from __future__ import annotations

import numpy as np
import pytest

from ident.monitor.estimates import ParameterEstimate
from ident.monitor.ranges import pool_days
from ident.monitor.spreads import moderated_spreads

LEVEL = 0.95


def day(values: dict[tuple[str, str], float]) -> dict[tuple[str, str], ParameterEstimate]:
    return {key: ParameterEstimate(value, value - 0.01, value + 0.01, 0.005) for key, value in values.items()}


def test_three_days_are_not_from_nothing_to_far_beyond() -> None:
    """Law: friction of 10, 15 and 10, as that of five other joints in their size, is not anything up to 26."""
    rng = np.random.default_rng(3)
    others = [8.0 * np.exp(0.25 * rng.standard_normal(3)) for _ in range(5)]
    days = []
    for k, value in enumerate((10.0, 15.0, 10.0)):
        rows = {("joint_1", "coulomb"): value}
        rows |= {(f"joint_{j + 2}", "coulomb"): float(other[k]) for j, other in enumerate(others)}
        days.append(day(rows))
    alone = pool_days([{key: one for key, one in each.items() if key[0] == "joint_1"} for each in days])
    found = pool_days(days)["joint_1", "coulomb"]
    wide = alone["joint_1", "coulomb"]
    assert wide.high == pytest.approx(25.96, abs=0.05)
    assert 2.0 < found.low < 10.0 < 15.0 < found.high < 21.0
    assert found.value == pytest.approx(35.0 / 3.0)


@pytest.mark.parametrize("unlike", [0.0, 0.6])
def test_another_day_lies_inside_as_often_as_is_said(unlike: float) -> None:
    """Law: with spreads that are alike, or not, the range of three days holds a fourth one 95 times in 100."""
    rng = np.random.default_rng(11)
    inside = []
    for _ in range(150):
        spreads = 0.1 * np.exp(unlike * rng.standard_normal(6))
        values = 10.0 * (1.0 + spreads[:, None] * rng.standard_normal((6, 4)))
        days = [day({(f"joint_{j}", "viscous"): float(values[j, k]) for j in range(6)}) for k in range(3)]
        found = pool_days(days)
        for j in range(6):
            one = found[f"joint_{j}", "viscous"]
            inside.append(one.low <= values[j, 3] <= one.high)
    assert np.mean(inside) == pytest.approx(LEVEL, abs=0.025)


def test_a_lone_figure_and_one_without_spread_are_left_as_they_are() -> None:
    values = {("a", "coulomb"): np.array([1.0, 2.0, 3.0])}
    assert moderated_spreads(values)["a", "coulomb"] == (1.0, 2.0)
    three = {(name, "rotor"): np.array([1.0, 1.0, 1.0 + k]) for k, name in enumerate("abc")}
    assert moderated_spreads(three)["a", "rotor"] == (0.0, 2.0)
