"""Time compression: the paper's baseline for speed. The path's via points stay; its time stamps are drawn together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ident.arrays import Array, Float
from plan.errors import MethodError
from plan.planners.base import Ledger, Planner
from plan.problem import SQUEEZE, PlanningProblem

# Durations tried at once when looking for the shortest feasible one.
TRIED = 12
# A section keeps at least this share of itself in one pass.
STEP = 0.9


@dataclass(frozen=True)
class Compression(Planner):
    """Shortens one factor, or every section by itself, until a limit is met.

    The paper "individually compressed the elapsed time of all trajectory sections until the joint reached its torque
    limit"; in what order is not said. Here each section in turn gives up a tenth at most, pass after pass, until a
    pass gains nothing: a section that is drawn together all at once leaves its neighbours no room. One factor keeps
    the path as it is; unequal sections change the spline between the via points, so collisions are checked again.

    Attributes:
        mode: `factor`, `sections`, or `both` for the better of the two.
        passes: Most passes over the sections.
    """

    mode: Literal["factor", "sections", "both"] = "both"
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
            if self.mode in ("factor", "both"):
                factor = _shortest(problem, ledger, problem.durations, np.arange(len(problem.durations)))
                ledger.notes.append(f"one factor ({problem.label}): {factor.sum():.4f} s")
            if self.mode in ("sections", "both"):
                sections = self._sections(problem, ledger)
                ledger.notes.append(f"per section ({problem.label}): {sections.sum():.4f} s")

    def _sections(self, problem: PlanningProblem, ledger: Ledger) -> Float[Array, " S"]:
        durations = np.array(problem.durations)
        for _ in range(self.passes):
            before = durations.sum()
            for k in range(len(durations)):
                durations = _shortest(problem, ledger, durations, np.array([k]), STEP)
            if durations.sum() > before * (1.0 - 1e-4):
                break
        return durations


def _shortest(
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
