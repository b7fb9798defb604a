"""All methods on one task, over several seeds: cost against evaluations and against time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, TypedDict

import numpy as np

from ident.errors import InputError
from ident.progress import stage
from ident.results import Result
from plan.command_options import CompareOptions, SolveOptions
from plan.planners.base import METHODS, TIME_ONLY, make_planner
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.solving.solve import find_starts, solve

SCHEMA = "plan.comparison/1"
# Methods without randomness run once.
FIXED = ("brute", "compress", "toppra")


class MethodRow(TypedDict):
    """Medians of a method's runs over the seeds; costs None where the median run had no plan."""

    method: str
    runs: int
    solved: int  # of them, with a certified plan
    cost: float | None  # energy [J] or duration [s]
    executed: float | None  # the same as a controller executes it, from rest to rest
    worst: float | None
    cost_at_evaluations: float | None  # reached within so many evaluations
    cost_at_seconds: float | None  # reached within so many seconds
    evaluations: int
    seconds: float
    clearance_m: float | None  # proven; of the runs with a plan
    above_best: float | None  # executed, above the cheapest of all plans, as a share


@dataclass(frozen=True, eq=False)
class Comparison(Result):
    """Results of every method and seed on one task."""

    SHOWN_BY = "plan.show.results"

    name: str  # the task
    objective: str  # `energy` or `time`
    evaluations: int  # where costs are compared
    seconds: float
    results: tuple[PlanResult, ...]

    @property
    def methods(self) -> list[str]:
        """Names of the methods, in the order of their runs."""
        return list(dict.fromkeys(result.method for result in self.results))

    def of(self, method: str) -> list[PlanResult]:
        """Results of one method."""
        return [result for result in self.results if result.method == method]

    def best(self) -> PlanResult | None:
        """The certified plan that is the cheapest as it is executed; None if there is none."""
        solved = [result for result in self.results if result.solved]
        return min(solved, key=lambda result: result.executed_cost, default=None)

    def rows(self) -> list[MethodRow]:
        """Medians over the seeds, a record a method; costs are None where the median run had no
        plan.
        """
        best = self.best()
        return [self._row(method, best) for method in self.methods]

    def _row(self, method: str, best: PlanResult | None) -> MethodRow:
        """A method's medians over the seeds, and how far it is above the cheapest of all plans."""
        runs = self.of(method)
        costs = [run.cost for run in runs]
        executed = _finite(np.median([run.executed_cost for run in runs]))
        at_evaluations = [cost_at(run, self.evaluations, 0) for run in runs]
        at_seconds = [cost_at(run, self.seconds, 1) for run in runs]
        certificates = [run.certificate for run in runs if run.solved]
        clear = [each.clearance.proven for each in certificates if each is not None]
        above_best = None
        if best is not None and executed is not None:
            above_best = executed / best.executed_cost - 1.0
        return {
            "method": method,
            "runs": len(runs),
            "solved": sum(run.solved for run in runs),
            "cost": _finite(np.median(costs)),
            "executed": executed,
            "worst": _finite(max(costs)),
            "cost_at_evaluations": _finite(np.median(at_evaluations)),
            "cost_at_seconds": _finite(np.median(at_seconds)),
            "evaluations": int(np.median([run.evaluations for run in runs])),
            "seconds": float(np.median([run.seconds for run in runs])),
            "clearance_m": float(np.median(clear)) if clear else None,
            "above_best": above_best,
        }

    def to_dict(self) -> dict[str, object]:
        """The record of `plan.comparison/1`."""
        return {
            "schema": SCHEMA,
            "task": self.name,
            "robot": next((result.robot for result in self.results), ""),
            "joints": list(next((result.joints for result in self.results), ())),
            "objective": self.objective,
            "at_evaluations": self.evaluations,
            "at_seconds": self.seconds,
            "summary": self.rows(),
            "results": [result.to_dict() for result in self.results],
            "provenance": self.provenance.to_dict(),
        }


def cost_at(result: PlanResult, limit: float, axis: int) -> float:
    """Best cost that a run had reached within so many evaluations (axis 0) or seconds (axis 1).

    Returns:
        Infinite where it had none by then.
    """
    reached = [row[2] for row in result.history if row[axis] <= limit]
    return min(reached, default=float("inf"))


def compare(problem: PlanningProblem, name: str, options: CompareOptions) -> Comparison:
    """Runs every method from the same initial trajectories, seed by seed.

    Args:
        problem: The task, started from the straight line.
        name: Its name.
        options: The methods, all that can do the task if none is named; seeds; and where costs are
            compared.

    Raises:
        InputError: No such method, or not for this task.
    """
    chosen = _named(options.methods) or able(problem)
    for method in chosen:
        make_planner(method, problem.objective)
    starts = cache(lambda seed: find_starts(problem, np.random.default_rng(seed)))
    runs = []
    for method in chosen:
        seeds = 1 if method in FIXED else options.seeds
        runs += [(method, seed) for seed in range(seeds)]
    results = []
    for number, (method, seed) in enumerate(runs):
        stage(f"{method}, seed {seed}", number / len(runs), (number + 1) / len(runs))
        options_of_run = SolveOptions(method=method, seed=seed, gap=False)
        results.append(solve(problem, options_of_run, starts=starts(seed)))
    return Comparison(name, problem.objective, options.evaluations, options.seconds, tuple(results))


def _named(methods: str | None) -> list[str]:
    """Methods of a list with commas; none where no list is given.

    Raises:
        InputError: One is unknown, or the list is empty.
    """
    if methods is None:
        return []
    names = [name.strip() for name in methods.split(",") if name.strip()]
    unknown = [name for name in names if name not in METHODS]
    if unknown or not names:
        what = f"{unknown[0]!r} is unknown" if unknown else "names no method"
        raise InputError("--methods", what, f"use some of: {', '.join(METHODS)}")
    return names


def able(problem: PlanningProblem) -> list[str]:
    """The methods that can do the task: compression and toppra for time, brute force for small
    grids.
    """
    left_out = set() if problem.objective == "time" else set(TIME_ONLY)
    if 11**problem.dimension > 2_000_000 or problem.free != "vias":
        left_out.add("brute")
    if problem.scene.obstacles or problem.way.given:
        left_out.add("reference")
    return [method for method in METHODS if method not in left_out]


def _finite(value: float | np.floating[Any]) -> float | None:
    return float(value) if np.isfinite(value) else None
