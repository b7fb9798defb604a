"""What a plan takes beyond what its model was trained on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.model.training_range import QUANTITIES, UNITS, TrainingRange
from ident.records import Record
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Places of a section at which speeds are looked at.
PLACES = 65
# Less than this share of the range beyond it is rounding.
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


def find_extrapolation(
    problem: PlanningProblem, splines: Splines
) -> tuple[Extrapolation, ...] | None:
    """What the first of a batch of plans takes beyond the training, the worst first.

    None where no range is known.

    Returns:
        One a joint and quantity; empty where nothing is left.
    """
    known = problem.trained
    if known is None:
        return None
    low, high = _reached(problem, splines, known)
    beyond = known.beyond(low, high)
    extrapolations = []
    for quantity, joint in zip(*np.nonzero(beyond > NOTHING), strict=True):
        place = (quantity, joint)
        below = known.low[place] - low[place]
        above = high[place] - known.high[place]
        reached = low[place] if below > above else high[place]
        extrapolations.append(
            Extrapolation(
                joint=known.joints[joint],
                quantity=QUANTITIES[quantity],
                unit=UNITS[quantity],
                low=float(known.low[place]),
                high=float(known.high[place]),
                reached=float(reached),
                share=float(beyond[place]),
            )
        )
    return tuple(sorted(extrapolations, key=lambda extrapolation: -extrapolation.share))


def _reached(
    problem: PlanningProblem, splines: Splines, known: TrainingRange
) -> tuple[Float[Array, "3 N"], Float[Array, "3 N"]]:
    """Least and largest position, speed and acceleration of the N joints that were trained.

    Joints that stand still are the last of them.
    """
    if float(splines.total[0]) > 0.0:
        _, speeds, accelerations = splines.states(np.linspace(0.0, 1.0, PLACES))
        dq = speeds[0]
        ddq = accelerations[0]
        low = np.stack([splines.lowest[0], dq.min(axis=0), ddq.min(axis=0)])
        high = np.stack([splines.highest[0], dq.max(axis=0), ddq.max(axis=0)])
    else:
        still = np.zeros((2, problem.n))
        low = np.stack([splines.points[0, 0], *still])
        high = low
    names = known.joints[problem.n :]
    held = np.zeros((3, len(names)))
    held[0] = [problem.scene.arm.locked_joints.get(name, 0.0) for name in names]
    return np.concatenate([low, held], axis=1), np.concatenate([high, held], axis=1)
