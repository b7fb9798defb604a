"""Least energy where the duration is free: up to a longest one, or with what the cell takes while
it waits.

The cost of a duration T is E(T) + P T, with E the least energy of a motion of that duration and P
the standby power. E is found on a grid of durations, each motion searched from its neighbour's, and
then closer about the least cost; the motion of the best duration is searched in full.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from plan.command_options import SolveOptions
from plan.planners.base import Candidate, Ledger, Planner, budget_seconds
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.controllers import Controller
from plan.problem.cost import energy_cost
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.obstruction import find_obstruction, shortest_duration
from plan.solving.solve import search_and_certify
from plan.spline import Splines

# Durations of the first look, and how much longer than the shortest it begins.
LOOKS = 9
BEGIN = 1.02
# Looks about the best duration, which end where its neighbours are nearer than this ratio.
CLOSER = 5
NEAR = 1.01
# Search of the first motion, and share of the seconds that it and all looks may take.
FIRST = Sequential(starts=4, kept=(2, 1), levels=1)
SHARE = 0.4
# A look may take so many times its even share of the time that is left.
FAIR = 2.0
# The first duration of all where the cell takes power, at most, as a multiple of the shortest.
HASTE = 2.0
# Steps of each look.
STEPS = 40
# Share of the seconds left that the first search in full takes, and of what it leaves the looks
# about the motion that it found; these go so far, as factors of its duration. A second search
# follows where they found this share less.
FIRST_SEARCH = 0.6
LOOKED_ABOUT = 0.5
ABOUT = (0.8, 0.9, 1.1, 1.25)
WORTH = 0.001
# A motion that takes longer than looked at by more than this share was slowed down in mending.
MENDED = 0.005
# Durations that differ by less than this share are the same.
ROUNDING = 1e-9
# The longest duration where nothing else bounds it, as a multiple of the shortest.
LONGEST = 20.0


@dataclass(frozen=True)
class Look:
    """The least energy that was found for one duration."""

    duration: float  # [s]
    energy: float  # [J]; infinite where no motion was found
    candidate: Candidate | None  # that motion

    def cost(self, standby: float) -> float:
        """Energy with what the cell takes meanwhile [J]."""
        return energy_cost(self.energy, self.duration, standby)


def lasting(problem: PlanningProblem, duration: float) -> PlanningProblem:
    """The problem with its sections' durations scaled to another sum [s]."""
    whole = float(problem.durations.sum())
    return replace(problem, durations=problem.durations * (duration / whole))


def solve_free_duration(
    problem: PlanningProblem,
    options: SolveOptions,
    planner: Planner | None = None,
    controller: Controller | None = None,
    spent: float = 0.0,
) -> PlanResult:
    """The motion of least energy, standby power counted, of any duration up to the task's longest.

    Args:
        problem: The task, its longest duration given; its own duration is a first guess.
        options, planner, controller, spent: As for `solve`.
    """
    began = budget_seconds()
    standby = problem.standby
    curve = energy_curve(problem, options, spent=spent)
    best = min(curve, key=lambda look: look.cost(standby), default=None)
    if best is None or best.candidate is None:
        best = Look(float(problem.durations.sum()), np.inf, None)

    def search(look: Look, share: float) -> Searched:
        """The motion of one duration, in a share of what is left of seconds that were asked for."""
        used = spent + budget_seconds() - began
        asked = options
        if options.seconds is not None:
            left = max(options.seconds - used, 0.0)
            asked = replace(options, seconds=used + share * left)
        task = lasting(problem, look.duration)
        result, ledger = search_and_certify(
            task, asked, planner, controller=controller, spent=used, known=look.candidate
        )
        return Searched(look, result.with_standby(standby), ledger.best)

    searched = search(best, FIRST_SEARCH if curve else 1.0)
    if searched.result.solved and curve:
        seconds = options.budget[1] - (spent + budget_seconds() - began)
        nearby = look_about(problem, searched, Ledger(options.budget[0], LOOKED_ABOUT * seconds))
        curve += nearby
        best = min(nearby, key=lambda look: look.cost(standby))
        if best.cost(standby) < searched.result.cost * (1.0 - WORTH):
            searched = searched.or_cheaper(search(best, 1.0))
    return _tell(searched, curve)


@dataclass(frozen=True, eq=False)
class Searched:
    """A motion that was searched in full."""

    look: Look  # the duration that was asked for, and what was known of it
    result: PlanResult
    motion: Candidate | None  # before it was put on a controller's step

    def or_cheaper(self, other: Searched) -> Searched:
        """The cheaper of two searches, with what both took."""
        evaluations = self.result.evaluations
        seconds = self.result.cpu_seconds
        cheaper = self
        history = list(self.result.history)
        if other.result.cost < self.result.cost:
            cheaper = other
            before = history[-1][2]
            for count, spent, cost in other.result.history:
                if cost < before:
                    history.append((evaluations + count, seconds + spent, cost))
        result = replace(
            cheaper.result,
            history=tuple(history),
            evaluations=evaluations + other.result.evaluations,
            seconds=self.result.seconds + other.result.seconds,
            cpu_seconds=seconds + other.result.cpu_seconds,
        )
        return replace(cheaper, result=result)


def _tell(searched: Searched, curve: Sequence[Look]) -> PlanResult:
    """A plan of free duration with the energies that were looked at.

    Args:
        searched: The plan.
        curve: All looks, several of one duration perhaps.
    """
    result = searched.result
    rows: dict[float, float] = {}
    for look in curve:
        if np.isfinite(look.energy):
            duration = _looked_at(rows, look.duration)
            rows[duration] = min(look.energy, rows.get(duration, np.inf))
    planned = searched.look.duration
    said = f"the duration is free: {planned:.3g} s costs least of {len(rows)} looked at"
    if result.solved and result.splines is not None:
        duration = _looked_at(rows, float(result.splines.total[0]))
        rows[duration] = result.cost - result.standby * duration
        if duration > planned * (1.0 + MENDED):
            said += f"; {duration:.3g} s are taken to keep the limits as it is executed"
    notes = (said, *result.notes) if rows else result.notes
    return replace(result, bound=None, notes=notes, energy_curve=tuple(sorted(rows.items())))


def _looked_at(durations: Iterable[float], duration: float) -> float:
    """Of some durations the one that is this but for rounding; else this [s]."""
    for other in durations:
        if abs(other - duration) <= ROUNDING * duration:
            return other
    return duration


def energy_curve(
    problem: PlanningProblem, options: SolveOptions, share: float = SHARE, spent: float = 0.0
) -> list[Look]:
    """Least energy over duration, the shortest first; empty where no motion was found.

    Args:
        problem: The task, its longest duration given.
        options: How.
        share: The share of their seconds that are left that it may take.
        spent: Processor time that was spent on the task before, of these seconds [s].
    """
    assert problem.longest is not None
    shortest = BEGIN * shortest_duration(problem)
    longest = min(problem.longest, LONGEST * shortest)
    if shortest <= 0.0 or longest < shortest or find_obstruction(lasting(problem, longest)):
        return []
    evaluations, most_seconds = options.budget
    seconds = share * max(most_seconds - spent, 0.0)
    rng = np.random.default_rng(options.seed)
    ledger = Ledger(evaluations, seconds)
    middle = float(np.sqrt(shortest * longest))
    first = None
    starts = [middle, longest]
    if problem.standby > 0.0:
        # What the cell takes makes haste, and where the task allows much the middle is far off.
        starts.insert(0, min(middle, HASTE * shortest))
    for duration in starts:
        half = Ledger(evaluations, 0.5 * seconds)
        first = FIRST.run([lasting(problem, duration)], half, rng).best
        if first is not None and first.feasible:
            break
    if first is None or not first.feasible:
        return []
    looks = [Look(float(first.splines.total[0]), first.cost, first)]
    grid = np.geomspace(shortest, longest, LOOKS).tolist()
    return _explore(problem, looks, grid, ledger)


def look_about(problem: PlanningProblem, searched: Searched, ledger: Ledger) -> list[Look]:
    """Durations about that of a motion, looked at from that: another way's least lies elsewhere.

    Args:
        problem: The task.
        searched: The motion.
        ledger: What may be spent.

    Returns:
        The motion itself, and what was looked at.
    """
    motion = searched.motion
    assert motion is not None
    assert problem.longest is not None
    look = Look(float(motion.splines.total[0]), motion.cost, motion)
    shortest = BEGIN * shortest_duration(problem)
    durations = np.clip(look.duration * np.array(ABOUT), shortest, problem.longest)
    return _explore(problem, [look], np.unique(durations).tolist(), ledger)


def _explore(
    problem: PlanningProblem, looks: list[Look], durations: Sequence[float], ledger: Ledger
) -> list[Look]:
    """Looks at durations, those near the cheapest first, and then closer about that.

    Args:
        problem: The task.
        looks: The first of them, with its motion.
        durations: What is to be looked at [s].
        ledger: What may be spent.
    """
    left = [duration for duration in durations if apart(looks[0], duration) > ROUNDING]
    duration = min(left, key=partial(apart, looks[0]), default=0.0)
    if problem.standby == 0.0:
        # A motion can be drawn out at once, and the longest mostly costs least.
        duration = max(left, default=0.0)
    while left and ledger.remaining > 0:
        left.remove(duration)
        nearest = min(looks, key=lambda look: apart(look, duration))
        share = FAIR / (len(left) + 1 + CLOSER)
        looks.append(look_at(problem, duration, nearest, ledger, share))
        best = min(looks, key=lambda look: look.cost(problem.standby))
        duration = min(left, key=lambda other: apart(best, other), default=duration)
    for number in range(CLOSER):
        looks.sort(key=lambda look: look.duration)
        place = _closer(looks, problem.standby)
        if place is None or ledger.remaining == 0:
            break
        nearest = min(looks, key=lambda look: apart(look, place))
        looks.append(look_at(problem, place, nearest, ledger, FAIR / (CLOSER - number)))
    return sorted(looks, key=lambda look: look.duration)


def apart(look: Look, duration: float) -> float:
    """How far a motion is from a duration, as a ratio; infinite where there is none."""
    return np.inf if look.candidate is None else abs(float(np.log(look.duration / duration)))


def look_at(
    problem: PlanningProblem, duration: float, near: Look, ledger: Ledger, share: float = 0.5
) -> Look:
    """The least energy of a duration, searched from another duration's motion.

    Args:
        problem: The task.
        duration: In question [s].
        near: A look at another duration that found a motion.
        ledger: Evaluations count there.
        share: Of its time that is left, what may be used; half of it at most.

    Returns:
        A look of infinite cost and without a motion where none was found.
    """
    assert near.candidate is not None
    splines = near.candidate.splines
    moved = Splines(splines.points, splines.durations * (duration / near.duration))
    task = lasting(problem, duration).with_initial(moved, free="vias", label="another duration's")
    given = Ledger(10**9, min(share, 0.5) * max(ledger.seconds_left, 0.0))
    descend_on_knots(task, given, STEPS)
    ledger.count(given.evaluations)
    best = given.best
    if best is None or not best.feasible:
        return Look(duration, np.inf, None)
    return Look(duration, best.cost, best)


def _closer(looks: list[Look], standby: float) -> float | None:
    """The next duration to look at: the middle of the wider gap beside the best; None where the
    ends are near [s].
    """
    costs = [look.cost(standby) for look in looks]
    best = int(np.argmin(costs))
    gaps = []
    for first in (best - 1, best):
        if first >= 0 and first + 1 < len(looks):
            low = looks[first].duration
            high = looks[first + 1].duration
            gaps.append((high / low, low, high))
    if not gaps:
        return None
    ratio, low, high = max(gaps)
    return float(np.sqrt(low * high)) if ratio > NEAR else None
