"""The planners that sample, and brute force: what every one of them owes, and what each is for."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ident.errors import InputError
from plan.initial.vias import from_vias
from plan.paper.brute_force import BruteForce
from plan.paper.compression import Compression
from plan.paper.genetic import Genetic
from plan.paper.ppo import Ppo
from plan.paper.toppra import Toppra
from plan.planners.base import Planner
from plan.planners.evolution import Evolution
from plan.problem.certificate import certify
from tests.plan.worlds import MONITOR, joint_nets, ledger, model, problem

SAMPLERS = {"ppo": Ppo(epochs=300), "ga": Genetic(population=40, generations=20), "cma": Evolution()}
each_sampler = pytest.mark.parametrize("planner", SAMPLERS.values(), ids=SAMPLERS)


@each_sampler
def test_better_than_the_start_and_allowed(planner: Planner) -> None:
    """Every method ends with a feasible motion cheaper than the initial one."""
    task = problem()
    book = planner.run([task], ledger(), np.random.default_rng(0))
    assert book.best.feasible
    assert book.best.cost < 0.98 * task.initial_evaluation.cost[0]


@each_sampler
def test_same_seed_same_result_within_the_budget(planner: Planner) -> None:
    """Two runs with one seed agree to the last bit, another seed differs; no evaluation goes beyond the budget."""
    runs = [planner.run([problem()], ledger(237), np.random.default_rng(seed)) for seed in (1, 1, 2)]
    first, again, other = (run.best.x for run in runs)
    assert [run.evaluations for run in runs] == [237] * 3
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_ppo_schedule() -> None:
    """Every start gets its 100 epochs first; the rest goes by rounds of 100 to starts drawn by what they learn."""
    task = problem(MONITOR, duration=1.0)
    starts = [
        from_vias(task, np.radians([[40.0, 20.0, -94.0]]), "near", 2),
        from_vias(task, np.radians([[-40.0, 90.0, -90.0]]), "far", 2),
    ]
    counts: dict[str, int] = {"near": 0, "far": 0}
    book = ledger()
    evaluate = book.evaluate

    def counting(which, x):  # type: ignore[no-untyped-def]
        counts[which.label] += len(x)
        return evaluate(which, x)

    book.evaluate = counting  # type: ignore[method-assign]
    Ppo(epochs=800).run(starts, book, np.random.default_rng(0))
    assert counts["far"] >= 100
    assert counts["near"] > 400
    assert sum(counts.values()) == 800


@pytest.mark.parametrize("mode", ["factor", "pass", "sections"])
def test_compression_stops_at_a_limit(mode: str) -> None:
    """Compression keeps the via points and breaks nothing; all but the literal one meet some limit to 1 %."""
    task = problem(duration=4.0, objective="time", free="times")
    book = Compression(mode=mode).run([task], ledger(), np.random.default_rng(0))  # type: ignore[arg-type]
    found = certify(task, book.best.splines)
    assert book.best.splines.points[0, 1:-1] == pytest.approx(task.vias)
    assert not found.broken
    if mode != "pass":  # which stops where the spline between unequal sections leaves its way, or at their least
        assert max(found.torque_share.max(), found.speed_share.max()) > 0.98
    if mode == "factor":
        assert np.ptp(book.best.splines.durations) == pytest.approx(0.0, abs=1e-9)


def test_toppra_bounds_its_path() -> None:
    """toppra's time is below that of any cubic time law on the same path, and its motion breaks nothing."""
    task = problem(duration=1.0, objective="time", free="times")
    book = Toppra().run([task], ledger(), np.random.default_rng(0))
    factor = Compression(mode="factor").run([task], ledger(), np.random.default_rng(0))
    assert book.best.feasible
    assert book.best.cost < factor.best.cost
    bound = float(book.notes[-1].split(": ")[1].split(" s")[0])
    assert bound <= book.best.cost
    path = task.decode(task.initial).at(np.linspace(0, 1, 3000))[0]
    q = book.best.splines.at(np.linspace(0, book.best.cost, 50))[0]
    away = np.array([np.abs(path - row).max(axis=1).min() for row in q])
    assert away.max() < 0.02


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


def test_refuses_a_grid_too_large() -> None:
    """Five via points would be 11¹⁵ points."""
    with pytest.raises(InputError, match="11\\^15"):
        BruteForce().run([problem(vias=5)], ledger(), np.random.default_rng(0))


def test_budget_ends_it() -> None:
    """Out of evaluations, the best so far is kept and the note says so."""
    book = BruteForce(levels=5).run([problem()], ledger(2000), np.random.default_rng(0))
    assert book.best is not None
    assert any("budget" in note for note in book.notes)
