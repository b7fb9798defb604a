"""CMA-ES over the decision vector.

And trajectories drawn together in time as far as all limits hold.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float, Int
from plan.planners.base import Ledger, Planner
from plan.problem.problem import SQUEEZE, PlanningProblem

# Generations a round before the runs are halved.
ROUND = 25
# A run ends when its costs lie this close together, as a share of the initial cost.
TOLERANCE = 1e-6
# Durations tried at once when looking for the shortest feasible one.
TRIED = 12


@dataclass(frozen=True)
class Evolution(Planner):
    """Covariance matrix adaptation, run side by side from every initial trajectory.

    The runs share the budget: all get the same number of generations first, then the better half,
    and so on, until one is left (successive halving).
    """

    step: float = 0.05  # initial standard deviation, as a share of each variable's range
    most: int = 0  # evaluations after which the search ends; no end but the budget's if 0
    name: ClassVar[str] = "cma"

    def search(
        self, problems: Sequence[PlanningProblem], ledger: Ledger, rng: np.random.Generator
    ) -> None:
        """Runs until every surviving run has converged."""
        runs = [_Run(problem, self, int(rng.integers(1, 2**31))) for problem in problems]
        end = ledger.evaluations + self.most if self.most else np.inf
        while runs and ledger.evaluations < end:
            for run in runs:
                for _ in range(ROUND):
                    if run.done or ledger.evaluations >= end:
                        break
                    run.advance(ledger)
            runs = sorted(runs, key=lambda run: run.best)[: (len(runs) + 1) // 2]
            if len(runs) == 1 and runs[0].done:
                return


class _Run:
    """One strategy in coordinates where every variable's range is one."""

    def __init__(self, problem: PlanningProblem, options: Evolution, seed: int) -> None:
        import cma  # slow to load, and the default method does without

        self.problem = problem
        self.span = problem.upper - problem.lower
        self.best = np.inf
        begin = (problem.initial - problem.lower) / self.span
        settings = {
            "bounds": [0.0, 1.0],
            "popsize": 2 * (4 + int(3 * np.log(problem.dimension))),
            "seed": seed,
            "verbose": -9,
            "tolfun": TOLERANCE,
            "tolfunhist": TOLERANCE,
            "tolx": 1e-6,
            # The folder where the user stands may hold a stranger's `cma_signals.in`: no file of
            # options, no log.
            "signals_filename": "",
            "verb_log": 0,
        }
        inside = np.clip(begin, 1e-6, 1.0 - 1e-6)
        self.strategy = cma.CMAEvolutionStrategy(inside, options.step, settings)

    @property
    def done(self) -> bool:
        """Whether the strategy has converged."""
        return bool(self.strategy.stop())

    def advance(self, ledger: Ledger) -> None:
        """One generation."""
        asked = self.strategy.ask()
        cost = ledger.penalised(self.problem, self.problem.lower + np.array(asked) * self.span)
        self.best = min(self.best, float(cost.min()))
        missing = len(asked) - len(cost)
        padded = np.concatenate([cost, np.full(missing, cost.max())])
        self.strategy.tell(asked, padded.tolist())


def start_compressed(problem: PlanningProblem) -> PlanningProblem:
    """The problem with its initial trajectory drawn together in time as far as all limits hold."""
    ledger = Ledger(10**6, 60.0)
    every = np.arange(len(problem.durations))
    durations = shortest(problem, ledger, np.array(problem.durations), every)
    return replace(problem, durations=durations)


def shortest(
    problem: PlanningProblem,
    ledger: Ledger,
    durations: Float[Array, " S"],
    which: Int[Array, " s"],
    least: float = 0.0,
) -> Float[Array, " S"]:
    """Shrinks the chosen sections by one factor as far as all limits hold on the way there.

    Args:
        problem: The task, its via points the motion's.
        ledger: Counts what is evaluated.
        durations: Of all sections, to begin with [s].
        which: The sections that may be shorter.
        least: The factor is not below this.
    """
    ratios = problem.durations[which] / durations[which]
    floor = SQUEEZE * (1.0 + 1e-9) * float(ratios.max())
    low = min(max(floor, least), 1.0)
    high = 1.0
    while high - low > 1e-4 * high:
        factors = np.linspace(high, low, TRIED)
        trial = np.repeat(durations[None], TRIED, axis=0)
        trial[:, which] *= factors[:, None]
        decisions = np.array([problem.encode(problem.vias, row) for row in trial])
        evaluation = ledger.evaluate(problem, decisions)
        broken = np.flatnonzero(~evaluation.feasible)
        if len(broken) == 0:
            high = factors[len(evaluation.cost) - 1]
            break
        if broken[0] == 0:
            break
        high = factors[broken[0] - 1]
        low = factors[broken[0]]
    shortened = durations.copy()
    shortened[which] *= high
    return shortened
