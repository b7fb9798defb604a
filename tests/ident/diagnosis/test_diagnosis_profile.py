"""Figures over a grid of laws: what another point explains as well is told, too."""

from __future__ import annotations

import re

import numpy as np
import pytest

from ident.diagnosis.regression.design import Group
from ident.diagnosis.selection.profile import Profile
from ident.effects.base import SessionContext, Variant
from ident.effects.catalogue import find_effect

DROP = 1.92


def waves(falls: tuple[float, float]) -> Profile:
    """Friction of one or two waves a turn, of 1 N m and of 3 N m, known to 0.1 N m each."""
    effect = find_effect("position_dependent_friction")
    points = [
        Group(effect, 0, Variant({"order": order}), np.arange(2 * k, 2 * k + 2)) for k, order in enumerate((1, 2))
    ]
    coefficients = np.array([1.0, 0.0]), np.array([3.0, 0.0])
    return Profile(points[0], tuple(points), -np.array(falls), coefficients, 2 * (100.0 * np.eye(2),), DROP)


def figures(grid: Profile) -> dict[str, tuple[float, float]]:
    effect, best = find_effect("position_dependent_friction"), grid.group
    told = effect.parameters(None, 0, best.variant, grid.coefficients[0], 0.01 * np.eye(2))  # type: ignore[arg-type]
    session: SessionContext = None  # type: ignore[assignment]
    found = grid.widened(told, session, np.full(2, 0.1)) | grid.inner_figures()
    return {name: (one.low, one.high) for name, one in found.items()}


def test_points_that_explain_the_same_are_all_told() -> None:
    """Law: with nothing between two orders the order is either, and the amplitude reaches over both intervals."""
    found = figures(waves((0.0, 0.0)))
    assert found["order"] == (1.0, 2.0)
    assert found["amplitude_Nm"][0] == pytest.approx(1.0 - 0.196)
    assert found["amplitude_Nm"][1] == pytest.approx(3.0 + 0.196)


def test_a_point_that_is_less_likely_reaches_less_far() -> None:
    """Law: at a fall of three quarters of the drop an interval is half as wide; beyond the drop a point counts not."""
    assert figures(waves((0.0, 0.75 * DROP)))["amplitude_Nm"][1] == pytest.approx(3.0 + 0.5 * 0.196)
    found = figures(waves((0.0, 1.01 * DROP)))
    assert found["order"] == (1.0, 1.0)
    assert found["amplitude_Nm"] == pytest.approx((1.0 - 0.196, 1.0 + 0.196))


@pytest.mark.parametrize(
    ("falls", "open_", "words"),
    [
        ((-9.0, -3.0, 0.0, -3.0, -9.0), "", r"^0.06 rad/s \["),
        ((-9.0, -6.0, -3.0, -0.5, 0.0), "high", "^at least"),
        ((0.0, -0.5, -3.0, -6.0, -9.0), "low", "^at most"),
        ((-0.3, -0.1, 0.0, -0.1, -0.2), "both", "or anything else"),
    ],
)
def test_an_end_that_was_not_tried_is_open(falls: tuple[float, ...], open_: str, words: str) -> None:
    """Law: an interval ends half a step beyond the grid, and says which end the recordings leave open."""
    effect, speeds = find_effect("stribeck_friction"), (0.015, 0.03, 0.06, 0.12, 0.24)
    points = [Group(effect, 0, Variant({"stribeck_velocity_rad_s": v, "exponent": 1.0}), np.arange(1)) for v in speeds]
    best = points[int(np.argmax(falls))]
    many = (np.ones(1),) * 5, (np.eye(1),) * 5
    found = Profile(best, tuple(points), np.array(falls), *many, DROP).inner_figures()["stribeck_velocity_rad_s"]
    assert found.open == open_
    assert 0.015 / 2**0.51 < found.low <= found.value <= found.high < 0.24 * 2**0.51
    assert re.search(words, found.words("rad/s"))
    assert found.to_dict().get("open", "") == open_
