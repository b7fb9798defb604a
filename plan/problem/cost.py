"""What a plan costs: the one place for it, of candidates, plans, curves over duration and cycles.

    cost = T          where time is the objective,
    cost = E + P T    where energy is,

with the duration T [s], the energy E [J] by the metric that was asked for, and the power P [W] that
the cell takes all the while, its standby.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from ident.arrays import Array, Float

Figure = TypeVar("Figure", float, Float[Array, " B"])


def energy_cost(energy: Figure, duration: Figure, standby: float) -> Figure:
    """Energy of a motion, and what the cell takes meanwhile: E + P T [J].

    Args:
        energy: Of the motion, or of each of a batch [J].
        duration: How long it lasts [s].
        standby: Power that the cell takes all the while [W].
    """
    return energy + standby * duration


def plan_cost(
    objective: str, duration: Figure, energy: Callable[[], Figure], standby: float = 0.0
) -> Figure:
    """Duration [s] where time is the objective, else the cost of its energy [J].

    Args:
        objective: `energy` or `time`.
        duration: How long a motion lasts, or each of a batch [s].
        energy: Gives the energy [J]; asked for only where it counts.
        standby: Power that the cell takes all the while [W].
    """
    if objective == "time":
        return duration
    return energy_cost(energy(), duration, standby)
