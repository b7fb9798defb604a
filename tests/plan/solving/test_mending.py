"""What mending may spend, by a clock that runs by the work alone."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plan.command_options import SolveOptions
from plan.planners import base
from plan.planners.base import Candidate, Ledger
from plan.planners.courses import begin_course
from plan.planners.descent import descend
from plan.problem.certificate import Certificate, certify, keeps_limits
from plan.problem.controllers import Controller, load_controllers
from plan.problem.problem import PlanningProblem
from plan.solving import executed, mending
from plan.solving.mending import (
    CHECKS,
    KEPT_BACK,
    KEPT_FOR_STEP,
    certify_best,
    measure_check,
    share_kept_back,
)
from plan.solving.solve import solve
from plan.spline import Splines
from tests.plan.worlds import problem

CONTROLLERS = {controller.name: controller for controller in load_controllers()}
# What is asked for, and the share of it that all may take at most [s].
ASKED = 4.0
NEARLY = 1.1


class Clock:
    """Processor time that passes only when it is told to [s]."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    """Every ledger's clock, asked anew each time; the motion is planned by one that stands, once."""
    clock = Clock()
    monkeypatch.setattr(base, "processor_seconds", clock)
    # Loops that no earlier test called are compiled in true time, which no search may be given back.
    monkeypatch.setattr(base, "compile_seconds", lambda: 0.0)
    monkeypatch.setattr(base, "LOOK_EVERY", -1.0)
    quick_motion()
    return clock


@cache
def quick_motion() -> PlanningProblem:
    """A motion that rests at its ends and passes its limits of speed by a twentieth.

    Time is the objective.
    """
    task = problem(duration=1.0)
    splines = solve(task, SolveOptions(evaluations=40, gap=False)).splines
    assert splines is not None
    limits = replace(task.limits, speed=splines.top_speed[0] / 1.05, torque=np.full(3, 1e4))
    return task.with_initial(splines, limits=limits, objective="time", free="both")


def spent_ledger(clock: Clock, kept_back: float) -> Ledger:
    """A ledger whose search has just used up its time."""
    own = Ledger(10**9, ASKED - kept_back, kept_back)
    clock.now += own.most_seconds
    return own


@pytest.mark.parametrize("check", [0.01, 0.1, 0.3])
@pytest.mark.parametrize("name", [None, *CONTROLLERS])
def test_mending_takes_no_more_than_was_kept_back(
    name: str | None,
    check: float,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Law: with any controller, whatever a check takes, all that is spent is what was asked for.

    Every search takes all the time that it is given, and a tenth more; nothing it finds is allowed.
    """
    controller = None if name is None else CONTROLLERS[name]
    task = quick_motion()
    checks = []

    def slow_check(
        task: PlanningProblem,
        splines: Splines,
        controller: Controller | None,
    ) -> Certificate:
        clock.now += check
        checks.append(splines)
        return certify(task, splines, controller)

    def slow_search(task: PlanningProblem, share: Ledger, steps: int) -> None:
        clock.now += 1.1 * share.most_seconds

    def slow_run(planner: object, problems: object, share: Ledger, rng: object) -> Ledger:
        clock.now += 1.1 * share.most_seconds
        return share

    monkeypatch.setattr(executed, "certify", slow_check)
    monkeypatch.setattr(mending, "descend_on_knots", slow_search)
    monkeypatch.setattr(mending.Sequential, "run", slow_run)
    monkeypatch.setattr(mending.Evolution, "run", slow_run)
    best = Candidate(task, task.initial, 1.0, 0.0)
    own = spent_ledger(clock, CHECKS[controller is not None] * check)
    own.best = best
    splines, certificate = certify_best(own, np.random.default_rng(0), controller)
    assert clock.now <= NEARLY * ASKED
    # The motion broke its limits; slowed down it does not, and that was seen by two checks.
    assert len(checks) >= 2
    assert splines is not None
    assert certificate is not None
    assert not certificate.broken
    assert splines.total[0] > 1.0


def test_a_motion_that_passed_on_the_way_is_the_last_resort(monkeypatch: pytest.MonkeyPatch) -> None:
    """Law: where the best motion can't be executed and nothing mends it, the best that could be is the plan."""
    monkeypatch.setattr(mending, "descend_on_knots", lambda *_: None)
    controller = CONTROLLERS["ur_servoj"]
    task = replace(quick_motion(), objective="energy", free="vias")
    free = replace(task, limits=replace(task.limits, speed=2.0 * task.limits.speed))
    own = Ledger(10**9, 60.0, at_allowed=measure_check(controller))
    own.offer(Candidate(free, free.initial, 2.0, 0.0))
    own.offer(Candidate(task, task.initial, 1.0, 0.0))
    assert own.best is not None
    assert own.best.cost == 1.0
    _, certificate = certify_best(own, np.random.default_rng(0), controller)
    assert certificate is not None
    assert not certificate.broken


@pytest.mark.parametrize("name", [None, "ros2_control", "ur_servoj"])
@pytest.mark.parametrize("longest", [1.0, 1.2])
def test_a_free_duration_is_mended_by_taking_longer(
    name: str | None, longest: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Law: where the duration is free a motion is slowed down as far as its limits ask for, and the task allows."""
    monkeypatch.setattr(mending, "descend_on_knots", lambda *_: None)
    monkeypatch.setattr(mending, "MENDS", 0)
    task = replace(quick_motion(), objective="energy", free="vias", longest=longest, standby=40.0)
    own = Ledger(10**9, 60.0, best=Candidate(task, task.initial, 1.0, 0.0))
    splines, certificate = certify_best(own, np.random.default_rng(0), None if name is None else CONTROLLERS[name])
    assert splines is not None
    assert certificate is not None
    assert (not certificate.broken) == (longest > 1.05)
    assert splines.total[0] <= longest


@pytest.mark.parametrize("name", [None, "ros2_control", "tm_ros2", "ur_servoj"])
@pytest.mark.parametrize("check", [0.02, 0.5])
@pytest.mark.parametrize("case", ["energy", "energy, broken", "time"])
def test_as_much_is_kept_back_as_a_check_was_seen_to_take(
    name: str | None,
    check: float,
    case: str,
    clock: Clock,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Law: the first motion that is allowed is checked once; the whole stays what was asked for.

    What is kept back are the checks to come, and more where the controller makes another curve of
    the motion, and that breaks something or is still to go to its limits.
    """
    controller = None if name is None else CONTROLLERS[name]

    def slow_check(
        task: PlanningProblem,
        splines: Splines,
        controller: Controller | None,
    ) -> Certificate:
        clock.now += check
        return certify(task, splines, controller)

    monkeypatch.setattr(executed, "certify", slow_check)
    task = quick_motion()
    if case != "time":
        task = replace(task, objective="energy", free="vias")
    if case == "energy":
        task = replace(task, limits=replace(task.limits, speed=2.0 * task.limits.speed))
    share = share_kept_back(controller)
    measure = measure_check(controller)
    own = Ledger(10**9, (1.0 - share) * ASKED, share * ASKED, at_allowed=measure)
    own.offer(Candidate(task, task.initial, 2.0, 1.0))
    assert clock.now == 0.0
    for cost in (2.0, 1.0):
        own.offer(Candidate(task, task.initial, cost, 0.0))
    assert clock.now == pytest.approx(check)
    other_curve = name in ("tm_ros2", "ur_servoj")
    share = KEPT_FOR_STEP if case != "energy" and other_curve else KEPT_BACK
    checks = CHECKS[controller is not None] * check
    assert own.kept_back == pytest.approx(max(share * ASKED, checks))
    assert own.whole == pytest.approx(ASKED)
    assert own.whole_left == pytest.approx(ASKED - check)
    assert own.checked is not None
    own.best = own.checked[0]
    if case == "energy" and name in (None, "ros2_control"):
        certify_best(own, np.random.default_rng(0), controller)
        assert clock.now == pytest.approx(check)  # the same motion is not checked a second time


@pytest.mark.parametrize("seconds", [2.5, 6.5])
def test_no_step_begins_that_would_end_too_late(seconds: float, clock: Clock) -> None:
    """Law: of steps that take a second each, as many are taken as there are whole seconds."""

    class SlowLedger(Ledger):
        """What is counted takes half a second: a step's slopes, and its look."""

        def count(self, evaluations: int) -> None:
            super().count(evaluations)
            clock.now += 0.5

    course = begin_course(problem(duration=1.0))
    own = SlowLedger(10**9, seconds)
    moved = descend(course, own, 30, 0.3, 1e-9)
    assert moved.look.cost < course.look.cost
    assert 0.0 <= own.seconds_left <= 1.0


def test_a_look_at_limits_says_what_the_certificate_says() -> None:
    """Law: a motion keeps its limits by the quick look exactly where its certificate names none."""
    task = quick_motion()
    seen = set()
    for controller in (None, *CONTROLLERS.values()):
        for factor in (1.0, 1.02, 1.04, 1.06, 1.2):
            splines = task.decode(task.initial)
            splines = Splines(splines.points, factor * splines.durations)
            if controller is not None:
                law = executed.find_time_law(task, splines)
                splines = controller.put_on_step(splines, law)
            broken = certify(task, splines, controller).broken
            named = any("limit" in words for words in broken)
            assert keeps_limits(task, splines, controller) != named
            seen.add(named)
    assert seen == {True, False}
