"""Least squares with unknowns that are not negative: the minimum, whatever the columns' units and dependence."""

from __future__ import annotations

import numpy as np
import pytest

from ident.arrays import Array, Bool
from ident.diagnosis.regression.least_squares import solve_signed


def problem(seed: int) -> tuple[Array, Array, Bool]:
    """Normal equations of 20 to 80 columns that nearly depend on one another, and of units far apart."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(20, 80))
    mixing = np.eye(size) + rng.normal(size=(size, size)) * 10.0 ** rng.uniform(-1, 1)
    columns = rng.normal(size=(400, size)) @ mixing * 10.0 ** rng.uniform(-2, 2, size)
    signed = rng.random(size) < rng.choice([0.1, 0.5, 0.9, 1.0])
    return columns.T @ columns, columns.T @ (columns @ rng.normal(size=size) + rng.normal(size=400)), signed


@pytest.mark.parametrize("seed", range(60))
def test_no_step_that_is_allowed_makes_it_better(seed: int) -> None:
    matrix, target, signed = problem(seed)
    found = solve_signed(matrix, target, signed)
    unit = 1.0 / np.sqrt(np.diag(matrix))
    slope = unit * (matrix @ found - target)  # the conditions of Karush, Kuhn and Tucker, in units of one size
    small = 1e-6 * np.linalg.norm(unit * target)
    assert (found[signed] >= 0.0).all()
    assert (np.abs(slope[~signed]) < small).all()
    assert (slope[signed] > -small).all()
    assert (np.abs(slope[signed & (found > 0.0)]) < small).all()
