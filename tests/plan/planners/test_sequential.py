"""The default planner: its coefficients, its derivatives, and that what it may do more never makes it worse."""

from dataclasses import replace

import numpy as np
import pytest

from plan.dynamics.power import METRICS
from plan.initial.starts import quickest_of_each_joint, straight
from plan.paper.brute_force import BruteForce
from plan.planners import local_model, velocity_reversals
from plan.planners.descent import begin, descend, refine
from plan.planners.evolution import Evolution
from plan.planners.local_model import LocalModel
from plan.planners.sequential import Sequential, begin_course
from plan.planners.transcription import Grid
from plan.problem.problem import PlanningProblem
from plan.problem.result import certify
from plan.problem.time_law import find_time_law
from tests.plan.worlds import GOAL, MONITOR, START, dense_net, joint_nets, ledger, model, problem

QUICK = Sequential(starts=2, kept=(1,), levels=1)


def moved(task: PlanningProblem, seed: int = 1) -> tuple[LocalModel, np.ndarray]:
    """A task's coefficients, all of them moved a little."""
    course = begin_course(task)
    return course.local, course.x + 0.1 * np.random.default_rng(seed).normal(size=len(course.x))


@pytest.mark.parametrize("soft", [False, True])
def test_coefficients_hold_the_same_spline(soft: bool) -> None:
    """Coefficients, knots and sections in two describe one curve; its ends are at rest, and soft ends without push."""
    rng = np.random.default_rng(0)
    grid = Grid(np.array([0.0, 0.1, 0.35, 0.5, 0.8, 1.0]), soft)
    free = rng.normal(size=(grid.free, 3))
    first = grid.splines(grid.coefficients(free, START, GOAL), 0.7)
    finer = grid.halved()
    second = finer.splines(finer.coefficients(finer.fit(first), START, GOAL), 0.7)
    times = np.linspace(0.0, 0.7, 200)
    for a, b in zip(first.at(times), second.at(times), strict=True):
        assert a == pytest.approx(b, abs=1e-8)
    assert first.at(times)[1][[0, -1]] == pytest.approx(np.zeros((2, 3)), abs=1e-9)
    assert (np.abs(first.at(times)[2][[0, -1]]).max() < 1e-9) == soft
    states = grid.states(grid.coefficients(free, START, GOAL), 0.7)
    for a, b in zip(states[:2], first.at(grid.shares * 0.7)[:2], strict=True):
        assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_derivatives_are_those_of_what_is_looked_at(objective: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slope of the cost and rows of all limits equal differences, acceleration and jerk among them."""
    monkeypatch.setattr(local_model, "WATCHED_SHARE", -1.0)
    monkeypatch.setattr(velocity_reversals, "SLOW", 1e-3)  # turns that hardly accelerate are not followed in earnest
    task = problem(MONITOR, duration=1.0, objective=objective)
    limits = replace(task.limits, acceleration=np.full(3, 60.0), jerk=np.full(3, 500.0))
    local, x = moved(replace(task, limits=limits))
    step = 1e-5 * np.random.default_rng(2).normal(size=len(x))
    slope, _, rows = local.gradient(x)
    ends = [local.gradient(x + sign * step)[2].room for sign in (1.0, -1.0)]
    assert slope @ step == pytest.approx((local.look(x + step).cost - local.look(x - step).cost) / 2, rel=1e-3)
    assert rows.matrix @ step == pytest.approx((ends[1] - ends[0]) / 2, abs=1e-9)
    clear = local.clearance_rows(x)
    assert len(clear.room) > 0
    assert clear.room.min() == pytest.approx(-local.look(x).clearance, abs=0.03)


def test_what_is_found_hardly_depends_on_the_seed() -> None:
    """Energy of a task with something in the way, from three seeds, within half a per cent."""
    task = problem(MONITOR, duration=1.0)
    costs = [Sequential().run([task], ledger(), np.random.default_rng(seed)).best.cost for seed in range(3)]
    assert max(costs) <= 1.005 * min(costs)


def test_a_finer_grid_begins_where_the_coarser_one_ended() -> None:
    """Sections in two change nothing, and steps from there lower the cost."""
    course = begin_course(problem(duration=1.0))
    course = descend(course, ledger(), 30, 0.3, 1e-4)
    local = course.local
    finer = refine(course, local.width, local.power, (local.grid.nodes, local.weights))
    assert finer.look.cost == pytest.approx(course.look.cost, rel=2e-3)
    better = descend(finer, ledger(), 30, 0.1, 1e-5)
    assert better.look.cost <= finer.look.cost


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_better_than_few_vias(objective: str) -> None:
    """Free knots reach at least what five via points reach, and what they reach is allowed."""
    task = problem(vias=5, objective=objective, free="vias" if objective == "energy" else "both")
    task = replace(task, limits=replace(task.limits, jerk=np.full(3, 1e6)))  # ends without acceleration for both
    known = Sequential().run([replace(task, grows=False)], ledger(), np.random.default_rng(0)).best
    best = QUICK.run([task], ledger(), np.random.default_rng(0)).best
    assert best.feasible
    assert best.cost <= known.cost * 1.001


def test_more_via_points_never_end_worse() -> None:
    """Asked for five via points it finds what it finds for three, or better, and gives five at least."""
    costs = []
    for count in (3, 5, 8):
        task = replace(problem(), vias=straight(START, GOAL, count), durations=np.full(count + 1, 0.65 / (count + 1)))
        best = QUICK.run([task], ledger(), np.random.default_rng(0)).best
        assert best.problem.via_count >= count
        costs.append(best.cost)
    assert costs[1] <= costs[0] * (1.0 + 1e-9)
    assert costs[2] <= costs[1] * (1.0 + 1e-9)


def test_goes_round_what_is_in_the_way() -> None:
    """A box on the line is passed with the clearance asked for, every instant proven."""
    task = problem(MONITOR, duration=1.0)
    best = QUICK.run([task], ledger(), np.random.default_rng(0)).best
    assert certify(task, best.splines).broken == []


def test_acceleration_and_jerk_are_kept() -> None:
    """With limits on both, a time plan keeps them, and starts and ends without acceleration."""
    task = problem(objective="time", free="both")
    task = replace(task, limits=replace(task.limits, acceleration=np.full(3, 15.0), jerk=np.full(3, 300.0)))
    best = QUICK.run([task], ledger(), np.random.default_rng(0)).best
    assert best.feasible
    total = float(best.splines.total[0])
    _, _, ddq = best.splines.at(np.linspace(0.0, total, 2001))
    assert np.abs(ddq).max() <= 15.0
    assert np.abs(ddq[[0, -1]]).max() < 1e-6
    assert np.abs(np.diff(ddq, axis=0)).max() / (total / 2000) <= 300.0 * (1 + 1e-6)


def test_the_same_seed_gives_the_same_plan() -> None:
    """No hidden randomness."""
    task = problem(MONITOR, duration=1.0)
    costs = [QUICK.run([task], ledger(), np.random.default_rng(4)).best.cost for _ in range(2)]
    assert costs[0] == costs[1]


def test_steps_end_with_the_budget() -> None:
    """A dozen evaluations are a dozen, a step's own among them."""
    book = ledger(evaluations=12)
    QUICK.run([problem(MONITOR, duration=1.0)], book, np.random.default_rng(0))
    assert book.evaluations <= 13


def test_first_step_is_taken_from_the_start() -> None:
    """A course before its first step is the initial trajectory, on knots that are named."""
    task = problem(duration=1.0)
    course = begin_course(replace(task, grows=False))
    assert begin(course.local, course.x).look.cost == course.look.cost
    points = course.local.splines(course.x).at(np.linspace(0.0, 1.0, 50))[0]
    assert points == pytest.approx(task.decode(task.initial).at(np.linspace(0.0, 1.0, 50))[0], abs=1e-9)


@pytest.mark.parametrize("metric", METRICS)
def test_named_via_points_end_at_or_below_the_grid(metric: str) -> None:
    """On the knots that are given the optimum is at or below the best point of a 6⁶ grid, and flat to first order."""
    task = problem(metric=metric, grows=False)
    best = Sequential().run([task], ledger(), np.random.default_rng(0)).best
    grid = BruteForce(levels=6).run([task], ledger(), np.random.default_rng(0)).best
    assert best.feasible
    assert best.problem.via_count == task.via_count
    assert best.cost <= grid.cost * (1 + 1e-4)
    around = task.evaluate(best.x + np.concatenate([np.eye(6), -np.eye(6)]) * np.radians(0.5)).cost
    assert np.all(around >= best.cost - 5e-3)


@pytest.mark.parametrize("net", [joint_nets(), dense_net()], ids=["default", "paper"])
def test_named_via_points_with_a_net(net: object) -> None:
    """With a net inside, CMA-ES finds nothing more than 0.1 % better."""
    task = problem(model=model(net), grows=False)
    best = Sequential().run([task], ledger(), np.random.default_rng(0)).best
    other = Evolution(most=3000).run([task], ledger(), np.random.default_rng(0)).best
    assert best.cost <= other.cost * 1.001


def test_named_time_stamps_meet_a_limit() -> None:
    """With the path's via points kept the time optimum breaks nothing, and some joint is at its limit."""
    task = problem(objective="time", free="times")
    best = Sequential().run([task], ledger(), np.random.default_rng(0)).best
    assert best.problem.vias == pytest.approx(task.vias)
    found = certify(task, best.splines)
    assert best.feasible
    assert max(found.torque_share.max(), found.speed_share.max()) > 0.99
    assert best.cost < 0.6 * 0.65


def test_the_shortest_time_does_not_hang_on_the_guess() -> None:
    """From guesses ten times apart the same motion is found, executed as it is planned."""
    task = problem(objective="time", free="both")
    task = replace(task, limits=replace(task.limits, acceleration=np.full(3, 15.0), jerk=np.full(3, 300.0)))
    found = []
    for guess in (0.3, 3.0):
        guessed = replace(task, durations=np.full(3, guess / 3))
        found.append(QUICK.run([guessed], ledger(), np.random.default_rng(0)).best)
    assert found[0].cost == pytest.approx(found[1].cost, rel=1e-6)
    quickest = quickest_of_each_joint(task)
    assert found[0].cost <= 1.02 * quickest.durations.sum() or certify(task, found[0].splines).torque_share.max() > 0.95
    assert find_time_law(task, found[0].splines).duration == pytest.approx(found[0].cost)
