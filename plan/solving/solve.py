"""One task, one method, one certified plan."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import chain
from typing import Any

import numpy as np

from ident.arrays import Array
from plan.command_options import DEFAULT_METHOD, USUAL_BUDGET, SolveOptions
from plan.initial.trees import Seed, find_seeds
from plan.initial.vias import from_seeds
from plan.planners.base import Candidate, Ledger, Planner, make_planner
from plan.planners.evolution import Evolution, start_compressed
from plan.planners.sequential import Sequential, descend_on_knots
from plan.problem.controllers import Controller
from plan.problem.cost import plan_cost
from plan.problem.problem import STRAIGHT, Limits, PlanningProblem
from plan.problem.ramps import find_time_law
from plan.problem.result import Certificate, PlanResult, certify, certify_standing
from plan.solving.bound import least_energy, least_time
from plan.solving.obstruction import find_obstruction
from plan.solving.workers import search_together
from plan.spline import Splines

# Evaluations for each start of the energy search from whose result time is shortened.
ENERGY_FIRST = 600
# Longest run of the default method that is only there to tell the gap, in processor time [s].
GAP_SECONDS = 60.0
# Longest search for initial trajectories where no budget says less, and its share of a budget [s].
STARTS_SECONDS, STARTS_SHARE = 60.0, 0.5
# Times that a plan whose dense check fails is searched anew with tightened limits, by each way of searching; what each
# may take in any case and at most [s], and trajectories at most. Where the budget is spent only one quick look is left.
MENDS, MEND_SECONDS, MEND_EVALUATIONS = 3, (1.0, 5.0), 3000
# Share of the time left that is kept back for the certificate and for mending, and the least that a search is given,
# whatever was asked for [s].
KEPT_BACK, LEAST_SECONDS = 0.1, 0.1
# The share where a controller's step may ask for another search.
KEPT_FOR_STEP = 0.25
# A mended motion that costs more than the found one by no more than this share ends the mending.
HARDLY = 0.002
# Factors by which a motion is slowed down to keep its limits between the search's samples.
SLOWER = (1.0 + 0.0005 * 2.0 ** np.arange(8)).tolist()
# The same on a controller's coarse step, of which a slower motion is followed the better: a search on it comes later.
MUCH_SLOWER = (1.001, 1.004, 1.016, 1.04, 1.08, 1.15, 1.25, 1.4, 1.7, 2.0)
# Factors by which a motion on a controller's step is made longer until it keeps its limits; how far a via
# angle may move there [rad], and most steps.
LONGER, ON_STEP, ON_STEP_STEPS = (1.0, 1.005, 1.015, 1.03, 1.06, 1.1, 1.25, 1.5), np.pi / 2, 40
USUAL = SolveOptions()
# What is tried for each goal before one is chosen, and how long in processor time [s].
QUICK = Sequential(starts=2, first=18, kept=(1,), levels=0)
QUICK_SECONDS = 3.0


Starts = tuple[Sequence[PlanningProblem], Sequence[Seed]]
"""A task from each of its initial trajectories, the straight line or the taught way first; and the ways round obstacles
that were looked for, with why some were not found."""


def find_starts(problem: PlanningProblem, rng: np.random.Generator, seconds: float = STARTS_SECONDS) -> Starts:
    """Initial trajectories: the taught one alone where one is given; else the line, and seeds round what is in its way.

    For the time objective they are brought to their energy optima first, as in section 3.3 of the paper, and then drawn
    together in time by one factor: what the time compression of the paper's baseline gives for nothing.

    Args:
        problem: The task, started from the straight line, or from the taught way.
        rng: Source of randomness.
        seconds: What may be spent: half on the ways round obstacles, half on energy optima [s].
    """
    timed, seeds = problem.objective == "time", list[Seed]()
    base = replace(problem, objective="energy", free="vias") if timed else problem
    if base.label == STRAIGHT and (base.scene.obstacles or base.initial_evaluation.collision[0] > 0):
        seeds = find_seeds(base, rng, seconds=seconds / 2)
    problems = from_seeds(base, seeds)
    if not timed:
        return problems, seeds
    ledger, goal = Ledger(10**9, seconds / 2), {"objective": "time", "free": problem.free}
    Evolution(most=ENERGY_FIRST * len(problems)).run(problems, ledger, rng)
    if not ledger.best_of:  # no time was left
        return [replace(problems[0], **goal)], seeds  # type: ignore[arg-type]
    # The best first; three at most, one where the path stays.
    found = sorted(ledger.best_of.values(), key=lambda best: (not best.feasible, best.violation, best.cost))
    kept = found[: 1 if problem.free == "times" else 3]
    return [start_compressed(best.problem.with_initial(best.splines, **goal)) for best in kept], seeds


def cheapest_goal(
    problems: Sequence[PlanningProblem], posed: bool, budget: tuple[int, float], seed: int
) -> tuple[PlanningProblem, tuple[str, ...]]:
    """The problem with the goal that is the cheapest to go to by a short search each; what was chosen from, in words.

    Args:
        problems: One for each goal, the nearest first.
        posed: Whether the goal is a pose.
        budget: Evaluations and seconds of the whole planning task; a third of it at most is spent here.
        seed: Of all chance.
    """
    if len(problems) == 1:
        return problems[0], ("one joint position brings the frame to the goal's pose",) if posed else ()
    rng, costs, (most, seconds) = np.random.default_rng(seed), [], budget
    for problem in problems:
        ledger = Ledger(max(1, most // (3 * len(problems))), min(QUICK_SECONDS, seconds / (3.0 * len(problems))))
        best = QUICK.run([problem], ledger, rng).best
        costs.append(best.cost if best is not None and best.feasible else np.inf)
    which = f"{len(problems)} joint positions bring the frame to the goal's pose" if posed else f"{len(problems)} goals"
    reached = int(np.isfinite(costs).sum())
    taken = f"reached {reached} of them, and the cheapest was taken"
    if reached == 0:
        taken = "reached none of them, and the nearest was taken"
    note = f"{which}; short searches {taken}"
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
    """Looks for the best plan and certifies it; an expected failure is a status with a reason, not an error.

    Args:
        problem: The task, started from the straight line.
        options: How it is looked for; how the task is taken stands in the problem.
        planner: A planner with other options than the method's default.
        starts: Initial trajectories, if they are known already.
        controller: Who executes the plan: it is put on the controller's step, and the curve that the controller makes
            of it is certified. None for a plan by itself.
        spent: Processor time that was spent on the task before, of the seconds that it may take [s].
        known: A motion of the task that is known already.

    Raises:
        InputError: No such method, or not for this task.
    """
    planner = planner or make_planner(options.method, problem.objective)
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
        still, certificate = certify_standing(problem, controller)
        if certificate.broken:
            return replace(result, reason="; ".join(certificate.broken))
        said = ("start and goal are the same: a plan of zero length", *problem.notes, *_cuts(certificate))
        result = replace(result, status="solved", splines=still, certificate=certificate, reference_gap=0.0)
        return replace(result, notes=said, history=((0, 0.0, 0.0),))
    reason = find_obstruction(problem)
    if reason:
        return replace(result, reason=reason)
    rng = np.random.default_rng(options.seed)
    ledger = _ledger(options, spent, KEPT_BACK if controller is None else KEPT_FOR_STEP)
    if known is not None:
        ledger.offer(known)
    if starts is None:
        seconds = min(STARTS_SECONDS, STARTS_SHARE * ledger.most_seconds)
        starts = ([problem], []) if planner.explores else find_starts(problem, rng, seconds)
    if options.workers > 1:
        search_together(planner, starts[0], ledger, options.seed, options.workers)
    else:
        planner.run(starts[0], ledger, rng)
    splines, found = _certified(ledger, rng, controller)
    verdict = _judge(found, ledger, starts[1], problem.known)
    result = replace(
        result,
        splines=splines,
        certificate=found,
        evaluations=ledger.evaluations,
        bound=least_time(problem) if problem.objective == "time" else least_energy(problem),
        starts=_start_records(*starts, ledger),
        history=_history(ledger, problem, splines, found),
        notes=(*problem.notes, *_cuts(found), *ledger.notes),
        **verdict,
    )
    if options.gap and result.solved:
        result = replace(result, reference_gap=_gap(result, starts[0]))
    return replace(result, seconds=ledger.seconds, cpu_seconds=ledger.cpu_seconds)


def _ledger(options: SolveOptions, spent: float, share: float = KEPT_BACK) -> Ledger:
    """What a search may spend: of seconds that were asked for, what is left, less something for the certificate."""
    most, seconds = options.budget
    if options.seconds is None:
        return Ledger(most, seconds, shown=True)
    left = max(seconds - spent, min(LEAST_SECONDS, seconds))
    kept_back = share * left
    return Ledger(most, left - kept_back, kept_back, shown=True)


def _history(
    ledger: Ledger, problem: PlanningProblem, splines: Splines | None, found: Certificate | None
) -> tuple[tuple[int, float, float], ...]:
    """What was found when, at last the certified motion, which mending may have made another one."""
    if splines is None or found is None or found.broken:
        return tuple(ledger.history)
    duration = float(splines.total[0])
    cost = plan_cost(problem.objective, duration, lambda: found.energy[problem.metric])
    return (*ledger.history, (ledger.evaluations, ledger.cpu_seconds, cost))


def _cuts(certificate: Certificate | None) -> tuple[str, ...]:
    """Pairs that keep less than what was asked for, in words."""
    return () if certificate is None else tuple(str(cut) for cut, _ in certificate.cuts)


def _certified(
    ledger: Ledger, rng: np.random.Generator, controller: Controller | None
) -> tuple[Splines | None, Certificate | None]:
    """The best candidate, on its controller's step if there is one, and its dense check.

    It is mended where the search's samples had missed something, or where the controller makes another curve of it.
    Mending ends at the first motion that passes and costs hardly more than what was found.
    """
    best = ledger.best
    if best is None:
        return None, None
    splines, certificate = _checked(best, controller)
    if not certificate.broken or not best.feasible:
        return splines, certificate
    what = "mended between the search's samples"
    if controller is not None:
        what = f"moved onto the step of {controller.name}, as the curve that it makes of the motion"
    ledger.notes.append(f"{what}: {'; '.join(certificate.broken)}")
    passed: list[tuple[float, Splines, Certificate]] = []
    ways = [_mended(best, certificate, ledger, rng)]
    if controller is not None:
        ways = [_slower(best, MUCH_SLOWER), _searched_on_step(best, certificate, ledger, controller)]
    for mended in chain(*ways):
        if passed and ledger.kept_back > 0.0 and ledger.whole_left <= 0.0:
            break
        if passed and mended.cost >= passed[0][0]:
            continue
        moved, checked = _checked(mended, controller)
        if not checked.broken:
            passed = [(mended.cost, moved, checked)]
            if mended.cost <= best.cost + HARDLY * abs(best.cost):
                break
    return passed[0][1:] if passed else (splines, certificate)


def _checked(candidate: Candidate, controller: Controller | None) -> tuple[Splines, Certificate]:
    """A candidate as it is executed, and its dense check."""
    problem, splines = candidate.problem, candidate.splines
    if controller is not None:
        splines = controller.put_on_step(splines, find_time_law(problem, splines))
    return splines, certify(problem, splines, controller)


def _mended(best: Candidate, certificate: Certificate, ledger: Ledger, rng: np.random.Generator) -> Iterator[Candidate]:
    """The motion slowed down a little, where time is free; or found anew with limits tighter by what was broken.

    What is quick comes first: gradients from where the motion is; where they don't help, and time is left, CMA-ES.
    """
    problem, limits, near = best.problem, best.problem.limits, bool(certificate.too_near)
    if not near:
        yield from _slower(best)
    ways: list[Planner] = [Evolution(step=0.01, most=MEND_EVALUATIONS)]
    if problem.grows and problem.free != "times":
        ways.insert(0, Sequential(starts=1, levels=0))
    for planner in ways:
        for turn in range(MENDS):
            if ledger.remaining == 0 and (turn > 0 or planner is not ways[0]):
                return
            own, slack = Ledger(10**9, _mending(ledger)), 1.002 + 0.01 * turn
            tighter = _tighter(limits, certificate, slack, 0.002 * (turn + 1) * near)
            planner.run([problem.with_initial(best.splines, limits=tighter, radius=0.15, label="mended")], own, rng)
            ledger.count(own.evaluations)
            found = own.best
            if found is not None and found.feasible:
                yield Candidate(found.problem, found.x, found.cost, 0.0)


def _mending(ledger: Ledger) -> float:
    """Processor time for one search that mends [s]: no more than is left, where the user has said how much that is."""
    least, most = MEND_SECONDS
    if ledger.kept_back > 0.0:
        least = min(least, ledger.kept_back)
    return float(np.clip(ledger.whole_left, least, most))


def _slower(best: Candidate, factors: Sequence[float] = SLOWER) -> Iterator[Candidate]:
    """The same motion slowed down a little, where time is free."""
    problem = best.problem
    if problem.objective != "time" or not problem.searches_times:
        return
    for factor in factors:
        slower = problem.with_initial(Splines(best.splines.points, best.splines.durations * factor))
        yield Candidate(slower, slower.initial, best.cost * factor, 0.0)


def _searched_on_step(
    best: Candidate, certificate: Certificate, ledger: Ledger, controller: Controller
) -> Iterator[Candidate]:
    """The motion searched anew with its knots on the controller's step, where time is free for longer and longer.

    Each time with limits tighter by what the last one passed between the search's samples.
    """
    problem, limits = best.problem, best.problem.limits
    total, timed = float(best.splines.total[0]), problem.objective == "time" and problem.searches_times
    knots = np.concatenate([[0.0], np.cumsum(best.splines.durations[0])]) / total
    for longer in LONGER if timed else (1.0,):
        whole = controller.whole(total * longer)
        shares = controller.knots_on_step(knots, whole)
        points = best.splines.at(shares * total)[0]
        points[0], points[-1] = best.splines.points[0, 0], best.splines.points[0, -1]
        moved = Splines(points[None], np.diff(shares * whole)[None])
        seen = certificate
        for turn in range(MENDS):
            if ledger.kept_back > 0.0 and ledger.whole_left <= 0.0:
                return
            own = Ledger(10**9, _mending(ledger))
            fixed = {"objective": "energy", "free": "vias", "label": "on the controller's step"}
            slack = 1.0 if turn == 0 else 1.0005 + 0.002 * turn
            tighter = _tighter(limits, seen, slack) if turn else limits
            task = problem.with_initial(moved, radius=ON_STEP, limits=tighter, **fixed)
            descend_on_knots(task, own, ON_STEP_STEPS)
            ledger.count(own.evaluations)
            if own.best is None or not own.best.feasible:
                break
            cost = whole if timed else own.best.cost
            found = replace(own.best, cost=cost, problem=replace(own.best.problem, limits=limits))
            yield found
            seen = _checked(found, controller)[1]
            if not seen.broken:
                return


def _tighter(limits: Limits, seen: Certificate, slack: float, clearance: float = 0.0) -> Limits:
    """Limits lower by what was seen above them, and a little more."""
    return replace(
        limits,
        torque=limits.torque / np.maximum(seen.torque_share * slack, 1.0),
        speed=limits.speed / np.maximum(seen.speed_share * slack, 1.0),
        acceleration=_tightened(limits.acceleration, seen.shares["acceleration"], slack),
        jerk=_tightened(limits.jerk, seen.shares["jerk"], slack),
        clearance=limits.clearance + clearance,
    )


def _tightened(limit: Array | None, share: Array | None, slack: float) -> Array | None:
    """A limit, lower by what was seen above it and a little more."""
    return limit if limit is None or share is None else limit / np.maximum(share * slack, 1.0)


def _judge(certificate: Certificate | None, ledger: Ledger, seeds: Sequence[Seed], known: str) -> dict[str, Any]:
    """Status of a search, and its reason."""
    if certificate is None:
        return {"status": "budget_spent", "reason": "the budget ended before anything was evaluated"}
    broken = certificate.broken
    if not broken:
        return {"status": "solved"}
    failed = [f"{seed.label}: {seed.reason}" for seed in seeds if seed.reason]
    reason = f"the best motion found is not allowed: {'; '.join(broken[:2])}"
    if seeds and len(failed) == len(seeds):
        reason += f"; no way round the obstacles was found ({'; '.join(sorted(set(failed))[:3])})"
    if known:
        reason += f"; it was to stay inside {known}, which --beyond leaves"
    return {"status": "budget_spent" if ledger.remaining == 0 else "infeasible", "reason": reason}


def _start_records(
    problems: Sequence[PlanningProblem], seeds: Sequence[Seed], ledger: Ledger
) -> tuple[dict[str, Any], ...]:
    """What became of every initial trajectory: the cost it reached, or why it failed."""
    known = {problem.label: problem for problem in problems}
    left_out = "left out: the same way as another, or more energy than the ones tried"
    records: dict[str, dict[str, Any]] = {
        seed.label: {
            "label": seed.label,
            "target_m": seed.target.tolist(),
            "via_points_rad": seed.vias.tolist(),
            "reason": seed.reason or ("" if seed.label in known else left_out),
        }
        for seed in seeds
    }
    for label in dict.fromkeys([*known, *ledger.best_of]):
        record = records.setdefault(label, {"label": label, "reason": ""})
        if label in known:
            record["initial_via_points_rad"] = known[label].vias.tolist()
        found = ledger.best_of.get(label)
        if found is not None:
            record |= {"cost": found.cost if found.feasible else None, "violation": found.violation}
    return tuple(records.values())


def _gap(result: PlanResult, problems: Sequence[PlanningProblem]) -> float | None:
    """Cost above the default method's, as a share; below zero where this one found better."""
    if result.method == DEFAULT_METHOD:
        return 0.0
    ledger = Ledger(USUAL_BUDGET[0], GAP_SECONDS)
    best = Sequential().run(problems, ledger, np.random.default_rng(result.seed)).best
    if best is None or not best.feasible:
        return None
    timed = result.objective == "time"
    return result.cost / (best.cost if timed else certify(best.problem, best.splines).energy[result.metric]) - 1.0
