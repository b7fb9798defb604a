"""A cycle as one task: motions between stops, a load gripped and released, one duration for all.

The arm rests at every stop, so that all that binds the motions together is the duration of the
whole:

    min Σ E_k(T_k)   with   Σ T_k = T − Σ dwell

with E_k the least energy of motion k over its duration. Those curves are found as for a single free
duration, the durations are shared out on them, and each motion is then searched in full at its own.
While that pays and time is left, curves about what was found share the durations out anew.
With time as the objective every motion is as short as it can be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq, minimize

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.progress import stage
from plan.command_options import SolveOptions
from plan.planners.base import Candidate, Ledger, budget_seconds
from plan.problem.cost import energy_cost
from plan.problem.cycle_result import CycleResult, Leg
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.task_file import Task
from plan.solving.cycle_legs import leg_tasks, moving_time
from plan.solving.free_duration import Look, apart, energy_curve, lasting, look_at
from plan.solving.obstruction import require_valid_ends, shortest_duration
from plan.solving.set_up import reach_goals, set_up
from plan.solving.solve import LEAST_SECONDS, search_and_certify

# Slower paces at which the torque is looked at, as shares of the plan's own, and places of a
# section.
PACES = np.linspace(0.05, 1.0, 20)
PLACES = np.linspace(0.0, 1.0, 41)
# A sum of durations that is longer than allowed by this is as long as allowed.
ROUNDED = 1.0 + 1e-6
# Durations that differ by less than this share are one: between them a curve would have any slope.
APART = 0.005
# Times that a motion is planned anew where it needs more torque when slowed down, and how much
# lower it then aims.
TURNS = 3
LOWER = 1.002
# Share of the time in which energy is looked up over the durations.
LOOKED = 0.25
# Share of the time left in which the motions are searched in full; the rest is for looks at other
# durations from what was found.
PLANNED = 0.75
# Those durations, as multiples of a motion's own.
LONGER = (1.15, 1.3, 1.6)
SHORTER = (0.87, 0.75, 0.6)
# So many checks of each motion another round takes at the least, and what the looks may take of the
# time left beyond that.
CHECKS = 2
AGAIN = 0.5
# What brings no more than this share of the cost is not worth another round.
HARDLY = 0.002


@dataclass(frozen=True, eq=False)
class Shared:
    """How the duration of a cycle is shared among its motions."""

    durations: Float[Array, " m"]  # of each motion [s]
    # Of all of them, on the curves [J]; None where no motion as short as needed was looked at.
    energy: float | None
    even: float | None  # the same where each takes the same multiple of its shortest duration [J]


def split_cycle(
    task: Task,
    model: HybridModel | None,
    options: SolveOptions,
) -> tuple[PlanningProblem, ...]:
    """The cycle's motions in turn, each with what the arm carries on it.

    Raises:
        InputError: The file has no stops, or a motion's ends are at fault.
    """
    problems = []
    for leg in leg_tasks(task, options.objective):
        if np.array_equal(leg.start, leg.goal):
            continue
        problem = reach_goals(set_up(leg, model, options), leg)[0]
        require_valid_ends(problem, leg, options.inside)
        problems.append(problem)
    if not problems:
        raise InputError(task.source, "all its stops are at one place", "give [[leg]] other angles")
    return tuple(problems)


def solve_cycle(
    task: Task,
    problems: Sequence[PlanningProblem],
    options: SolveOptions,
    spent: float = 0.0,
) -> CycleResult:
    """Plans all motions of a cycle; an expected failure is a status with a reason.

    Args:
        task: What the file says.
        problems: Its motions, by `split_cycle`.
        options: How; the budget is shared by the motions.
        spent: Processor time that was spent on the task before, of the seconds that it may take
            [s].
    """
    most, seconds = options.budget
    budget = Ledger(most, max(seconds - spent, 0.0))
    if options.objective == "time":
        legs = []
        for number, problem in enumerate(problems):
            share = _share_of_budget(options, budget, problems, len(problems) - number)
            legs.append(_plan(problem, share, None))
        return CycleResult.of(task, problems[0], legs, None, None)
    free = moving_time(task, options.objective)
    assert free is not None
    needs = np.array([shortest_duration(problem) for problem in problems])
    if needs.sum() > free:
        reason = f"{free:g} s are too short: the motions take {needs.sum():.3f} s at the least"
        return CycleResult.of(task, problems[0], [], None, None, reason)
    curves = []
    looked = Ledger(most, LOOKED * budget.seconds_left)
    share = _share_of_budget(options, looked, problems, len(problems))
    for number, problem in enumerate(problems, start=1):
        stage(
            f"energy over duration, motion {number} of {len(problems)}",
            *_share_of_work(number, problems, 0.0),
        )
        curves.append(energy_curve(problem, share, 1.0))
    for number, curve in enumerate(curves, start=1):
        if not any(np.isfinite(look.energy) for look in curve):
            reason = f"no motion found for leg {number}"
            return CycleResult.of(task, problems[0], [], None, None, reason)
    shared = share_duration(curves, needs, free, task)
    legs = _plan_all(problems, shared, curves, options, budget)
    cycle = CycleResult.of(task, problems[0], legs, shared.energy, shared.even)
    while cycle.solved:
        spare = budget.seconds_left - CHECKS * sum(leg.check_seconds for leg in cycle.legs)
        if spare <= 0.0 or budget.remaining == 0:
            break
        looked = Ledger(most, AGAIN * spare)
        curves = [_curve_about(*pair, looked) for pair in zip(problems, cycle.legs, strict=True)]
        shared = share_duration(curves, needs, free, task)
        if not _promises_more(shared, cycle):
            break
        legs = _plan_all(problems, shared, curves, options, budget)
        anew = CycleResult.of(task, problems[0], legs, shared.energy, shared.even)
        if not anew.energy < cycle.energy * (1.0 - HARDLY):
            break
        cycle = anew
    return cycle


def _share_of_budget(
    options: SolveOptions,
    budget: Ledger,
    problems: Sequence[PlanningProblem],
    left: int,
) -> SolveOptions:
    """How one motion is planned, of so many that are left to be planned."""
    seconds = max(budget.seconds_left, LEAST_SECONDS) / left
    evaluations = max(budget.most // len(problems), 1)
    return replace(options, evaluations=evaluations, seconds=seconds, gap=False)


def _plan_all(
    problems: Sequence[PlanningProblem],
    shared: Shared,
    curves: Sequence[Sequence[Look]],
    options: SolveOptions,
    budget: Ledger,
) -> list[Leg]:
    """Every motion searched in full at its own duration, in all but a part of the time left.

    That part is for sharing out the durations anew on what was found.
    """
    planned = Ledger(budget.most, PLANNED * budget.seconds_left)
    legs = []
    parts = zip(problems, curves, shared.durations, strict=True)
    for number, (problem, curve, duration) in enumerate(parts, start=1):
        stage(
            f"searching for motion {number} of {len(problems)}",
            *_share_of_work(number, problems, 0.5),
        )
        share = _share_of_budget(options, planned, problems, len(problems) - number + 1)
        legs.append(_plan(lasting(problem, float(duration)), share, curve))
    return legs


def _curve_about(problem: PlanningProblem, leg: Leg, budget: Ledger) -> list[Look]:
    """Least energy over duration about a motion that was searched in full.

    The curve of the first look is of a short search: that of the motion itself may lie well below,
    and not by the same share for every motion.
    """
    splines = leg.plan.splines
    assert splines is not None
    duration = float(splines.total[0])
    carrier = lasting(problem, duration).with_initial(splines, free="vias", label="planned")
    cost = float(carrier.initial_evaluation.cost[0])
    looks = [Look(duration, cost, Candidate(carrier, carrier.initial, cost, 0.0))]
    shortest = shortest_duration(problem)
    for factors in (LONGER, SHORTER):
        near = looks[0]
        for factor in factors:
            if budget.remaining == 0 or duration * factor <= shortest:
                break
            look = look_at(problem, duration * factor, near, budget)
            if look.candidate is None:
                break
            looks.append(look)
            near = look
    return looks


def _promises_more(shared: Shared, cycle: CycleResult) -> bool:
    """Whether durations that were shared out anew cost less than the cycle as it is."""
    if shared.energy is None:
        return False
    dwelling = cycle.dwelling + float(shared.durations.sum())
    cost = energy_cost(shared.energy, dwelling, cycle.standby)
    return cost < cycle.energy * (1.0 - HARDLY)


def _share_of_work(
    number: int,
    problems: Sequence[PlanningProblem],
    begin: float,
) -> tuple[float, float]:
    """Shares of all work that are done before and after a motion's turn."""
    each = 0.5 / len(problems)
    return begin + each * (number - 1), begin + each * number


def share_duration(
    curves: Sequence[Sequence[Look]],
    needs: Float[Array, " m"],
    free: float,
    task: Task,
) -> Shared:
    """The durations of least energy together, standby counted where the whole may be shorter.

    Args:
        curves: Least energy over duration of each motion.
        needs: Shortest duration of each motion [s].
        free: How long they may take together [s].
        task: Whether that is how long they must take, and what the cell takes meanwhile.
    """
    tables = [_distinct(curve) for curve in curves]
    low = np.array([times[0] for times, _ in tables])
    high = np.array([times[-1] for times, _ in tables])
    splines = [_interpolate(times, energies) for times, energies in tables]
    standby = task.standby if task.duration is None else 0.0

    def cost(durations: Array) -> float:
        """Energy of all motions, and of the cell [J]."""
        moved = sum(spline(t) for spline, t in zip(splines, durations, strict=True))
        return float(energy_cost(moved, durations.sum(), standby))

    if low.sum() > free:  # what is known is longer throughout: nothing to weigh
        return Shared(needs * (free / needs.sum()), None, None)
    even = _same_multiple(needs, low, high, free)
    kind = "eq" if task.duration is not None and high.sum() >= free else "ineq"
    rule = {"type": kind, "fun": lambda durations: free - durations.sum()}
    bounds = list(zip(low, high, strict=True))
    best = even
    spare = (free - low.sum()) / max(high.sum() - low.sum(), 1e-9)
    stretched = low + (high - low) * min(spare, 1.0)
    for begin in (even, stretched):
        solution = minimize(cost, begin, method="SLSQP", bounds=bounds, constraints=[rule])
        durations = np.clip(solution.x, low, high)
        if durations.sum() <= free * ROUNDED and cost(durations) < cost(best):
            best = durations
    weighed = cost(best) - standby * float(best.sum())
    of_even = cost(even) - standby * float(even.sum())
    if task.duration is not None or best.sum() > free:
        best = best * (free / best.sum())
    return Shared(best, weighed, of_even)


def _same_multiple(
    needs: Float[Array, " m"],
    low: Float[Array, " m"],
    high: Float[Array, " m"],
    free: float,
) -> Float[Array, " m"]:
    """Each motion's shortest duration times one number, within what is known, filling the time."""
    top = float((high / needs).max())
    longest = np.clip(top * needs, low, high)
    if longest.sum() <= free:
        return longest

    def beyond(multiple: float) -> float:
        """How much longer than the time all motions take [s]."""
        return float(np.clip(multiple * needs, low, high).sum()) - free

    return np.clip(brentq(beyond, 0.0, top) * needs, low, high)


def _distinct(curve: Sequence[Look]) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
    """Durations that are apart, and the energy of each; of two that are the same the lower one."""
    times: list[float] = []
    energies: list[float] = []
    for look in sorted(curve, key=lambda look: look.duration):
        if not np.isfinite(look.energy):
            continue
        if times and look.duration < times[-1] * (1.0 + APART):
            energies[-1] = min(energies[-1], look.energy)
            continue
        times.append(look.duration)
        energies.append(look.energy)
    return np.array(times), np.array(energies)


def _interpolate(times: Float[Array, " k"], energies: Float[Array, " k"]) -> PchipInterpolator:
    """Energy between the durations that were looked at, monotone where they are."""
    if len(times) == 1:
        times = np.array([times[0], times[0] * (1.0 + 1e-6)])
        energies = np.repeat(energies, 2)
    return PchipInterpolator(times, energies)


def _plan(problem: PlanningProblem, options: SolveOptions, curve: Sequence[Look] | None) -> Leg:
    """One motion, planned until it stays within its torque at any slower pace."""
    began = budget_seconds()
    duration = float(problem.durations.sum())
    known = None
    if curve is not None:
        nearest = min(curve, key=lambda look: apart(look, duration))
        if nearest.candidate is not None:
            ledger = Ledger(10**6, options.budget[1] / 4.0)
            known = look_at(problem, duration, nearest, ledger).candidate
    # Its duration is the cycle's to choose.
    task = replace(problem, longest=None, standby=0.0)
    for _ in range(TURNS):
        used = budget_seconds() - began
        result, ledger = search_and_certify(task, options, known=known, spent=used)
        share = slowed_torque_share(problem, result)
        if share is None or share <= 1.0:
            break
        lower = task.limits.torque / (share * LOWER)
        task = replace(task, limits=replace(task.limits, torque=lower))
        known = None
    return Leg(result, share, ledger.check_seconds)


def slowed_torque_share(problem: PlanningProblem, result: PlanResult) -> float | None:
    """Largest torque as a share of its limit at a plan's own and any slower pace.

    None without a plan.

    At a share r of the pace the speed is r and the acceleration r² of what it was: less push, but
    no less weight.
    """
    splines = result.splines
    if splines is None or not result.solved:
        return None
    q, dq, ddq = splines.states(PLACES)
    worst = 0.0
    for pace in PACES:
        tau = problem.model.torque(q, pace * dq, pace**2 * ddq)
        worst = max(worst, float((np.abs(tau) / problem.limits.torque).max()))
    return worst
