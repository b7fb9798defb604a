"""Brute force: the shared loop equals plain evaluation, and finds the grid's best."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ident.errors import InputError
from plan.paper.brute_force import BruteForce
from tests.plan.worlds import MONITOR, joint_nets, ledger, model, problem


@pytest.mark.parametrize("net", [None, joint_nets()], ids=["no net", "default"])
@pytest.mark.parametrize("blocked", [False, True])
def test_finds_the_best_allowed_grid_point(net: object, blocked: bool) -> None:
    """On a grid of 3⁶ points the result is the cheapest feasible one of plain evaluation, obstacle or not."""
    task = problem(*[MONITOR] if blocked else [], duration=1.0, model=model(net), radius=4.0)  # type: ignore[arg-type]
    start = task.start
    if blocked:  # widen the cells, so that some grid points pass beside the box
        task = replace(task, goal=task.goal + np.radians([10.0, 25.0, 20.0]))
    cells = [(start + (task.goal - start) * k / 2, start + (task.goal - start) * (k + 1) / 2) for k in range(2)]
    axes = [np.linspace(low[j], high[j], 3) for low, high in cells for j in range(3)]
    found = task.evaluate(np.array(list(product(*axes))))
    known = found.cost[found.feasible].min() if found.feasible.any() else None
    book = BruteForce(levels=3).run([task], ledger(), np.random.default_rng(0))
    assert book.evaluations == 3**6
    if known is None:
        assert not book.best.feasible
    else:
        assert book.best.cost == pytest.approx(known, rel=1e-9)


def test_plain_grid_over_durations() -> None:
    """Three levels of three durations: 27 evaluations."""
    task = problem(objective="time", free="times")
    book = BruteForce(levels=3).run([task], ledger(), np.random.default_rng(0))
    assert (book.evaluations, book.best is None) == (27, False)


def test_refuses_a_grid_too_large() -> None:
    """Five via points would be 11¹⁵ points."""
    with pytest.raises(InputError, match="11\\^15"):
        BruteForce().run([problem(vias=5)], ledger(), np.random.default_rng(0))


def test_budget_ends_it() -> None:
    """Out of evaluations, the best so far is kept and the note says so."""
    book = BruteForce(levels=5).run([problem()], ledger(2000), np.random.default_rng(0))
    assert book.best is not None
    assert any("budget" in note for note in book.notes)
