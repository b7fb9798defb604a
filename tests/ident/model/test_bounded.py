"""Laws of least squares with unknowns that can't be negative."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest

from ident.model.bounded import solve_bounded


@pytest.mark.parametrize("seed", range(3))
def test_the_same_as_by_cvxpy(seed: int) -> None:
    """Law: two tables, some unknowns bounded: number by number what CVXPY finds by the same solver."""
    rng = np.random.default_rng(seed)
    rows, target = rng.normal(size=(12, 7)) * np.exp(2.0 * rng.normal(size=7)), 10.0 * rng.normal(size=12)
    believed = np.concatenate([rng.normal(size=(5, 4)), np.zeros((5, 3))], axis=1)
    free, held = cp.Variable(4), cp.Variable(3)
    left = rows[:, :4] @ free + rows[:, 4:] @ held - target
    objective = cp.sum_squares(left) + cp.sum_squares(believed[:, :4] @ free)
    cp.Problem(cp.Minimize(objective), [held >= 0]).solve(solver=cp.CLARABEL)
    assert free.value is not None
    assert held.value is not None
    expected = np.concatenate([free.value, held.value])
    found = solve_bounded([(rows, target), (believed, np.zeros(5))], range(4, 7))
    assert np.allclose(found, expected, rtol=1e-12, atol=1e-12)


def test_what_is_not_held_is_least_squares() -> None:
    """Law: without bounds it is the solution of the normal equations; with them zero or without slope."""
    rng = np.random.default_rng(5)
    rows, target = rng.normal(size=(9, 4)), rng.normal(size=9)
    free = np.linalg.lstsq(rows, target, rcond=None)[0]
    assert np.allclose(solve_bounded([(rows, target)], ()), free, atol=1e-7)
    found = solve_bounded([(rows, target)], range(4))
    slope = rows.T @ (target - rows @ found)
    assert np.all(found > -1e-7)
    assert np.all(slope < 1e-6)
    assert np.all(np.abs(found * slope) < 1e-6)
