"""Least energy where the duration is free: up to a longest one, or with what the cell takes while
it waits.

The cost of a duration T is E(T) + P T, with E the least energy of a motion of that duration and P
the standby power. E is found on a grid of durations, each motion searched from its neighbour's, and
then closer about the least cost; the motion of the best duration is searched in full.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plan.command_options import SolveOptions
from plan.planners.base import Candidate, Ledger, Planner, processor_seconds
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.controllers import Controller
from plan.problem.cost import energy_cost
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.obstruction import find_obstruction, shortest_duration
from plan.solving.solve import solve
from plan.spline import Splines

# Durations of the first look, how much longer than the shortest it begins, and looks about the best
# one.
LOOKS, BEGIN, CLOSER = 9, 1.02, 5
# Search of the first motion, and share of the seconds that it and all looks may take.
FIRST, SHARE = Sequential(starts=4, kept=(2, 1), levels=1), 0.5
# Steps of each look, and the longest duration where nothing else bounds it, as a multiple of the
# shortest.
STEPS, LONGEST = 40, 20.0


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
    """The same task with another duration [s]."""
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
    began, standby = processor_seconds(), problem.standby
    curve = energy_curve(problem, options)
    best = min(curve, key=lambda look: look.cost(standby), default=None)
    if best is None or best.candidate is None:
        best = Look(float(problem.durations.sum()), np.inf, None)
    used = spent + processor_seconds() - began
    result = solve(
        lasting(problem, best.duration),
        options,
        planner,
        controller=controller,
        spent=used,
        known=best.candidate,
    )
    rows = tuple((look.duration, look.energy) for look in curve if np.isfinite(look.energy))
    history = []
    for count, seconds, energy in result.history:
        history.append((count, seconds, energy_cost(energy, best.duration, standby)))
    said = f"the duration is free: {best.duration:.3g} s costs least of {len(rows)} looked at"
    notes = (said, *result.notes) if rows else result.notes
    return replace(
        result, standby=standby, energy_curve=rows, history=tuple(history), bound=None, notes=notes
    )


def energy_curve(
    problem: PlanningProblem, options: SolveOptions, part: float = SHARE
) -> list[Look]:
    """Least energy over duration, the shortest first; empty where no motion was found.

    Args:
        problem: The task, its longest duration given.
        options: How.
        part: The share of their seconds that it may take.
    """
    assert problem.longest is not None
    shortest = BEGIN * shortest_duration(problem)
    longest = min(problem.longest, LONGEST * shortest)
    if shortest <= 0.0 or longest < shortest or find_obstruction(lasting(problem, longest)):
        return []
    seconds = part * options.budget[1]
    rng, ledger = np.random.default_rng(options.seed), Ledger(options.budget[0], seconds)
    middle = float(np.sqrt(shortest * longest))
    first = None
    for duration in (middle, longest):
        share = Ledger(options.budget[0], 0.5 * seconds)
        first = FIRST.run([lasting(problem, duration)], share, rng).best
        if first is not None and first.feasible:
            break
    if first is None or not first.feasible:
        return []
    looks = [Look(float(first.splines.total[0]), first.cost, first)]
    grid = np.geomspace(shortest, longest, LOOKS)
    middle = looks[0].duration
    # A motion can be drawn out at once, and the longest mostly costs least; quicker ones need their
    # neighbour's.
    for duration in (*grid[grid > middle][::-1], *grid[grid < middle][::-1]):
        if ledger.remaining == 0:
            break
        nearest = min(looks, key=lambda look: apart(look, duration))
        looks.append(look_at(problem, float(duration), nearest, ledger))
    for _ in range(CLOSER):
        looks.sort(key=lambda look: look.duration)
        place = _closer(looks, problem.standby)
        if place is None or ledger.remaining == 0:
            break
        nearest = min(looks, key=lambda look: apart(look, place))
        looks.append(look_at(problem, place, nearest, ledger))
    return sorted(looks, key=lambda look: look.duration)


def apart(look: Look, duration: float) -> float:
    """How far a motion is from a duration, as a ratio; infinite where there is none."""
    return np.inf if look.candidate is None else abs(float(np.log(look.duration / duration)))


def look_at(problem: PlanningProblem, duration: float, near: Look, ledger: Ledger) -> Look:
    """The least energy of a duration, searched from another duration's motion."""
    assert near.candidate is not None
    splines = near.candidate.splines
    moved = Splines(splines.points, splines.durations * (duration / near.duration))
    task = lasting(problem, duration).with_initial(moved, free="vias", label="another duration's")
    share = Ledger(10**9, max(ledger.seconds_left, 0.0) / 2.0)
    descend_on_knots(task, share, STEPS)
    ledger.count(share.evaluations)
    best = share.best
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
    for a, b in ((best - 1, best), (best, best + 1)):
        if a >= 0 and b < len(looks):
            gaps.append(
                (looks[b].duration / looks[a].duration, looks[a].duration, looks[b].duration)
            )
    if not gaps:
        return None
    ratio, low, high = max(gaps)
    return float(np.sqrt(low * high)) if ratio > 1.01 else None
