"""What every planner has.

A name, problems to start from, a ledger that counts and remembers, a budget that ends it.
"""

from __future__ import annotations

import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compile_seconds
from ident.errors import InputError
from ident.progress import step
from plan.problem.problem import TOLERANCE, BatchEvaluation, PlanningProblem
from plan.spline import Splines

# Where each method's planner stands; it is loaded when it is made: the libraries of some take
# seconds to load.
METHODS = {
    "sqp": "planners.sequential:Sequential",
    "reference": "planners.reference:Reference",
    "cma": "planners.evolution:Evolution",
    "ppo": "paper.ppo:Ppo",
    "ga": "paper.genetic:Genetic",
    "brute": "paper.brute_force:BruteForce",
    "compress": "paper.compression:Compression",
    "toppra": "paper.toppra:Toppra",
}
# Methods that shorten time only.
TIME_ONLY = ("compress", "toppra")
# Seconds between two questions to the system what was spent: each may wait behind all other
# processes.
LOOK_EVERY = 0.01


def processor_seconds() -> float:
    """Processor time of this process and of those that it started and that have ended [s]."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


def budget_seconds() -> float:
    """Processor time as budgets count it: without that of compiling loops [s].

    That is done once on a computer, before the first plan, and would leave nothing of a short
    budget.
    """
    return processor_seconds() - compile_seconds()


@dataclass(frozen=True, eq=False)
class Candidate:
    """One trajectory that a search looked at."""

    problem: PlanningProblem  # the problem whose decision vector it is
    x: Float[Array, " d"]  # decision vector
    cost: float  # cost as evaluated: energy [J] or duration [s]
    violation: float  # what it breaks; zero for a feasible one

    @property
    def feasible(self) -> bool:
        """Whether the search's own checks found nothing broken."""
        return self.violation <= TOLERANCE

    @property
    def splines(self) -> Splines:
        """The trajectory."""
        return self.problem.decode(self.x)

    def better_than(self, other: Candidate | None) -> bool:
        """Feasible before infeasible; then by cost, or by what is broken."""
        if other is None:
            return True
        if self.feasible != other.feasible:
            return self.feasible
        return self.cost < other.cost if self.feasible else self.violation < other.violation


class BudgetSpentError(Exception):
    """Ends a search from inside; never reaches the user."""


@dataclass
class Ledger:
    """Counts what a search spends of its budget, keeps the best candidate and the history."""

    most: int  # trajectories that may be evaluated; the search ends with these or with the time
    most_seconds: (
        float  # processor time that may be spent, which a busy machine does not stretch [s]
    )
    # Beyond that, for the certificate and for mending what it finds [s].
    kept_back: float = 0.0
    shown: bool = False  # whether whoever listens is told how much of the budget is spent
    # Evaluations that the search needs, where it knows that beforehand: what is told goes by them.
    expected: int = 0
    # What is done with each candidate that is allowed and the best so far, while the search runs.
    at_allowed: Callable[[Ledger, Candidate], None] | None = None
    # The best that keeps its limits as it is executed, where that was looked at on the way.
    passed: Candidate | None = None
    checked: tuple[Candidate, object] | None = None  # one that was checked in full, and its check
    check_seconds: float = 0.0  # the dearest check of a motion in full that was seen [s]
    evaluations: int = 0
    best: Candidate | None = None
    best_of: dict[str, Candidate] = field(default_factory=dict)
    history: list[tuple[int, float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    _started: float = field(init=False)
    _cpu_started: float = field(init=False)
    _looked: float = -math.inf
    _spent: float = 0.0

    def __post_init__(self) -> None:
        self._started = time.perf_counter()
        self._cpu_started = budget_seconds()

    @property
    def seconds(self) -> float:
        """Time spent so far [s]."""
        return time.perf_counter() - self._started

    @property
    def cpu_seconds(self) -> float:
        """Processor time since the search began, without that of compiling loops [s]."""
        return budget_seconds() - self._cpu_started

    @property
    def seconds_left(self) -> float:
        """Processor time left of the budget, as it was a hundredth of a second ago at most [s]."""
        now = time.perf_counter()
        if now - self._looked > LOOK_EVERY:
            self._looked = now
            self._spent = self.cpu_seconds
        return self.most_seconds - self._spent

    @property
    def whole(self) -> float:
        """Processor time that may be spent in all [s]."""
        return self.most_seconds + self.kept_back

    @property
    def whole_left(self) -> float:
        """What is left of that [s]."""
        return self.seconds_left + self.kept_back

    @property
    def remaining(self) -> int:
        """Evaluations left; zero once the processor time is spent."""
        return 0 if self.seconds_left <= 0.0 else max(self.most - self.evaluations, 0)

    @property
    def solved(self) -> bool:
        """Whether a feasible trajectory is known."""
        return self.best is not None and self.best.feasible

    def evaluate(self, problem: PlanningProblem, x: Float[Array, "B d"]) -> BatchEvaluation:
        """Evaluates a batch against the budget.

        Raises:
            BudgetSpentError: Not one more evaluation is left.
        """
        x = np.atleast_2d(x)[: self.remaining]
        if len(x) == 0:
            raise BudgetSpentError
        evaluation = problem.evaluate(x)
        self.count(len(x))
        violation = evaluation.violation
        cost = evaluation.cost
        is_allowed = violation <= TOLERANCE
        first = np.lexsort((np.where(is_allowed, cost, violation), ~is_allowed))[0]
        self.offer(Candidate(problem, x[first].copy(), float(cost[first]), float(violation[first])))
        return evaluation

    def penalised(self, problem: PlanningProblem, x: Float[Array, "B d"]) -> Float[Array, " b"]:
        """Evaluates a batch against the budget, as one number each to minimise.

        Args:
            problem: The task.
            x: Decision vectors.

        Returns:
            One a vector: b is less than B where the budget ends.

        Raises:
            BudgetSpentError: Not one more evaluation is left.
        """
        return problem.penalised(self.evaluate(problem, x))

    def count(self, evaluations: int) -> None:
        """Adds evaluations, those that a solver made by itself too."""
        self.evaluations += evaluations
        if self.shown:
            most = min(self.expected or self.most, self.most)
            share = max(self.evaluations / most, self._spent / max(self.most_seconds, 1e-9))
            step(min(round(1000.0 * share), 1000), 1000)

    def offer(self, candidate: Candidate) -> None:
        """Enters a candidate that was evaluated elsewhere."""
        if candidate.better_than(self.best_of.get(candidate.problem.label)):
            self.best_of[candidate.problem.label] = candidate
        if candidate.better_than(self.best):
            self.best = candidate
            cost = candidate.cost if candidate.feasible else np.inf
            self.history.append((self.evaluations, self.cpu_seconds, cost))
            if self.at_allowed is not None and candidate.feasible:
                self.at_allowed(self, candidate)

    def keep_back(self, seconds: float) -> None:
        """Keeps back so much of the whole from now on [s]."""
        self.most_seconds = self.whole - seconds
        self.kept_back = seconds


class Planner(ABC):
    """A way of searching.

    Options live in the constructor; `search` gets the problems, one for each initial trajectory,
    best first. One that explores looks for initial trajectories itself and gets the straight line,
    or the taught way.
    """

    name: ClassVar[str]
    explores: ClassVar[bool] = False

    @abstractmethod
    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Looks for the best trajectory and leaves it in the ledger.

        Args:
            problems: One task from different initial trajectories.
            ledger: Evaluates, counts, remembers.
            rng: Source of randomness; the same seed gives the same search.
        """

    def run(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> Ledger:
        """Searches until done or until the budget is spent."""
        try:
            self.search(problems, ledger, rng)
        except BudgetSpentError:
            ledger.notes.append("the budget ended the search")
        return ledger


def make_planner(method: str, objective: str) -> Planner:
    """The planner of a name.

    Raises:
        InputError: No such method, or not for this objective.
    """
    if method not in METHODS:
        raise InputError("--method", f"{method!r} is unknown", f"use one of: {', '.join(METHODS)}")
    if method in TIME_ONLY and objective != "time":
        remedy = "use --objective time, or another method"
        raise InputError("--method", f"{method} shortens time only", remedy)
    module, name = METHODS[method].split(":")
    planner: Planner = getattr(import_module(f"plan.{module}"), name)()
    return planner
