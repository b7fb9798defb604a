"""Several processes search what one would, each from its own chance, within the same budget."""

import numpy as np
import pytest

from plan.command_options import SolveOptions
from plan.planners.base import Ledger
from plan.planners.sequential import Sequential
from plan.solving.solve import solve
from plan.solving.workers import search_together
from tests.plan.worlds import MONITOR, problem

PLANNER = Sequential(starts=3, kept=(1,), levels=1)


def test_the_best_of_all_is_taken() -> None:
    """No worker's own search ends lower, the first worker's is the search alone, and all their evaluations count."""
    task = problem(MONITOR, duration=1.0)
    alone, costs = [], []
    for number in range(2):
        own = Ledger(10**6, 30.0)
        PLANNER.run([task], own, np.random.default_rng(3 if number == 0 else [3, number]))
        alone.append(own)
        assert own.best is not None
        costs.append(own.best.cost)
    together = Ledger(2 * 10**6, 60.0)
    search_together(PLANNER, [task], together, 3, 2)
    assert together.best is not None
    assert together.best.feasible
    assert together.best.cost == pytest.approx(min(costs), rel=1e-12)
    assert together.evaluations == sum(own.evaluations for own in alone)
    again = task.with_initial(together.best.splines).initial_evaluation
    assert float(again.cost[0]) == pytest.approx(together.best.cost, rel=1e-6)


def test_a_plan_by_workers_is_certified_and_the_same_again() -> None:
    """The same seed and the same number of workers find the same plan."""
    task = problem(MONITOR, duration=1.0)
    options = SolveOptions(gap=False, workers=2, seed=1)
    first, second = (solve(task, options, PLANNER) for _ in range(2))
    assert first.solved
    assert first.cost == second.cost
    assert first.certificate is not None
    assert first.certificate.broken == []


def test_workers_share_the_budget() -> None:
    """Trajectories that may be evaluated are parted among the workers."""
    task = problem(MONITOR, duration=1.0)
    ledger = Ledger(40, 60.0)
    search_together(PLANNER, [task], ledger, 0, 4)
    assert 0 < ledger.evaluations <= 4 * 14  # a step that has begun ends
    assert ledger.remaining <= 40 - ledger.evaluations or ledger.remaining == 0
