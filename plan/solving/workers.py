"""One search in several processes: each from its own chance, the best motion of all is taken.

The processes are copies of this one, so the task need not be sent; they send back the knots of what
they found.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from multiprocessing.connection import Connection

import numpy as np

from ident.arrays import Array
from ident.errors import InputError
from plan.planners.base import Candidate, Ledger, Planner
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

Row = tuple[str, Array, Array, float, float]
"""A motion: its start's label, knots, section durations, cost and violation."""

Found = tuple[int, list[Row]]
"""Trajectories evaluated, and the best motion from each start."""


def search_together(
    planner: Planner, problems: Sequence[PlanningProblem], ledger: Ledger, seed: int, workers: int
) -> None:
    """Searches in so many processes at once, and enters what they find in their order.

    Each has its share of the budget, so that all of them together spend no more than one search
    would.

    Args:
        planner: The way of searching.
        problems: The task from different initial trajectories.
        ledger: What may be spent; gets what is found.
        seed: Each worker draws from this and its own number.
        workers: How many.

    Raises:
        InputError: The system can't copy a process.
    """
    if "fork" not in multiprocessing.get_all_start_methods():
        raise InputError("--workers", "this system can't copy a running process", "leave it out")
    context = multiprocessing.get_context("fork")
    seconds = ledger.seconds_left / workers
    share = Ledger(max(ledger.most // workers, 1), seconds, ledger.kept_back)
    running = []
    for number in range(workers):
        receiver, sender = context.Pipe(duplex=False)
        given = (sender, planner, problems, share, seed, number)
        process = context.Process(target=_search, args=given, daemon=True)
        process.start()
        sender.close()
        running.append((process, receiver))
    lost = 0
    for process, receiver in running:
        try:
            evaluations, rows = receiver.recv()
        except EOFError:
            lost += 1
        else:
            ledger.count(evaluations)
            for row in rows:
                ledger.offer(_candidate(problems, row))
        receiver.close()
        process.join()
    if lost:
        ledger.notes.append(f"{lost} of {workers} workers ended without an answer")


def _search(
    sender: Connection,
    planner: Planner,
    problems: Sequence[PlanningProblem],
    share: Ledger,
    seed: int,
    number: int,
) -> None:
    """What one worker does; the first draws as a search alone does."""
    rng = np.random.default_rng(seed if number == 0 else [seed, number])
    ledger = Ledger(share.most, share.most_seconds, share.kept_back)
    planner.run(problems, ledger, rng)
    rows = [_row(label, best) for label, best in ledger.best_of.items()]
    if ledger.best is not None:  # its knots may have been parted since
        rows.append(_row(ledger.best.problem.label, ledger.best))
    answer: Found = (ledger.evaluations, rows)
    sender.send(answer)
    sender.close()


def _row(label: str, best: Candidate) -> Row:
    splines = best.splines
    return label, splines.points, splines.durations, best.cost, best.violation


def _candidate(problems: Sequence[PlanningProblem], row: Row) -> Candidate:
    """A motion that a worker found, as one of this process."""
    label, points, durations, cost, violation = row
    carrier = replace(problems[0].with_initial(Splines(points, durations)), label=label)
    return Candidate(carrier, carrier.initial, cost, violation)
