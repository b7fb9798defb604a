"""A search on several cores: every process tries its own share of the starts, and the best motion of all counts."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from plan.errors import MethodError
from plan.options import SolveOptions
from plan.planners.base import Budget, Candidate, Ledger
from plan.planners.sequential import Sequential
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

MOST_WORKERS = 64


# Of one process: the best motions with their labels, costs and violations, evaluations and notes. Of a problem nothing
# goes through a pipe; processes that are forked have it, here.
Part = tuple[list[tuple[str, Splines, float, float]], int, list[str]]
_SHARE: list[Callable[[int], Part]] = []


def require_workers(options: SolveOptions) -> None:
    """Raises MethodError for a number of processes, or a method, with which starts can't be shared."""
    method, workers = options.method, options.workers
    if not 1 <= workers <= MOST_WORKERS:
        raise MethodError("--workers", f"{workers} processes", f"give 1 to {MOST_WORKERS}")
    if workers > 1 and method != "sqp":
        raise MethodError("--workers", f"{method} searches in one process", "use --method sqp, or --workers 1")
    if workers > 1 and options.resume is not None:
        raise MethodError("--resume", "a search on several cores keeps no checkpoint", "give --workers 1")
    if workers > 1 and "fork" not in multiprocessing.get_all_start_methods():
        raise MethodError("--workers", "this system can't share a task between processes", "give --workers 1")


def search_in_parallel(
    planner: Sequential, problems: Sequence[PlanningProblem], ledger: Ledger, seed: int, workers: int
) -> None:
    """Searches with so many processes, each with its share of starts, evaluations and processor time.

    Args:
        planner: Its starts are shared out.
        problems: The task.
        ledger: Gets the best motion from every start, and what was spent.
        seed: Of all processes alike: they know of the same starts, and each tries its own.
        workers: Number of processes.
    """
    _SHARE[:] = [partial(_share, planner, tuple(problems), ledger.budget, seed, workers)]
    with multiprocessing.get_context("fork").Pool(workers) as pool:
        parts = pool.map(_run_share, range(workers), chunksize=1)
        pool.close()
        pool.join()  # their processor time counts from now on
    for found, evaluations, notes in parts:
        ledger.count(evaluations)
        ledger.notes.extend(note for note in notes if note not in ledger.notes)
        for label, splines, cost, violation in found:
            whole = problems[0].with_initial(splines, label=label)
            ledger.offer(Candidate(whole, whole.initial, cost, violation))


def _run_share(number: int) -> Part:
    return _SHARE[0](number)


def _share(
    planner: Sequential, problems: tuple[PlanningProblem, ...], budget: Budget, seed: int, workers: int, number: int
) -> Part:
    """One process's share: its best motions, what it evaluated, its notes."""
    ledger = Ledger(Budget(max(1, budget.evaluations // workers), budget.seconds / workers))
    own = replace(planner, starts=-(-planner.starts // workers), share=(number, workers))
    own.run(problems, ledger, np.random.default_rng(seed))
    found = [(label, best.splines, best.cost, best.violation) for label, best in ledger.best_of.items()]
    return found, ledger.evaluations, ledger.notes
