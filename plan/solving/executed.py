"""A motion as it is executed: on its controller's step, checked densely; what it costs, and near
ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from plan.planners.base import Candidate
from plan.problem.certificate import Certificate, Shares, certify
from plan.problem.controllers import Controller
from plan.problem.cost import energy_cost
from plan.problem.problem import Limits, PlanningProblem
from plan.problem.ramps import find_time_law
from plan.spline import Splines


@dataclass(frozen=True, eq=False)
class Executed:
    """A motion as it is executed, and its dense check."""

    # As the search counts it: energy [J], where the duration is free with the cell's standby, or
    # duration [s].
    cost: float
    splines: Splines
    certificate: Certificate

    @property
    def allowed(self) -> bool:
        """Whether it breaks nothing."""
        return not self.certificate.broken


def cost_of(problem: PlanningProblem, splines: Splines) -> float:
    """What a motion costs by the search's own count: energy [J] or duration [s]."""
    if problem.objective == "time":
        return float(splines.total[0])
    return float(problem.initial_evaluation.cost[0])


def price_of(candidate: Candidate) -> float:
    """What a candidate costs, the cell's standby counted, so that durations can be compared."""
    problem = candidate.problem
    if problem.objective == "time" or problem.longest is None:
        return candidate.cost
    return energy_cost(candidate.cost, float(candidate.splines.total[0]), problem.standby)


def is_short_enough(problem: PlanningProblem, splines: Splines) -> bool:
    """Whether a motion takes no longer than the task allows."""
    return problem.longest is None or float(splines.total[0]) <= problem.longest


def put_on_step(candidate: Candidate, controller: Controller | None) -> Splines:
    """A candidate's motion, on its controller's step if there is one."""
    splines = candidate.splines
    if controller is None:
        return splines
    return controller.put_on_step(splines, find_time_law(candidate.problem, splines))


def execute(candidate: Candidate, controller: Controller | None) -> Executed:
    """A candidate as it is executed, and its dense check."""
    splines = put_on_step(candidate, controller)
    return Executed(price_of(candidate), splines, certify(candidate.problem, splines, controller))


def with_limits(candidate: Candidate, limits: Limits) -> Candidate:
    """A candidate that was searched within tighter limits, as one of the task's own."""
    return replace(candidate, problem=replace(candidate.problem, limits=limits))


def with_knots_on_step(splines: Splines, controller: Controller, whole: float) -> Splines:
    """The same way in another duration, its knots where the controller takes points.

    Args:
        splines: The motion.
        controller: Who executes it.
        whole: The duration, one that the controller can be told [s].
    """
    total = float(splines.total[0])
    knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])]) / total
    shares = controller.knots_on_step(knots, whole)
    points = splines.at(shares * total)[0]
    points[0] = splines.points[0, 0]
    points[-1] = splines.points[0, -1]
    return Splines(points[None], np.diff(shares * whole)[None])


def tighter(
    limits: Limits,
    seen: Shares,
    slack: float,
    clearance: float = 0.0,
    alike: bool = False,
) -> Limits:
    """Limits lower by what was seen above them, and a little more.

    Args:
        limits: Those of a search.
        seen: Peaks of what it found, as shares of these.
        slack: By how much more, as a factor.
        clearance: By how much more clearance is asked for [m].
        alike: Whether each joint's are lower by what was seen at the joint that passed most.
    """

    lower = {}
    for name, share in seen.items():
        limit = getattr(limits, name)
        if limit is not None and share is not None:
            passed = np.maximum(share * slack, 1.0)
            lower[name] = limit / (passed.max() if alike else passed)
    return replace(limits, **lower, clearance=limits.clearance + clearance)
