"""Our small numerical routines give what SciPy's give."""

import numpy as np
import pytest
from scipy.linalg import qr
from scipy.optimize import minimize_scalar, nnls
from scipy.special import stdtrit

from ident.numerics import factor_by_pivots, find_minimum, solve_non_negative, student_quantile


@pytest.mark.parametrize("level", [0.9, 0.975, 0.9995])
def test_quantiles_of_student(level: float) -> None:
    dof = np.array([[1.0, 1.5, 2.0, 3.0], [7.3, 30.0, 1e3, 1e6]])
    assert np.allclose(student_quantile(level, dof), stdtrit(dof, level), rtol=1e-7)


def test_pivots_and_factor() -> None:
    """A column that is the sum of two others comes last."""
    table = np.random.default_rng(0).normal(size=(200, 12))
    table[:, 7] = table[:, 1] + table[:, 2]
    factor, order = factor_by_pivots(table)
    expected, pivots = qr(table, mode="r", pivoting=True)
    assert order.tolist() == pivots.tolist()
    assert np.allclose(np.abs(factor), np.abs(expected[:12]), atol=1e-12)
    assert np.allclose(factor.T @ factor, table[:, order].T @ table[:, order])


def test_non_negative_least_squares() -> None:
    """As small a residual as SciPy's, also with unknowns in pairs of opposite sign, and never below zero."""
    rng = np.random.default_rng(1)
    for _ in range(50):
        table, target = rng.normal(size=(60, 6)), rng.normal(size=60)
        table = np.hstack([table, -table[:, 4:]])
        found = solve_non_negative(table, target)
        assert np.all(found >= 0.0)
        assert np.linalg.norm(table @ found - target) == pytest.approx(nnls(table, target)[1], rel=1e-12)


def test_least_value_between_bounds() -> None:
    """The same place as SciPy's bounded search, at the bounds too."""
    rng = np.random.default_rng(2)
    for _ in range(30):
        place, phase = rng.normal(0.0, 2.0), rng.uniform(0.0, 6.0)

        def valley(x: float, place: float = place, phase: float = phase) -> float:
            return float((x - place) ** 2 + 0.3 * np.sin(3.0 * x + phase))

        expected = minimize_scalar(valley, bounds=(-2.0, 2.0), method="bounded", options={"xatol": 0.02}).x
        assert find_minimum(valley, -2.0, 2.0, 0.02) == pytest.approx(expected, abs=1e-9)
