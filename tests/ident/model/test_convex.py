"""Least squares within what an arm can be: the conditions of a least value hold, and both solvers agree."""

from __future__ import annotations

import numpy as np
import pytest

from ident.model.inertia import is_consistent, parameter_scale, solve_bounded, solve_partly_non_negative
from ident.robot.arm import ArmModel

FREE = 12  # unknowns beside the links' numbers, the first few of them bounded


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_bodies_and_losses_stay_within_their_bounds_and_no_nearby_point_is_lower(seed: int) -> None:
    """Law: feasible, and on the way to any other feasible point the function rises."""
    rng = np.random.default_rng(seed)
    arm = ArmModel.load("tm5-900")
    links, scale = arm.inertial_parameters, 0.3 * parameter_scale(arm)
    size = len(links) + FREE
    rows = rng.standard_normal((3 * size, size)) * rng.lognormal(0.0, 2.0, size)
    information = rows.T @ rows
    information[: len(links), : len(links)] += np.eye(len(links))
    free = rng.standard_normal(size)
    bounded = len(links) + np.arange(6)
    assert not is_consistent(links + scale * free[: len(links)])
    found = solve_bounded(information, information @ free, bounded, links, scale)
    assert np.all(found[bounded] >= 0.0)
    assert is_consistent(links + scale * found[: len(links)])
    slope = information @ (found - free)
    for _ in range(20):
        other = free + rng.standard_normal(size)
        other[bounded] = np.abs(other[bounded])
        meant, ones = links + scale * other[: len(links)], np.eye(len(links))
        other[: len(links)] += solve_bounded(ones, 0.0 * links, (), meant, scale)
        assert slope @ (other - found) > -1e-5 * abs(slope) @ abs(other - found)


@pytest.mark.parametrize("seed", range(3))
def test_both_solvers_find_the_same_losses(seed: int) -> None:
    """Law: eliminating the free unknowns and bounding the rest is the program that CVXPY solves; slopes don't bind."""
    rng = np.random.default_rng(seed)
    table, target = rng.normal(size=(30, 9)) * np.exp(2.0 * rng.normal(size=9)), 10.0 * rng.normal(size=30)
    bounded = range(4, 9)
    found = solve_partly_non_negative(table, target, bounded)
    other = solve_bounded(table.T @ table, table.T @ target, bounded)
    scale = np.linalg.norm(table, axis=0)
    assert np.allclose(scale * found, scale * other, atol=1e-4 * np.abs(scale * found).max())
    slope = table.T @ (table @ found - target) / scale
    assert np.abs(slope[:4]).max() < 1e-9
    assert np.all(slope[4:] > -1e-9)
    assert np.all((found[4:] > 0) | (slope[4:] > 0))


def test_without_bounds_it_is_least_squares() -> None:
    rng = np.random.default_rng(5)
    table, target = rng.normal(size=(9, 4)), rng.normal(size=9)
    free = np.linalg.lstsq(table, target, rcond=None)[0]
    assert np.allclose(solve_bounded(table.T @ table, table.T @ target, ()), free, atol=1e-6)
    assert np.allclose(solve_partly_non_negative(table, target, ()), free)
