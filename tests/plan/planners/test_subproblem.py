"""One step's programme: what either method gives is the optimum, and a method that goes in circles is made up for."""

import numpy as np
import pytest
from numpy.random import Generator

from plan.planners import subproblem
from plan.planners.subproblem import ConstraintRows, solve_step

Programme = tuple[np.ndarray, np.ndarray, list[ConstraintRows], np.ndarray, tuple[np.ndarray, np.ndarray]]


def draw(rng: Generator, broken: float) -> Programme:
    """Twelve variables, inequalities of two sets of which some are broken from the start."""
    size, root = 12, rng.normal(size=(12, 12))
    groups = [ConstraintRows(rng.normal(size=(30, size)), rng.uniform(-broken, 1.0, 30)) for _ in range(2)]
    span = rng.uniform(0.1, 0.5, size)
    return 5.0 * rng.normal(size=size), root @ root.T + 0.1 * np.eye(size), groups, np.array([4.0, 20.0]), (-span, span)


def price(programme: Programme, step: np.ndarray) -> float:
    """What is to be minimised, the shortfalls at their price."""
    gradient, hessian, groups, weights, _ = programme
    slack = [max(0.0, float((rows.matrix @ step - rows.room).max())) for rows in groups]
    return float(gradient @ step + 0.5 * step @ hessian @ step + weights @ slack)


@pytest.mark.parametrize("broken", [0.0, 0.5])
def test_nothing_near_a_step_costs_less(broken: float) -> None:
    """Law: the programme is convex: a step that no neighbour undercuts is the optimum; and it keeps its bounds."""
    rng = np.random.default_rng(0)
    for _ in range(10):
        programme = draw(rng, broken)
        step, promised = solve_step(*programme)
        low, high = programme[-1]
        assert np.all(step >= low)
        assert np.all(step <= high)
        best = price(programme, step)
        for length in (1e-1, 1e-3):
            others = np.clip(step + length * rng.normal(size=(200, len(low))), low, high)
            assert min(price(programme, other) for other in others) > best - 1e-7
        assert promised == pytest.approx(price(programme, np.zeros(len(low))) - best, abs=1e-9)


def test_both_methods_agree_and_either_alone_is_enough(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where the active-set method gives nothing the interior-point method gives the same step."""
    programme = draw(np.random.default_rng(1), 0.5)
    quick = solve_step(*programme)
    monkeypatch.setattr(subproblem, "_active_set", lambda *_: None)
    sure = solve_step(*programme)
    assert quick[0] == pytest.approx(sure[0], abs=1e-5)
    assert quick[1] == pytest.approx(sure[1], rel=1e-5)
