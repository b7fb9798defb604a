"""Where a plan leaves the states that its model was fitted on, and limits that keep it inside."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.model.training_range import QUANTITIES, UNITS, TrainingRange
from ident.records import Record
from plan.problem.problem import Limits, PlanningProblem
from plan.spline import Splines

# Places of a section at which speeds are looked at.
PLACES = 65
# What is beyond by a smaller share of the range than this is rounding.
NOTHING = 1e-6


@dataclass(frozen=True)
class Extrapolation(Record):
    """One quantity of one joint that a plan takes beyond the model's training."""

    joint: str  # of what
    quantity: str
    unit: str
    low: float  # bounds of the training
    high: float
    reached: float  # the worse of the plan's own bounds
    share: float  # how far it lies outside, as a share of the range's width

    def __str__(self) -> str:
        bounds = f"trained from {self.low:.3g} to {self.high:.3g}"
        return f"{self.quantity} of {self.joint} reaches {self.reached:.3g} {self.unit}, {bounds}"


def find_extrapolation(problem: PlanningProblem, splines: Splines) -> tuple[Extrapolation, ...] | None:
    """What the first of a batch of plans takes beyond the training, the worst first; None where no range is known."""
    known = problem.trained
    if known is None:
        return None
    if float(splines.total[0]) > 0.0:
        _, dq, ddq = (part[0] for part in splines.states(np.linspace(0.0, 1.0, PLACES)))
        low = np.stack([splines.lowest[0], dq.min(axis=0), ddq.min(axis=0)])
        high = np.stack([splines.highest[0], dq.max(axis=0), ddq.max(axis=0)])
    else:
        low = high = np.stack([splines.points[0, 0], *np.zeros((2, problem.n))])
    held = np.zeros((3, len(known.joints) - problem.n))
    held[0] = [problem.scene.arm.locked_joints.get(name, 0.0) for name in known.joints[problem.n :]]
    low, high = (np.concatenate([part, held], axis=1) for part in (low, high))
    beyond = known.beyond(low, high)
    found = []
    for k, j in zip(*np.nonzero(beyond > NOTHING), strict=True):
        below, above = known.low[k, j] - low[k, j], high[k, j] - known.high[k, j]
        reached = low[k, j] if below > above else high[k, j]
        bounds = float(known.low[k, j]), float(known.high[k, j])
        share = float(beyond[k, j])
        found.append(Extrapolation(known.joints[j], QUANTITIES[k], UNITS[k], *bounds, float(reached), share))
    return tuple(sorted(found, key=lambda one: -one.share))


def stay_inside(limits: Limits, known: TrainingRange) -> Limits:
    """Limits that let nothing pass which the training did not see."""
    n = len(limits.lower)
    own = known.first(n)
    speed, acceleration = (np.minimum(-own.low[k], own.high[k]) for k in (1, 2))
    return replace(
        limits,
        lower=np.maximum(limits.lower, own.low[0]),
        upper=np.minimum(limits.upper, own.high[0]),
        speed=np.minimum(limits.speed, np.maximum(speed, 1e-6)),
        acceleration=np.minimum(
            np.inf if limits.acceleration is None else limits.acceleration, np.maximum(acceleration, 1e-6)
        ),
    )


def require_inside(problem: PlanningProblem, source: Path) -> None:
    """Raises InputError where start or goal themselves lie beyond the training."""
    known = problem.trained
    assert known is not None
    for name, q in (("start", problem.start), ("goal", problem.goal)):
        outside = np.flatnonzero((q < known.low[0, : problem.n]) | (q > known.high[0, : problem.n]))
        if len(outside):
            j = int(outside[0])
            low, high = np.degrees(known.low[0, j]), np.degrees(known.high[0, j])
            raise InputError(
                source,
                f"the {name}'s {problem.scene.arm.joint_names[j]}, {np.degrees(q[j]):.1f} deg, lies beyond the model's "
                f"training ({low:.1f} to {high:.1f} deg)",
                "move it, fit a model to recordings from there, or leave out --stay-inside",
            )
