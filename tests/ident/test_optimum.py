"""Laws of small optimisation problems, each held against SciPy's."""

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment, minimize_scalar, nnls

from ident.optimum import cheapest_assignment, least_within, non_negative_least_squares


@pytest.mark.parametrize("seed", range(40))
def test_non_negative_least_squares_are_scipys(seed: int) -> None:
    """Law: no unknown is negative, and no more is left than SciPy leaves, also of columns that are nearly alike."""
    rng = np.random.default_rng(seed)
    rows, columns = int(rng.integers(3, 30)), int(rng.integers(1, 9))
    matrix = rng.standard_normal((rows, columns)) * 10.0 ** rng.uniform(-3, 3, columns)
    if seed % 4 == 0 and columns > 1:
        matrix[:, 1] = matrix[:, 0] * (1.0 + 1e-6)
    target = rng.standard_normal(rows)
    solution, left = non_negative_least_squares(matrix, target)
    _, least = nnls(matrix, target)
    assert np.all(solution >= 0.0)
    assert left <= least * (1.0 + 1e-9) + 1e-12
    assert left == pytest.approx(float(np.linalg.norm(target - matrix @ solution)))


def test_what_asks_for_less_than_nothing_is_zero() -> None:
    matrix = np.eye(3)
    solution, left = non_negative_least_squares(matrix, -np.ones(3))
    assert np.all(solution == 0.0)
    assert left == pytest.approx(np.sqrt(3.0))


@pytest.mark.parametrize("seed", range(20))
def test_the_least_value_is_where_scipy_finds_it(seed: int) -> None:
    """Law: the same place within the width that was asked for, at the ends too, in no more evaluations by half."""
    rng = np.random.default_rng(seed)
    place, power = rng.uniform(-3.0, 3.0), rng.uniform(1.2, 4.0)
    calls = [0]

    def valley(x: float) -> float:
        calls[0] += 1
        return float(abs(x - place) ** power + 0.1 * (x - place))

    found = least_within(valley, -2.0, 2.0, 1e-6)
    count = calls[0]
    optimum = minimize_scalar(valley, bounds=(-2.0, 2.0), method="bounded", options={"xatol": 1e-6})
    assert found == pytest.approx(optimum.x, abs=1e-5)
    assert count <= 1.5 * optimum.nfev


@pytest.mark.parametrize("size", [1, 2, 3, 7, 12])
def test_an_assignment_is_the_cheapest(size: int) -> None:
    """Law: every column once, at the cost that SciPy finds, negative costs among them."""
    rng = np.random.default_rng(size)
    for _ in range(10):
        cost = rng.normal(size=(size, size)) * 10.0
        columns = cheapest_assignment(cost)
        assert sorted(columns.tolist()) == list(range(size))
        rows, best = linear_sum_assignment(cost)
        assert cost[np.arange(size), columns].sum() == pytest.approx(cost[rows, best].sum())
