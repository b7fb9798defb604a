"""Least energy where the duration is free: up to a longest one, or with what the cell takes while
it waits.

The cost of a duration T is E(T) + P T, with E the least energy of a motion of that duration and P
the standby power. E is found on a grid of durations, each motion searched from its neighbour's, and
then closer about the least cost; the motion of the best duration is searched in full.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from plan.command_options import SolveOptions
from plan.planners.base import Candidate, Ledger, Planner, budget_seconds
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.controllers import Controller
from plan.problem.cost import energy_cost
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.obstruction import find_obstruction, shortest_duration
from plan.solving.solve import solve
from plan.spline import Splines

# Durations of the first look, and how much longer than the shortest it begins.
LOOKS = 9
BEGIN = 1.02
# Looks about the best duration, which end where its neighbours are nearer than this ratio.
CLOSER = 5
NEAR = 1.01
# Search of the first motion, and share of the seconds that it and all looks may take.
FIRST = Sequential(starts=4, kept=(2, 1), levels=1)
SHARE = 0.5
# A look may take so many times its even share of the time that is left.
FAIR = 2.0
# Steps of each look.
STEPS = 40
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
    used = spent + budget_seconds() - began
    result = solve(
        lasting(problem, best.duration),
        options,
        planner,
        controller=controller,
        spent=used,
        known=best.candidate,
    )
    rows = {look.duration: look.energy for look in curve if np.isfinite(look.energy)}
    history = []
    for count, seconds, energy in result.history:
        history.append((count, seconds, energy_cost(energy, best.duration, standby)))
    said = f"the duration is free: {best.duration:.3g} s costs least of {len(rows)} looked at"
    result = replace(result, standby=standby, bound=None)
    if result.solved and result.splines is not None:
        duration = _looked_at(rows, float(result.splines.total[0]))
        rows[duration] = result.cost - standby * duration
        history[-1] = (*history[-1][:2], result.cost)
        if duration > best.duration * (1.0 + MENDED):
            said += f"; {duration:.3g} s are taken to keep the limits as it is executed"
    notes = (said, *result.notes) if rows else result.notes
    return replace(
        result, history=tuple(history), notes=notes, energy_curve=tuple(sorted(rows.items()))
    )


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
    for duration in (middle, longest):
        half = Ledger(evaluations, 0.5 * seconds)
        first = FIRST.run([lasting(problem, duration)], half, rng).best
        if first is not None and first.feasible:
            break
    if first is None or not first.feasible:
        return []
    looks = [Look(float(first.splines.total[0]), first.cost, first)]
    grid = np.geomspace(shortest, longest, LOOKS)
    left = [float(duration) for duration in grid if apart(looks[0], float(duration)) > 1e-9]
    # A motion can be drawn out at once, and without standby the longest mostly costs least.
    duration = left[-1] if left else middle
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
    own = Ledger(10**9, min(share, 0.5) * max(ledger.seconds_left, 0.0))
    descend_on_knots(task, own, STEPS)
    ledger.count(own.evaluations)
    best = own.best
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
