"""Time compression: the paper's baseline for speed.

The path's via points stay; its time stamps are drawn together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from plan.planners.base import Ledger, Planner
from plan.planners.evolution import shortest
from plan.problem.problem import PlanningProblem

# A section keeps at least this share of itself in one pass.
STEP = 0.9
PASSES = 100
WORDS = {
    "factor": "one factor",
    "pass": "per section, one pass",
    "sections": "per section, in balance",
}


@dataclass(frozen=True)
class Compression(Planner):
    """Shortens by one factor, or every section by itself, until a limit is met.

    The paper "individually compressed the elapsed time of all trajectory sections until the joint
    reached its torque limit"; in what order, and whether once, is not said. `pass` takes that
    literally: one section after the other, each as far as it goes; the first ones leave their
    neighbours no room. In `sections` each gives up a tenth at most, pass after pass, until a pass
    gains nothing. One factor keeps the path as it is; unequal sections change the spline between
    the via points, so collisions are checked again.
    """

    # `factor`, `pass`, `sections`, or `all` for the best of them.
    mode: Literal["factor", "pass", "sections", "all"] = "all"
    name: ClassVar[str] = "compress"

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Compresses every initial trajectory; uses no randomness.

        Raises:
            InputError: The task asks for energy.
        """
        for problem in problems:
            if problem.objective != "time" or not problem.searches_times:
                raise InputError(
                    "--method compress", "it shortens time only", "use --objective time, times free"
                )
            for mode, words in WORDS.items():
                if self.mode in (mode, "all"):
                    durations = self._compress(problem, ledger, mode)
                    ledger.notes.append(f"{words} ({problem.label}): {durations.sum():.4f} s")

    def _compress(self, problem: PlanningProblem, ledger: Ledger, mode: str) -> Float[Array, " S"]:
        durations = np.array(problem.durations)
        if mode == "factor":
            return shortest(problem, ledger, durations, np.arange(len(durations)))
        for _ in range(1 if mode == "pass" else PASSES):
            before = durations.sum()
            for k in range(len(durations)):
                durations = shortest(
                    problem, ledger, durations, np.array([k]), STEP if mode == "sections" else 0.0
                )
            if durations.sum() > before * (1.0 - 1e-4):
                break
        return durations
