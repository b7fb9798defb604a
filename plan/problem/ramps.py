"""When an executed plan is where.

Its ramps, by how much it is slowed down for them, and the limits checked on it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ident.arrays import Array, Float
from ident.trajectories.gentle_ends import RAMP_SHARE, GentleEnds
from plan.dynamics.power import Metric, power_integrals
from plan.problem.problem import PlanningProblem
from plan.spline import Splines

# Time in which an executed motion gets going, and comes to rest: at most this [s]. A motion with
# less acceleration at its ends needs none [rad/s²].
RAMP_S = 0.05
AT_REST = 0.5
# Places at which an executed motion is looked at.
PLACES = 4001
# Most by which a motion is slowed down for its ramps, and how closely that is found.
SLOWEST = 1.5
CLOSELY = 1e-4


@dataclass(frozen=True)
class TimeLaw:
    """How a plan is executed."""

    planned: float  # duration of the plan [s]
    ramp: float = 0.0  # time in which acceleration gets going, and ends [s]
    # Factor by which the plan is slowed down, so that its ramps keep the limits.
    stretch: float = 1.0
    # Largest torque, speed and acceleration as shares of their limits; acceleration 0 where there
    # is none.
    shares: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # Energy of the execution by every metric, as a plan's own [J]; empty for a plan of zero length.
    energy: tuple[tuple[Metric, float], ...] = ()
    travel: tuple[float, ...] = ()  # way of each joint there and back, in sum [rad]; empty likewise

    @property
    def duration(self) -> float:
        """Duration of the execution [s]."""
        return self._ends.duration

    @cached_property
    def _ends(self) -> GentleEnds:
        return GentleEnds(self.planned * self.stretch, self.ramp)

    def states(self, splines: Splines, times: Float[Array, " T"]) -> tuple[Array, Array, Array]:
        """Position, velocity and acceleration of the first of a batch of plans as it is executed.

        Args:
            splines: The plan.
            times: Since the execution began [s].

        Returns:
            (T, n) each [rad, rad/s, rad/s²]; of a plan without duration it stands at its first
            point.
        """
        if self.planned <= 0.0:
            q = np.repeat(splines.points[0, :1], len(times), axis=0)
            return q, np.zeros_like(q), np.zeros_like(q)
        s, ds, dds = self._ends.at(times)
        q, dq, ddq = Splines(splines.points, splines.durations * self.stretch).at(s)
        return q, dq * ds[:, None], ddq * ds[:, None] ** 2 + dq * dds[:, None]

    def to_dict(self) -> dict[str, float]:
        """Its part of a result's record.

        Returns:
            "ramp_s", "stretch", "duration_s", "torque_share", "speed_share", "acceleration_share",
            and energies as "METRIC_J" without copper's.
        """
        names = ("torque", "speed", "acceleration")
        shares = {f"{name}_share": share for name, share in zip(names, self.shares, strict=True)}
        energy = {f"{metric}_J": value for metric, value in self.energy if metric != "copper"}
        return {
            "ramp_s": self.ramp,
            "stretch": self.stretch,
            "duration_s": self.duration,
            **shares,
            **energy,
        }


# Of a plan of zero length.
STANDING = TimeLaw(0.0)


def find_time_law(problem: PlanningProblem, splines: Splines) -> TimeLaw:
    """The quickest execution of a plan that keeps the limits.

    A plan that breaks them itself is not mended here.
    """
    total = float(splines.total[0])
    eager = float(splines.end_acceleration.max()) > AT_REST
    law = TimeLaw(total, min(RAMP_S, RAMP_SHARE * total) if eager else 0.0)
    law = measure(problem, splines, law)
    if law.ramp <= 0.0 or max(law.shares) <= 1.0:
        return law
    slowest = measure(problem, splines, replace(law, stretch=SLOWEST))
    if max(slowest.shares) > 1.0:
        return law
    low = 1.0
    best = slowest
    while best.stretch - low > CLOSELY:
        tried = measure(problem, splines, replace(law, stretch=0.5 * (low + best.stretch)))
        low, best = (low, tried) if max(tried.shares) <= 1.0 else (tried.stretch, best)
    return best


def measure(problem: PlanningProblem, splines: Splines, law: TimeLaw) -> TimeLaw:
    """The same law with what the plan takes by it: shares of the limits, energy, travel.

    Args:
        problem: Limits and model.
        splines: The plan, a batch of one.
        law: Its ramp and stretch are used.
    """
    limits = problem.limits
    q, dq, ddq = law.states(splines, np.linspace(0.0, law.duration, PLACES))
    tau = problem.model.torque(q[None], dq[None], ddq[None])
    torque = float((np.abs(tau[0]) / limits.torque).max())
    acceleration = (
        0.0 if limits.acceleration is None else float((np.abs(ddq) / limits.acceleration).max())
    )
    # At rest at both ends: their halves are nought.
    weights = np.full((1, PLACES), law.duration / (PLACES - 1))
    energy = tuple(power_integrals(tau, dq[None], weights).items())
    travel = tuple((weights[0] @ np.abs(dq)).tolist())
    shares = (torque, float((np.abs(dq) / limits.speed).max()), acceleration)
    return replace(law, shares=shares, energy=energy, travel=travel)
