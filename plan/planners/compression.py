"""Time compression: the paper's baseline for speed. The path's via points stay; its time stamps are drawn together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from ident.arrays import Array, Float
from plan.errors import MethodError
from plan.planners.base import Budget, Ledger, Planner
from plan.problem.problem import SQUEEZE, PlanningProblem

# Durations tried at once when looking for the shortest feasible one.
TRIED = 12
# A section keeps at least this share of itself in one pass.
STEP = 0.9
WORDS = {"factor": "one factor", "pass": "per section, one pass", "sections": "per section, in balance"}


@dataclass(frozen=True)
class Compression(Planner):
    """Shortens by one factor, or every section by itself, until a limit is met.

    The paper "individually compressed the elapsed time of all trajectory sections until the joint reached its torque
    limit"; in what order, and whether once, is not said. `pass` takes that literally: one section after the other, each
    as far as it goes; the first ones leave their neighbours no room. In `sections` each gives up a tenth at most, pass
    after pass, until a pass gains nothing. One factor keeps the path as it is; unequal sections change the spline
    between the via points, so collisions are checked again.

    Attributes:
        mode: `factor`, `pass`, `sections`, or `all` for the best of them.
        passes: Most passes over the sections.
    """

    mode: Literal["factor", "pass", "sections", "all"] = "all"
    passes: int = 100
    name: ClassVar[str] = "compress"

    def search(self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator) -> None:
        """Compresses every initial trajectory; uses no randomness.

        Raises:
            MethodError: The task asks for energy.
        """
        for problem in problems:
            if problem.objective != "time" or not problem.searches_times:
                raise MethodError("--method compress", "it shortens time only", "use --objective time, times free")
            for mode, words in WORDS.items():
                if self.mode in (mode, "all"):
                    durations = self._compress(problem, ledger, mode)
                    ledger.notes.append(f"{words} ({problem.label}): {durations.sum():.4f} s")

    def _compress(self, problem: PlanningProblem, ledger: Ledger, mode: str) -> Float[Array, " S"]:
        durations = np.array(problem.durations)
        if mode == "factor":
            return shortest(problem, ledger, durations, np.arange(len(durations)))
        for _ in range(1 if mode == "pass" else self.passes):
            before = durations.sum()
            for k in range(len(durations)):
                durations = shortest(problem, ledger, durations, np.array([k]), STEP if mode == "sections" else 0.0)
            if durations.sum() > before * (1.0 - 1e-4):
                break
        return durations


def start_compressed(problem: PlanningProblem) -> PlanningProblem:
    """The same problem from its initial trajectory drawn together by one factor, as far as all limits hold."""
    ledger = Ledger(Budget(10**6, 60.0))
    durations = shortest(problem, ledger, np.array(problem.durations), np.arange(len(problem.durations)))
    return replace(problem, durations=durations)


def shortest(
    problem: PlanningProblem, ledger: Ledger, durations: Float[Array, " S"], which: Array, least: float = 0.0
) -> Float[Array, " S"]:
    """Shrinks the chosen sections by one factor, not below the least, as far as all limits hold on the way there."""
    floor = SQUEEZE * (1.0 + 1e-9) * float((problem.durations[which] / durations[which]).max())
    low, high = min(max(floor, least), 1.0), 1.0
    while high - low > 1e-4 * high:
        factors = np.linspace(high, low, TRIED)
        trial = np.repeat(durations[None], TRIED, axis=0)
        trial[:, which] *= factors[:, None]
        found = ledger.evaluate(problem, np.array([problem.encode(problem.vias, row) for row in trial]))
        broken = np.flatnonzero(~found.feasible)
        if len(broken) == 0:
            high = factors[len(found.cost) - 1]
            break
        if broken[0] == 0:
            break
        high, low = factors[broken[0] - 1], factors[broken[0]]
    shortened = durations.copy()
    shortened[which] *= high
    return shortened
