"""The best motion of a search as it is executed: checked densely, and mended where that breaks.

The search's samples may have missed something, or the controller makes another curve of the motion.
Of seconds that were asked for, mending takes what is left and no more: what a check takes is
measured, the dearest so far is kept back from every search, and a motion is checked in full only
where a look at its limits alone finds nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np

from plan.planners.base import Candidate, Ledger, Planner
from plan.planners.evolution import Evolution
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.certificate import Certificate, keeps_limits, limit_shares
from plan.problem.controllers import Controller
from plan.problem.problem import Limits
from plan.solving.executed import (
    Executed,
    cost_of,
    execute,
    is_short_enough,
    price_of,
    put_on_step,
    tighter,
    with_knots_on_step,
    with_limits,
)
from plan.spline import Splines

# Times that a motion whose dense check fails is searched anew with tightened limits, by each way of
# searching; what each may take where nobody asked for seconds, at least and at most [s]; and
# trajectories at most.
MENDS = 3
MEND_SECONDS = (1.0, 5.0)
MEND_EVALUATIONS = 3000
# A mended motion that costs more than the searched one by no more than this share ends the mending.
HARDLY = 0.002
# Factors by which a motion is slowed down to keep its limits between the search's samples.
SLOWER = (1.0 + 0.0005 * 2.0 ** np.arange(8)).tolist()
# The same on a controller's coarse step, of which a slower motion is followed the better: a search
# on it comes later.
MUCH_SLOWER = (1.001, 1.004, 1.016, 1.04, 1.08, 1.15, 1.25, 1.4, 1.7, 2.0)
# Factors by which a motion on a controller's step is made longer until it keeps its limits.
LONGER = (1.0, 1.005, 1.015, 1.03, 1.06, 1.1, 1.25, 1.5)
# How far a via angle may move there [rad], and most steps.
ON_STEP = np.pi / 2
ON_STEP_STEPS = 40
# Limits of a search anew are tighter than what was passed by this factor, and each time by so much
# more; the same on a controller's step, from the second time on.
SLACK = (1.002, 0.01)
SLACK_ON_STEP = (1.0005, 0.002)
# By how much more clearance is asked for each time [m], and how far a via angle may move [rad].
MORE_CLEARANCE = 0.002
NEARBY = 0.15
# Share of the time that is kept back from a search for checks and for mending; and where another
# search on a controller's step may follow.
KEPT_BACK = 0.1
KEPT_FOR_STEP = 0.25
# So many checks are kept back at the least: the first, and one each after slowing down and after
# a search on a controller's step.
CHECKS = {False: 2, True: 3}


def share_kept_back(controller: Controller | None) -> float:
    """The share of the time that is kept back while nothing is known yet."""
    if controller is None or controller.keeps_curve:
        return KEPT_BACK
    return KEPT_FOR_STEP


def measure_check(controller: Controller | None) -> Callable[[Ledger, Candidate], None]:
    """What a ledger does with a motion that is allowed and the best so far.

    The first is checked once, and as much is kept back as the checks at the end will take. Of least
    energy, a motion that keeps its limits on the controller's step as it is leaves no time for a
    search on that; it is remembered, as a better one may break them. What takes the shortest time
    goes to its limits later.

    Args:
        controller: Who executes the plan; None for a plan by itself.
    """
    checks: list[float] = []
    usual = share_kept_back(controller)

    def measure(ledger: Ledger, candidate: Candidate) -> None:
        is_first = not checks
        if is_first:
            before = ledger.cpu_seconds
            executed = execute(candidate, controller)
            passes = executed.allowed
            ledger.checked = (candidate, executed)
            ledger.check_seconds = ledger.cpu_seconds - before
            checks.append(CHECKS[controller is not None] * ledger.check_seconds)
        elif candidate.problem.objective == "time" or usual == KEPT_BACK:
            return
        else:
            on_step = put_on_step(candidate, controller)
            passes = keeps_limits(candidate.problem, on_step, controller)
        share = usual
        if passes and candidate.problem.objective == "energy":
            share = KEPT_BACK
            ledger.passed = candidate
        ledger.keep_back(max(share * ledger.whole, checks[0]))

    return measure


def certify_best(
    ledger: Ledger,
    rng: np.random.Generator,
    controller: Controller | None,
) -> tuple[Splines | None, Certificate | None]:
    """The best candidate, on its controller's step if there is one, and its dense check.

    It is mended where it breaks something. Mending ends at the first motion that passes and costs
    hardly more than what was found.

    Args:
        ledger: What was found, and what may still be spent.
        rng: Source of randomness.
        controller: Who executes the plan; None for a plan by itself.
    """
    best = ledger.best
    if best is None:
        return None, None
    mending = _Mending(best, ledger, controller)
    executed = mending.run(rng)
    return executed.splines, executed.certificate


def time_for_mending(ledger: Ledger, check: float = 0.0) -> float:
    """Processor time for one search that mends [s].

    Where the user has said how much all may take, it is what is left less a check; else within
    bounds of its own.

    Args:
        ledger: What may still be spent.
        check: What a check takes [s].
    """
    least, most = MEND_SECONDS
    if ledger.kept_back > 0.0:
        return float(np.clip(ledger.whole_left - check, 0.0, most))
    return float(np.clip(ledger.whole_left, least, most))


class _Mending:
    """The best motion of a search, what became of it, and what its checks took."""

    def __init__(self, best: Candidate, ledger: Ledger, controller: Controller | None) -> None:
        self._best = best
        self._ledger = ledger
        self._controller = controller
        self._dearest_check = 0.0
        self._chosen: Executed | None = None

    def run(self, rng: np.random.Generator) -> Executed:
        """The best motion, mended if it must be and can be."""
        best = self._best
        first = self._check(best)
        if first.allowed or not best.feasible:
            return first
        broken = "; ".join(first.certificate.broken)
        self._ledger.notes.append(f"{self._what_is_done}: {broken}")
        if self._controller is None:
            ways = self._search_again(first.certificate, rng)
        else:
            ways = self._fit_to_step(self._controller, first.certificate)
        for executed in ways:
            if not executed.allowed:
                continue
            if self._chosen is None or executed.cost < self._chosen.cost:
                self._chosen = executed
            searched = price_of(best)
            if executed.cost <= searched + HARDLY * abs(searched):
                break
        passed = self._ledger.passed
        if self._chosen is None and passed is not None:
            self._chosen = self._check(passed)
        return self._chosen or first

    @property
    def _what_is_done(self) -> str:
        """In words, for the plan's notes."""
        if self._controller is None:
            return "mended between the search's samples"
        step = f"the step of {self._controller.name}"
        return f"moved onto {step}, as the curve that it makes of the motion"

    @property
    def _time(self) -> float:
        """Processor time for one search that mends [s]."""
        return time_for_mending(self._ledger, self._dearest_check)

    def _check(self, candidate: Candidate) -> Executed:
        """A candidate as it is executed, checked; the same one is not checked twice."""
        if self._ledger.checked is not None:
            known, executed = self._ledger.checked
            if known is candidate:
                assert isinstance(executed, Executed)
                return executed
        before = self._ledger.cpu_seconds
        executed = execute(candidate, self._controller)
        spent = self._ledger.cpu_seconds - before
        self._dearest_check = max(self._dearest_check, spent)
        self._ledger.check_seconds = max(self._ledger.check_seconds, spent)
        return executed

    def _is_cheapest(self, candidate: Candidate) -> bool:
        """Whether no motion that passed costs as little."""
        return self._chosen is None or price_of(candidate) < self._chosen.cost

    @property
    def _may_last_longer(self) -> bool:
        """Whether the task leaves it open how long the motion takes."""
        problem = self._best.problem
        if problem.longest is not None:
            return True
        return problem.objective == "time" and problem.searches_times

    def _search_again(
        self,
        certificate: Certificate,
        rng: np.random.Generator,
    ) -> Iterator[Executed]:
        """The motion slowed down a little, where time is free.

        Or found anew with limits tighter by what was broken. What is quick comes first: gradients
        from where the motion is; where they don't help, and time is left, CMA-ES.
        """
        best = self._best
        problem = best.problem
        ledger = self._ledger
        near = bool(certificate.too_near)
        if not near:
            yield from self._slow_down(SLOWER)
        ways: list[Planner] = [Evolution(step=0.01, most=MEND_EVALUATIONS)]
        if problem.grows and problem.free != "times":
            ways.insert(0, Sequential(starts=1, levels=0))
        for planner in ways:
            for turn in range(MENDS):
                is_first = turn == 0 and planner is ways[0]
                if ledger.remaining == 0 and not is_first:
                    return
                seconds = self._time
                if seconds <= 0.0:
                    return
                clearance = MORE_CLEARANCE * (turn + 1) * near
                first, more = SLACK
                slack = first + more * turn
                limits = tighter(problem.limits, certificate.shares, slack, clearance)
                changes = {"limits": limits, "radius": NEARBY, "label": "mended"}
                task = problem.with_initial(best.splines, **changes)
                share = Ledger(10**9, seconds)
                planner.run([task], share, rng)
                ledger.count(share.evaluations)
                mended = share.best
                if mended is None or not mended.feasible:
                    continue
                mended = with_limits(mended, problem.limits)
                if self._is_cheapest(mended):
                    yield self._check(mended)

    def _fit_to_step(self, controller: Controller, certificate: Certificate) -> Iterator[Executed]:
        """The motion slowed down on a controller's step; then searched anew on that."""
        yield from self._slow_down(MUCH_SLOWER)
        yield from self._search_on_step(controller, certificate)

    def _slow_down(self, factors: Sequence[float]) -> Iterator[Executed]:
        """The motion slowed down as little as keeps its limits, where time is free."""
        best = self._best
        problem = best.problem
        if not self._may_last_longer:
            return
        is_late = False
        for factor in factors:
            if is_late and factor != factors[-1]:
                continue
            splines = Splines(best.splines.points, best.splines.durations * factor)
            if not is_short_enough(problem, splines):
                return
            slower = problem.with_initial(splines)
            candidate = Candidate(slower, slower.initial, cost_of(slower, splines), 0.0)
            on_step = put_on_step(candidate, self._controller)
            if not keeps_limits(slower, on_step, self._controller):
                continue
            executed = self._check(candidate)
            yield executed
            if executed.allowed:
                return
            # Where the time is up, the slowest alone is left to be tried.
            is_late = self._time <= 0.0

    def _search_on_step(
        self,
        controller: Controller,
        certificate: Certificate,
    ) -> Iterator[Executed]:
        """The motion searched anew with its knots on the controller's step.

        Where time is free for longer and longer; each time with limits tighter by what all that was
        found before passed between the search's samples.
        """
        best = self._best
        timed = best.problem.objective == "time"
        total = float(best.splines.total[0])
        for longer in LONGER if self._may_last_longer else (1.0,):
            whole = controller.whole(total * longer)
            if timed and self._chosen is not None and whole >= self._chosen.cost:
                return
            moved = with_knots_on_step(best.splines, controller, whole)
            if longer > 1.0 and not is_short_enough(best.problem, moved):
                return
            seen = certificate.shares
            limits = best.problem.limits
            for turn in range(MENDS):
                if self._time <= 0.0:
                    return
                first, more = SLACK_ON_STEP
                slack = first + more * turn
                turns_left = MENDS - turn
                if turn > 0:
                    limits = tighter(limits, seen, slack)
                elif controller.points == "knots":
                    # The plan stays as it is, and what the controller's curve passed at one joint
                    # it will pass at any that comes to its limit.
                    limits = tighter(limits, seen, slack, alike=True)
                else:
                    turns_left = 1  # on other knots hardly more than rounding is left to mend
                mended = self._descend_on_step(moved, limits, self._time / turns_left)
                if mended is None:
                    break
                if timed:
                    mended = replace(mended, cost=whole)
                if not self._is_cheapest(mended):
                    break
                on_step = put_on_step(mended, controller)
                if not keeps_limits(best.problem, on_step, controller):
                    # A check in full takes longer, and would find that, too.
                    seen = limit_shares(best.problem, on_step, controller)
                    continue
                executed = self._check(mended)
                yield executed
                if executed.allowed:
                    return
                seen = executed.certificate.shares

    def _descend_on_step(self, moved: Splines, limits: Limits, seconds: float) -> Candidate | None:
        """The least energy on a motion's own knots; None where no motion there is allowed.

        Args:
            moved: The motion.
            limits: Those of the search: the task's, or tighter ones.
            seconds: Processor time that it may take [s].
        """
        problem = self._best.problem
        fixed = {"objective": "energy", "free": "vias", "label": "on the controller's step"}
        task = problem.with_initial(moved, radius=ON_STEP, limits=limits, **fixed)
        share = Ledger(10**9, seconds)
        descend_on_knots(task, share, ON_STEP_STEPS)
        self._ledger.count(share.evaluations)
        best = share.best
        if best is None or not best.feasible:
            return None
        return with_limits(best, problem.limits)
