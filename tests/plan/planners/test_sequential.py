"""The default planner: its coefficients, derivatives, steps and turns; what it may do more never makes it worse."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.random import Generator

from plan.dynamics.power import METRICS
from plan.initial.limit_times import quickest_of_each_joint
from plan.paper.brute_force import BruteForce
from plan.planners import local_model, subproblem, velocity_reversals
from plan.planners.courses import SAME, begin_course, nodes_of
from plan.planners.descent import begin, descend, move_aside
from plan.planners.evolution import Evolution
from plan.planners.local_model import LocalModel
from plan.planners.near_pairs import CLEARANCE_UNIT, EXTRA, clearance_rows
from plan.planners.refinement import choose_parts, count_finer, refine
from plan.planners.sequential import POLISHED, Sequential
from plan.planners.subproblem import ConstraintRows, solve_step
from plan.planners.transcription import Grid
from plan.problem.certificate import certify
from plan.problem.problem import PlanningProblem
from plan.problem.ramps import find_time_law
from tests.plan.worlds import GOAL, MONITOR, START, dense_net, joint_nets, ledger, model, problem

QUICK = Sequential(starts=2, kept=(1,), levels=1)


def moved(task: PlanningProblem, seed: int = 1) -> tuple[LocalModel, np.ndarray]:
    """A task's coefficients, all of them moved a little."""
    course = begin_course(task)
    return course.local, course.x + 0.1 * np.random.default_rng(seed).normal(size=len(course.x))


@pytest.mark.parametrize("parts", [[2, 2, 2, 2, 2], [1, 3, 1, 4, 2]])
@pytest.mark.parametrize("soft", [False, True])
def test_coefficients_hold_the_same_spline(soft: bool, parts: list[int]) -> None:
    """Coefficients, knots and parted sections describe one curve; its ends are at rest, and soft ends without push."""
    rng = np.random.default_rng(0)
    grid = Grid(np.array([0.0, 0.1, 0.35, 0.5, 0.8, 1.0]), soft)
    free = rng.normal(size=(grid.free, 3))
    first = grid.splines(grid.coefficients(free, START, GOAL), 0.7)
    finer = grid.parted(np.array(parts))
    assert np.isin(grid.knots, finer.knots).all()
    second = finer.splines(finer.coefficients(finer.fit(first), START, GOAL), 0.7)
    times = np.linspace(0.0, 0.7, 200)
    for a, b in zip(first.at(times), second.at(times), strict=True):
        assert a == pytest.approx(b, abs=1e-8)
    assert first.at(times)[1][[0, -1]] == pytest.approx(np.zeros((2, 3)), abs=1e-9)
    assert (np.abs(first.at(times)[2][[0, -1]]).max() < 1e-9) == soft
    states = grid.states(grid.coefficients(free, START, GOAL), 0.7)
    for a, b in zip(states[:2], first.at(grid.shares * 0.7)[:2], strict=True):
        assert a == pytest.approx(b, abs=1e-9)


@pytest.mark.parametrize("steps", [12, 29, 400])
def test_knots_stay_on_a_controllers_step(steps: int) -> None:
    """Law: of every grid all knots end one of so many equal parts, and a finer one holds what the coarser held."""
    course = begin_course(problem(duration=1.0), steps)
    before = course.local.grid
    for _ in range(3):
        parts = choose_parts(course)
        grid = course.local.grid.parted(parts)
        assert grid.knots * steps == pytest.approx(np.round(grid.knots * steps), abs=1e-9)
        assert (np.diff(grid.knots) > 0.5 / steps).all()
        assert np.isin(before.knots, grid.knots).all()
        assert len(grid.knots) - 1 == parts.sum() <= steps
        before = grid
        course = refine(course, 0.01, 0.5, (grid.nodes, course.local.weights))


def test_a_finer_grid_is_finer_where_limits_switch() -> None:
    """Law: the middle of a bang-bang motion and its ends get more parts than the mean, of as many as are due."""
    task = problem(duration=1.0, objective="time", free="both")
    limits = replace(task.limits, acceleration=np.full(3, 3.0), torque=np.full(3, 1e5))
    each = quickest_of_each_joint(replace(task, limits=limits))
    assert each is not None
    course = descend(begin_course(each), ledger(), 30, 0.3, 1e-4)
    sections = course.local.grid.sections
    parts = choose_parts(course)
    assert parts.sum() == count_finer(course.local) > sections
    assert parts.min() >= 1
    middle = parts[sections // 2 - 1 : sections // 2 + 1]
    assert min(parts[0], parts[-1], middle.max()) > parts.mean()


def test_few_sections_all_go_in_two() -> None:
    """Law: a first grid of energy holds nothing that tells where more sections are due."""
    course = begin_course(problem(duration=1.0))
    assert choose_parts(course).tolist() == [2] * course.local.grid.sections


@pytest.mark.parametrize("bend", [0.3, 0.5, 0.7])
def test_a_finer_grid_is_finer_where_a_motion_bends(bend: float) -> None:
    """Law: where least energy is bent aside in one place, the sections there get the most parts."""
    course = begin_course(problem(duration=1.0))
    course = refine(course, 0.01, 0.5, nodes_of(False, count_finer(course.local)))
    grid = course.local.grid
    free = course.x.reshape(-1, 3).copy()
    free[np.argmin(np.abs(grid.places[grid.held : -grid.held] - bend))] += 0.5
    aside = replace(course, x=course.local.join(free, 1.0))
    parts = choose_parts(aside)
    assert parts.sum() == count_finer(course.local)
    assert parts.min() == 1
    middles = (grid.knots[1:] + grid.knots[:-1]) / 2
    assert np.abs(middles[parts == parts.max()] - bend).max() <= 2.5 / grid.sections


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_derivatives_are_those_of_what_is_looked_at(objective: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Slope of the cost and rows of all limits equal differences, acceleration and jerk among them."""
    monkeypatch.setattr(local_model, "WATCHED_SHARE", -1.0)
    monkeypatch.setattr(velocity_reversals, "SLOW", 1e-3)  # turns that hardly accelerate are not followed in earnest
    task = problem(MONITOR, duration=1.0, objective=objective)
    limits = replace(task.limits, acceleration=np.full(3, 60.0), jerk=np.full(3, 500.0))
    local, x = moved(replace(task, limits=limits))
    step = 1e-5 * np.random.default_rng(2).normal(size=len(x))
    slope, _, rows = local.gradient(local.linearise(x))
    ends = [local.gradient(local.linearise(x + sign * step))[2].room for sign in (1.0, -1.0)]
    assert slope @ step == pytest.approx((local.look(x + step).cost - local.look(x - step).cost) / 2, rel=1e-3)
    assert rows.matrix @ step == pytest.approx((ends[1] - ends[0]) / 2, abs=1e-9)
    clear = clearance_rows(local, x)
    assert len(clear.room) > 0
    assert clear.room.min() == pytest.approx(-local.look(x).clearance, abs=0.03)


def test_a_limit_that_a_step_passes_is_known_though_it_was_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: watched rows and those that a step passes tell of the worst node of all, to first order."""
    monkeypatch.setattr(LocalModel, "_turn_rows", lambda local, *_: ConstraintRows.none(local.size))
    task = problem(duration=1.0, objective="time")
    limits = replace(task.limits, acceleration=np.full(3, 60.0))
    course = begin_course(replace(task, limits=limits))
    local = course.local
    x = course.x
    about = local.linearise(x)
    near = local.gradient(about)[2]

    def shares(moved_x: np.ndarray) -> np.ndarray:
        there = local.linearise(moved_x)
        _, dq, ddq = there.states
        _, speed = local._rate_limits[0]
        return np.stack([there.torque[0] / local._torque_limit, dq / speed, ddq / local._rate_limits[1][1]])

    rng = np.random.default_rng(3)
    missed = 0
    for _ in range(20):
        step = 0.05 * rng.normal(size=len(x))
        known = ConstraintRows.join([near, local.passed_limits(about, step)])
        small = 1e-6 * step
        after = shares(x) + (shares(x + small) - shares(x - small)) / 2e-6
        assert known.shortfall_after(step) == pytest.approx(np.abs(after).max() - 1.0, rel=1e-4)
        missed += near.shortfall_after(step) < known.shortfall_after(step)
    assert missed > 0


def test_a_motion_just_beyond_its_margin_promises_no_clearance() -> None:
    """Law: rows of the clearance count as broken what `look` does, and no less."""
    local, x = moved(problem(MONITOR, duration=1.0))
    broken = clearance_rows(local, x).shortfall
    assert broken > 0.0
    assert broken <= local.look(x).clearance + 0.4 * EXTRA / CLEARANCE_UNIT


def test_what_is_found_hardly_depends_on_the_seed() -> None:
    """Energy of a task with something in the way, from three seeds, within half a per cent."""
    task = problem(MONITOR, duration=1.0)
    costs = [Sequential().run([task], ledger(), np.random.default_rng(seed)).best.cost for seed in range(3)]
    assert max(costs) <= 1.005 * min(costs)


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


@pytest.fixture
def local(monkeypatch: pytest.MonkeyPatch) -> LocalModel:
    monkeypatch.setattr(local_model, "WATCHED_SHARE", 0.0)
    return begin_course(replace(problem(), objective="time", free="both")).local


def bent(local: LocalModel) -> np.ndarray:
    """Variables of a motion on which joints turn round."""
    rng, x = np.random.default_rng(0), local.join(local.grid.fit(local.problem.decode(local.problem.initial)), 0.6)
    x[:-1] += 0.1 * rng.normal(size=len(x) - 1)
    return x


def test_no_peak_where_a_joint_turns_is_missed(local: LocalModel) -> None:
    """At ten thousand places the torque near a turn is nowhere above what was found at the turns."""
    x = bent(local)
    splines = local.splines(x)
    q, dq, ddq = (part[0] for part in splines.states(np.linspace(0.0, 1.0, 1000)))
    tau = np.abs(local.problem.model.torque(q[None], dq[None], ddq[None])[0])
    coefficients, duration = local.split(x)
    turns, at, _ = local._turns(coefficients, *local.grid.states(coefficients, duration)[1:], duration)
    found = np.abs(turns.torque(local.problem.model, at))  # type: ignore[arg-type]
    for j in range(local.n):
        slow = np.abs(dq[:, j]) < 0.02
        assert tau[slow, j].max() < 1.02 * found[turns.joints == j].max()


def test_a_joint_that_waits_does_not_turn(local: LocalModel) -> None:
    """Creeping to and fro slower than friction takes to change sides is no turn: no limit jumps with it."""
    x = bent(local)
    moved = x[:-1].reshape(-1, local.n)
    moved[:, 0] = local.problem.start[0] + 1e-6 * np.random.default_rng(2).normal(size=len(moved))
    coefficients, duration = local.split(x)
    _, dq, ddq = local.grid.states(coefficients, duration)
    assert (dq[:-1, 0] * dq[1:, 0] < 0.0).any()
    turns = local._turns(coefficients, dq, ddq, duration)[0]
    assert 0 not in turns.joints[turns.inside]
    assert {1, 2} & set(turns.joints[turns.inside])


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_better_than_few_vias(objective: str) -> None:
    """Free knots reach at least what five via points reach, and what they reach is allowed."""
    task = problem(vias=5, objective=objective, free="vias" if objective == "energy" else "both")
    task = replace(task, limits=replace(task.limits, jerk=np.full(3, 1e6)))  # ends without acceleration for both
    known = Sequential().run([replace(task, grows=False)], ledger(), np.random.default_rng(0)).best
    best = QUICK.run([task], ledger(), np.random.default_rng(0)).best
    assert best.feasible
    assert best.cost <= known.cost * 1.001


def test_first_step_is_taken_from_the_start() -> None:
    """A course before its first step is the initial trajectory, on knots that are named."""
    task = problem(duration=1.0)
    course = begin_course(replace(task, grows=False))
    assert begin(course.local, course.x).look.cost == course.look.cost
    points = course.local.splines(course.x).at(np.linspace(0.0, 1.0, 50))[0]
    assert points == pytest.approx(task.decode(task.initial).at(np.linspace(0.0, 1.0, 50))[0], abs=1e-9)


@pytest.mark.parametrize("kept_back", [0.0, 1.0])
def test_polishing_never_costs_more(kept_back: float) -> None:
    """Law: the best motion only falls; where nobody asked for seconds nothing is polished."""
    rough = Sequential(starts=1, first=6, kept=(1,), levels=0)
    best = rough.run([problem(duration=1.0)], ledger(), np.random.default_rng(0)).best
    assert best is not None
    own = ledger(seconds=20.0, kept_back=kept_back)
    own.offer(best)
    Sequential()._polish(own)
    assert own.best is not None
    assert own.best.feasible
    if kept_back == 0.0:
        assert own.evaluations == 0
        return
    assert own.best.cost < best.cost
    polished = own.best
    Sequential()._polish(own)
    assert own.best.cost >= polished.cost * (1.0 - 2.0 * POLISHED)


@pytest.mark.parametrize("objective", ["energy", "time"])
def test_a_motion_is_moved_aside_within_its_bounds(objective: str) -> None:
    """Law: what is drawn beside a motion keeps its ends, its duration and the search's bounds, and is another."""
    task = problem(objective=objective, free="both" if objective == "time" else "vias")
    course = begin_course(task)
    low, high = course.local.bounds
    for seed in range(20):
        beside = move_aside(course, np.random.default_rng(seed))
        assert np.all((low <= beside) & (beside <= high))
        points, duration = course.local.split(beside)
        assert points[0].tolist() == task.start.tolist()
        assert points[-1].tolist() == task.goal.tolist()
        assert duration == course.local.split(course.x)[1]
        assert np.abs(beside - course.x).max() > SAME


def test_asked_seconds_that_are_left_are_spent() -> None:
    """Law: what is looked at while asked seconds are left costs evaluations, and never ends worse."""
    task = problem(objective="time", free="both")
    quick = Sequential(starts=1, first=6, kept=(1,), steps=3)
    first = quick.run([task], ledger(), np.random.default_rng(0))
    longer = ledger(first.evaluations + 150, kept_back=0.1)
    quick.run([task], longer, np.random.default_rng(0))
    assert first.best is not None
    assert longer.best is not None
    assert first.best.feasible
    assert longer.best.cost <= first.best.cost
    assert longer.evaluations > first.evaluations
