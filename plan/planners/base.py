"""What every planner has: problems to start from, a ledger that counts and remembers, a budget that ends it."""

from __future__ import annotations

import hashlib
import math
import os
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.files import atomic_write
from ident.model.net_options import torch_threads
from ident.safe_read import read_arrays, require_regular
from plan.errors import MethodError
from plan.problem.problem import TOLERANCE, BatchEvaluation, PlanningProblem
from plan.spline import Splines

# Called with the evaluations so far, the evaluations allowed, and the best cost.
Progress = Callable[[int, int, float], None]
# Seconds between two checkpoints, and between two questions to the system what was spent: on a busy machine each may
# wait behind all other processes.
CHECKPOINT_EVERY, LOOK_EVERY = 2.0, 0.01
JOURNAL_REMEDY = "choose another file for --resume, or remove it yourself"


def processor_seconds() -> float:
    """Processor time of this process and of those that it started and that have ended [s]."""
    times = os.times()
    return time.process_time() + times.children_user + times.children_system


@dataclass(frozen=True)
class Budget:
    """What a search may spend, whichever ends first."""

    evaluations: int = 20_000  # trajectories evaluated
    seconds: float = 120.0  # processor time, which a busy machine does not stretch [s]


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
    """Counts evaluations and time, keeps the best candidate and the history, and writes the journal.

    The journal is what makes every planner resumable alike: it holds the outcomes of all evaluations in order. A
    planner asks for the same candidates again when it starts with the same seed, so a resumed search is fed from the
    journal until that ends, without evaluating anything, and is then in the state in which it stopped.
    """

    budget: Budget  # what may be spent
    progress: Progress | None = None  # called after each batch
    journal: Path | None = None  # file for checkpoints; none if None
    fingerprint: str = ""  # tells journals of different tasks apart
    evaluations: int = 0
    best: Candidate | None = None
    best_of: dict[str, Candidate] = field(default_factory=dict)
    history: list[tuple[int, float, float]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    _told: list[Array] = field(default_factory=list)
    _replay: Array | None = None
    _started: float = field(default_factory=time.perf_counter)
    _cpu_started: float = field(default_factory=processor_seconds)
    _seconds_before: float = 0.0
    _cpu_before: float = 0.0
    _saved: float = 0.0
    _looked: float = -math.inf
    _spent: float = 0.0
    _digest: str = ""

    def __post_init__(self) -> None:
        """Takes up what an interrupted search of the same task left; that of another task is not used."""
        self._digest = hashlib.sha256(self.fingerprint.encode()).hexdigest()
        if self.journal is None or not os.path.lexists(self.journal):
            return
        if not require_regular(self.journal, JOURNAL_REMEDY, MethodError):  # an empty one is a place made for it
            return
        stored = read_arrays(self.journal, JOURNAL_REMEDY, MethodError)
        try:
            rows = np.asarray(stored["rows"], dtype=float)
            seconds, cpu = float(stored["seconds"]), float(stored["cpu_seconds"])
            if rows.ndim != 2 or not (seconds >= 0.0 and cpu >= 0.0):
                raise ValueError("its figures are none of a search")
            if str(stored["fingerprint"]) == self._digest:
                self._replay, self._seconds_before, self._cpu_before = rows, seconds, cpu
        except (ValueError, KeyError, TypeError) as error:
            what = f"no checkpoint of a search ({type(error).__name__}: {error})"
            raise MethodError(self.journal, what, JOURNAL_REMEDY) from None

    @property
    def seconds(self) -> float:
        """Time spent so far, that of the interrupted search included [s]."""
        return self._seconds_before + time.perf_counter() - self._started

    @property
    def cpu_seconds(self) -> float:
        """Processor time since the search began, that of the interrupted search included [s]."""
        return self._cpu_before + processor_seconds() - self._cpu_started

    @property
    def seconds_left(self) -> float:
        """Processor time that is left of the budget, as it was a hundredth of a second ago at most [s]."""
        now = time.perf_counter()
        if now - self._looked > LOOK_EVERY:
            self._looked, self._spent = now, self.cpu_seconds
        return self.budget.seconds - self._spent

    @property
    def remaining(self) -> int:
        """Evaluations left; zero once the processor time is spent."""
        return 0 if self.seconds_left <= 0.0 else max(self.budget.evaluations - self.evaluations, 0)

    def evaluate(self, problem: PlanningProblem, x: Float[Array, "B d"]) -> BatchEvaluation:
        """Evaluates a batch against the budget.

        Raises:
            BudgetSpentError: Not one more evaluation is left.
        """
        x = np.atleast_2d(x)[: self.remaining]
        if len(x) == 0:
            raise BudgetSpentError
        if self._replay is None or len(self._replay) < len(x) or self._replay.shape[1] != 6 + problem.n:
            self._replay, found = None, problem.evaluate(x)
        else:
            rows, self._replay = self._replay[: len(x)], self._replay[len(x) :]
            cost, collision, speed, torque, position, gap = rows[:, :6].T
            found = BatchEvaluation(cost, collision, speed, torque, position, gap, rows[:, 6:])
        self._record(problem, x, found)
        return found

    def penalised(self, problem: PlanningProblem, x: Float[Array, "B d"]) -> Float[Array, " b"]:
        """As `evaluate`, as one number to minimise; shorter than asked where the budget ends."""
        return problem.penalised(self.evaluate(problem, x))

    def save(self) -> None:
        """Writes the journal, whole or not at all."""
        if self.journal is None or not self._told:
            return
        with atomic_write(self.journal) as part, Path(part).open("wb") as stream:
            rows, digest = np.concatenate(self._told), np.array(self._digest)
            np.savez(stream, rows=rows, fingerprint=digest, seconds=self.seconds, cpu_seconds=self.cpu_seconds)
        self._saved = time.perf_counter()

    def count(self, evaluations: int) -> None:
        """Adds evaluations that a solver made by itself."""
        self.evaluations += evaluations

    def offer(self, candidate: Candidate) -> None:
        """Enters a candidate that was evaluated elsewhere."""
        if candidate.better_than(self.best_of.get(candidate.problem.label)):
            self.best_of[candidate.problem.label] = candidate
        if candidate.better_than(self.best):
            self.best = candidate
            self.history.append((self.evaluations, self.cpu_seconds, candidate.cost if candidate.feasible else np.inf))

    def _record(self, problem: PlanningProblem, x: Array, found: BatchEvaluation) -> None:
        self.evaluations += len(x)
        violation = found.violation
        first = np.lexsort((np.where(violation <= TOLERANCE, found.cost, violation), violation > TOLERANCE))[0]
        self.offer(Candidate(problem, x[first].copy(), float(found.cost[first]), float(violation[first])))
        if self.journal is not None:
            parts = found.cost, found.collision, found.speed, found.torque, found.position, found.gap, found.peak
            self._told.append(np.column_stack(parts))
            if time.perf_counter() - self._saved > CHECKPOINT_EVERY:
                self.save()
        if self.progress is not None and self.best is not None:
            self.progress(self.evaluations, self.budget.evaluations, self.best.cost)


class Planner(ABC):
    """A way of searching.

    Options live in the constructor; `search` gets the problems, one for each initial trajectory, best first. One that
    explores looks for initial trajectories itself and gets the straight line, or the taught way.
    """

    name: ClassVar[str]
    threads: ClassVar[int] = 1
    explores: ClassVar[bool] = False

    @abstractmethod
    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Looks for the best trajectory and leaves it in the ledger.

        Args:
            problems: One task from different initial trajectories.
            ledger: Evaluates, counts, remembers.
            rng: Source of randomness; the same seed gives the same search.
        """

    def run(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> Ledger:
        """Searches until done or until the budget is spent."""
        try:
            with torch_threads(self.threads):
                self.search(problems, ledger, rng)
        except BudgetSpentError:
            ledger.notes.append("the budget ended the search")
        finally:
            ledger.save()
        return ledger
