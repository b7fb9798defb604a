"""Rewards of the reinforcement learner."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ident.arrays import Array, Float
from plan.problem.problem import BatchEvaluation, PlanningProblem

# The least distance that the paper's −1/dist is taken at: its reward is singular at contact [m].
LEAST_DISTANCE = 1e-3


def bounded_reward(problem: PlanningProblem, found: BatchEvaluation) -> Float[Array, " B"]:
    """Minus the cost as a share of the initial one, less a bounded penalty for what is broken.

    Continuous up to one step at feasibility, so that a worse collision is always worse, and finite everywhere.
    """
    return -np.clip(problem.penalised(found), -10.0, 10.0)


def paper_reward(problem: PlanningProblem, found: BatchEvaluation) -> Float[Array, " B"]:
    """The paper's rewards, eq. 7 for energy and eq. 9 for time.

    Its errata: −1/dist_min is singular at contact, and what a distance is under penetration is not said (here the
    penetration depth, at least 1 mm); eq. 9 does not say which joint and instant (here the worst excess of any
    joint) and knows no other limit. Speed and position limits, and collisions in eq. 9, are treated like a collision
    of 1 / 2 m.
    """
    hit = found.collision > 0
    broken = found.speed + found.position > 0
    severity = np.where(hit, 1.0 / np.maximum(np.abs(found.gap), LEAST_DISTANCE), 2.0)
    if problem.objective == "energy":
        free = 1e4 / np.maximum(found.cost, 1e-9)
        return np.where(hit | broken, -severity, free)
    excess = found.peak - problem.limits.torque
    over = excess.max(axis=1)
    reduction = 1e3 * (problem.durations.sum() - found.cost)
    return np.where(hit | broken, -severity, np.where(over > 0, -np.abs(over), reduction))


Reward = Callable[[PlanningProblem, BatchEvaluation], Float[Array, " B"]]
REWARDS: dict[str, Reward] = {"bounded": bounded_reward, "paper": paper_reward}
