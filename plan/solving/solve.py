"""One task, one method, one certified plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypedDict

import numpy as np

from plan.command_options import DEFAULT_METHOD, USUAL_BUDGET, SolveOptions
from plan.initial.trees import Seed, find_seeds
from plan.initial.vias import from_seeds
from plan.planners.base import Candidate, Ledger, Planner, make_planner
from plan.planners.evolution import Evolution, start_compressed
from plan.planners.sequential import Sequential
from plan.problem.certificate import Certificate, certify, certify_standing
from plan.problem.controllers import Controller
from plan.problem.cost import plan_cost
from plan.problem.problem import STRAIGHT, PlanningProblem
from plan.problem.result import PlanResult, StartRecord, Status
from plan.solving.bound import least_energy, least_time
from plan.solving.mending import KEPT_BACK, certify_best, measure_check, share_kept_back
from plan.solving.obstruction import find_obstruction
from plan.solving.workers import search_together
from plan.spline import Splines

# Evaluations for each start of the energy search from whose result time is shortened.
ENERGY_FIRST = 600
# Longest run of the default method that is only there to tell the gap, in processor time [s].
GAP_SECONDS = 60.0
# Longest search for initial trajectories where no budget says less, and its share of a budget [s].
STARTS_SECONDS = 60.0
STARTS_SHARE = 0.5
# Ways that a time search starts from: the best of what the energy search reached; one where the
# path stays.
MOST_TIME_STARTS = 3
# The least that a search is given, whatever was asked for [s].
LEAST_SECONDS = 0.1
USUAL = SolveOptions()
# What is tried for each goal before one is chosen, and how long in processor time [s].
QUICK = Sequential(starts=2, first=18, kept=(1,), levels=0)
QUICK_SECONDS = 3.0

Starts = tuple[Sequence[PlanningProblem], Sequence[Seed]]
"""A task from each of its initial trajectories, the straight line or the taught way first; and the
ways round obstacles that were looked for, with why some were not found."""


class Verdict(TypedDict):
    """How a search ended."""

    status: Status
    reason: str  # "" where it is solved


def find_starts(
    problem: PlanningProblem, rng: np.random.Generator, seconds: float = STARTS_SECONDS
) -> Starts:
    """Initial trajectories: the taught one alone where one is given; else the line, and seeds round
    what is in its way.

    For the time objective they are brought to their energy optima first, as in section 3.3 of the
    paper, and then drawn together in time by one factor: what the time compression of the paper's
    baseline gives for nothing.

    Args:
        problem: The task, started from the straight line, or from the taught way.
        rng: Source of randomness.
        seconds: What may be spent: half on the ways round obstacles, half on energy optima [s].
    """
    timed = problem.objective == "time"
    base = problem
    if timed:
        base = replace(problem, objective="energy", free="vias")
    seeds: list[Seed] = []
    if base.label == STRAIGHT and _may_hit(base):
        seeds = find_seeds(base, rng, seconds=seconds / 2)
    problems = from_seeds(base, seeds)
    if timed:
        return _time_starts(problem, problems, rng, seconds / 2), seeds
    return problems, seeds


def _may_hit(problem: PlanningProblem) -> bool:
    """Whether there are obstacles, or the initial trajectory collides."""
    return bool(problem.scene.obstacles) or problem.initial_evaluation.collision[0] > 0


def _time_starts(
    problem: PlanningProblem,
    problems: Sequence[PlanningProblem],
    rng: np.random.Generator,
    seconds: float,
) -> list[PlanningProblem]:
    """Starts of a search for time: energy optima, drawn together in time.

    Args:
        problem: The task.
        problems: The same for energy, from each of its initial trajectories.
        rng: Source of randomness.
        seconds: What the search for energy optima may take [s].
    """
    ledger = Ledger(10**9, seconds)
    Evolution(most=ENERGY_FIRST * len(problems)).run(problems, ledger, rng)
    if not ledger.best_of:  # no time was left
        return [replace(problems[0], objective="time", free=problem.free)]
    ranked = sorted(
        ledger.best_of.values(), key=lambda best: (not best.feasible, best.violation, best.cost)
    )
    starts = []
    for best in ranked[: 1 if problem.free == "times" else MOST_TIME_STARTS]:
        timed = best.problem.with_initial(best.splines, objective="time", free=problem.free)
        starts.append(start_compressed(timed))
    return starts


def cheapest_goal(
    problems: Sequence[PlanningProblem], posed: bool, budget: tuple[int, float], seed: int
) -> tuple[PlanningProblem, tuple[str, ...]]:
    """The problem with the goal that is the cheapest to go to by a short search each; what was
    chosen from, in words.

    Args:
        problems: One for each goal, the nearest first.
        posed: Whether the goal is a pose.
        budget: Evaluations and seconds of the whole planning task; a third of it at most is spent
            here.
        seed: Of all chance.
    """
    if len(problems) == 1:
        note = "one joint position brings the frame to the goal's pose"
        return problems[0], (note,) if posed else ()
    rng = np.random.default_rng(seed)
    most, seconds = budget
    costs = []
    for problem in problems:
        each = max(1, most // (3 * len(problems)))
        ledger = Ledger(each, min(QUICK_SECONDS, seconds / (3.0 * len(problems))))
        best = QUICK.run([problem], ledger, rng).best
        reached = best is not None and best.feasible
        costs.append(best.cost if best is not None and reached else np.inf)
    goals = f"{len(problems)} goals"
    if posed:
        goals = f"{len(problems)} joint positions bring the frame to the goal's pose"
    count = int(np.isfinite(costs).sum())
    taken = "reached none of them, and the nearest was taken"
    if count:
        taken = f"reached {count} of them, and the cheapest was taken"
    note = f"{goals}; short searches {taken}"
    return problems[int(np.argmin(costs))], (note,)  # the nearest where none was reached


def solve(
    problem: PlanningProblem,
    options: SolveOptions = USUAL,
    planner: Planner | None = None,
    starts: Starts | None = None,
    controller: Controller | None = None,
    spent: float = 0.0,
    known: Candidate | None = None,
) -> PlanResult:
    """Looks for the best plan and certifies it; an expected failure is a status with a reason, not
    an error.

    Args:
        problem: The task, started from the straight line.
        options: How it is looked for; how the task is taken stands in the problem.
        planner: A planner with other options than the method's default.
        starts: Initial trajectories, if they are known already.
        controller: Who executes the plan: it is put on the controller's step, and the curve that
            the controller makes of it is certified. None for a plan by itself.
        spent: Processor time that was spent on the task before, of the seconds that it may take
            [s].
        known: A motion of the task that is known already.

    Raises:
        InputError: No such method, or not for this task.
    """
    return search_and_certify(problem, options, planner, starts, controller, spent, known)[0]


def search_and_certify(
    problem: PlanningProblem,
    options: SolveOptions,
    planner: Planner | None = None,
    starts: Starts | None = None,
    controller: Controller | None = None,
    spent: float = 0.0,
    known: Candidate | None = None,
) -> tuple[PlanResult, Ledger]:
    """The same, and the search's ledger: its best motion is as it was found, before it was put on
    a controller's step.

    Args:
        problem, options, planner, starts, controller, spent, known: As for `solve`.

    Raises:
        InputError: No such method, or not for this task.
    """
    planner = planner or make_planner(options.method, problem.objective)
    if controller is not None and isinstance(planner, Sequential) and problem.objective == "energy":
        planner = replace(planner, parts=controller.parts(float(problem.durations.sum())))
    options = replace(options, method=planner.name)
    result = PlanResult(
        "infeasible",
        method=options.method,
        objective=problem.objective,
        metric=problem.metric,
        seed=options.seed,
        robot=problem.scene.arm.name,
        joints=problem.scene.arm.joint_names,
        held=problem.held,
        carried=problem.carried,
    )
    if np.array_equal(problem.start, problem.goal):
        return _stand_still(problem, controller, result), Ledger(0, 0.0)
    reason = find_obstruction(problem)
    if reason:
        return replace(result, reason=reason), Ledger(0, 0.0)
    rng = np.random.default_rng(options.seed)
    ledger = _ledger(options, spent, share_kept_back(controller))
    if options.seconds is not None:
        ledger.at_allowed = measure_check(controller)
    if known is not None:
        ledger.offer(known)
    if starts is None:
        starts = ([problem], [])
        if not planner.explores:
            seconds = min(STARTS_SECONDS, STARTS_SHARE * ledger.most_seconds)
            starts = find_starts(problem, rng, seconds)
    problems, seeds = starts
    if options.workers > 1:
        search_together(planner, problems, ledger, options.seed, options.workers)
    else:
        planner.run(problems, ledger, rng)
    splines, certificate = certify_best(ledger, rng, controller)
    verdict = _judge(certificate, ledger, seeds, problem.known)
    bound = least_time(problem) if problem.objective == "time" else least_energy(problem)
    result = replace(
        result,
        splines=splines,
        certificate=certificate,
        evaluations=ledger.evaluations,
        bound=bound,
        starts=_start_records(problems, seeds, ledger),
        history=_history(ledger, problem, splines, certificate),
        notes=(*problem.notes, *_cuts(certificate), *ledger.notes),
        status=verdict["status"],
        reason=verdict["reason"],
    )
    if options.gap and result.solved:
        result = replace(result, reference_gap=_gap(result, problems))
    return replace(result, seconds=ledger.seconds, cpu_seconds=ledger.cpu_seconds), ledger


def _stand_still(
    problem: PlanningProblem, controller: Controller | None, result: PlanResult
) -> PlanResult:
    """The plan of a task whose start is its goal."""
    still, certificate = certify_standing(problem, controller)
    if certificate.broken:
        return replace(result, reason="; ".join(certificate.broken))
    note = "start and goal are the same: a plan of zero length"
    return replace(
        result,
        status="solved",
        splines=still,
        certificate=certificate,
        reference_gap=0.0,
        notes=(note, *problem.notes, *_cuts(certificate)),
        history=((0, 0.0, 0.0),),
    )


def _ledger(options: SolveOptions, spent: float, share: float = KEPT_BACK) -> Ledger:
    """What a search may spend: of seconds that were asked for, what is left, less something for the
    certificate.
    """
    most, seconds = options.budget
    if options.seconds is None:
        return Ledger(most, seconds, shown=True)
    left = max(seconds - spent, min(LEAST_SECONDS, seconds))
    kept_back = share * left
    return Ledger(most, left - kept_back, kept_back, shown=True)


def _history(
    ledger: Ledger,
    problem: PlanningProblem,
    splines: Splines | None,
    certificate: Certificate | None,
) -> tuple[tuple[int, float, float], ...]:
    """What was found when, at last the certified motion, which mending may have changed."""
    if splines is None or certificate is None or certificate.broken:
        return tuple(ledger.history)
    duration = float(splines.total[0])
    cost = plan_cost(problem.objective, duration, lambda: certificate.energy[problem.metric])
    return (*ledger.history, (ledger.evaluations, ledger.cpu_seconds, cost))


def _cuts(certificate: Certificate | None) -> tuple[str, ...]:
    """Pairs that keep less than what was asked for, in words."""
    return () if certificate is None else tuple(str(cut) for cut, _ in certificate.cuts)


def _judge(
    certificate: Certificate | None, ledger: Ledger, seeds: Sequence[Seed], known: str
) -> Verdict:
    """Status of a search, and its reason."""
    if certificate is None:
        reason = "the budget ended before anything was evaluated"
        return {"status": "budget_spent", "reason": reason}
    broken = certificate.broken
    if not broken:
        return {"status": "solved", "reason": ""}
    failed = [f"{seed.label}: {seed.reason}" for seed in seeds if seed.reason]
    reason = f"the best motion found is not allowed: {'; '.join(broken[:2])}"
    if seeds and len(failed) == len(seeds):
        reason += f"; no way round the obstacles was found ({'; '.join(sorted(set(failed))[:3])})"
    if known:
        reason += f"; it was to stay inside {known}, which --beyond leaves"
    status: Status = "budget_spent" if ledger.remaining == 0 else "infeasible"
    return {"status": status, "reason": reason}


def _start_records(
    problems: Sequence[PlanningProblem], seeds: Sequence[Seed], ledger: Ledger
) -> tuple[StartRecord, ...]:
    """What became of every initial trajectory: the cost it reached, or why it failed."""
    known = {problem.label: problem for problem in problems}
    left_out = "left out: the same way as another, or more energy than the ones tried"
    records: dict[str, StartRecord] = {}
    for seed in seeds:
        unused = "" if seed.label in known else left_out
        records[seed.label] = {
            "label": seed.label,
            "target_m": seed.target.tolist(),
            "via_points_rad": seed.vias.tolist(),
            "reason": seed.reason or unused,
        }
    for label in dict.fromkeys([*known, *ledger.best_of]):
        record = records.setdefault(label, {"label": label, "reason": ""})
        if label in known:
            record["initial_via_points_rad"] = known[label].vias.tolist()
        best = ledger.best_of.get(label)
        if best is not None:
            record["cost"] = best.cost if best.feasible else None
            record["violation"] = best.violation
    return tuple(records.values())


def _gap(result: PlanResult, problems: Sequence[PlanningProblem]) -> float | None:
    """Cost above the default method's, as a share; below zero where this one found better."""
    if result.method == DEFAULT_METHOD:
        return 0.0
    ledger = Ledger(USUAL_BUDGET[0], GAP_SECONDS)
    best = Sequential().run(problems, ledger, np.random.default_rng(result.seed)).best
    if best is None or not best.feasible:
        return None
    usual = best.cost
    if result.objective != "time":
        usual = certify(best.problem, best.splines).energy[result.metric]
    return result.cost / usual - 1.0
