"""A trajectory drawn together in time, as far as all limits hold: where methods other than the default begin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from plan.planners.base import Budget, Ledger
from plan.problem.problem import SQUEEZE, PlanningProblem

# Durations tried at once when looking for the shortest feasible one.
TRIED = 12


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
