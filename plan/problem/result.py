"""PlanResult: a plan that certifies itself, and `plan.result/1`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal, Required, TypedDict

import numpy as np

from ident.arrays import Array, Float
from ident.records import as_record
from ident.results import Result
from plan.dynamics.power import METRICS, Metric
from plan.problem.certificate import Certificate
from plan.problem.cost import energy_cost, plan_cost
from plan.problem.extrapolation import Extrapolation
from plan.problem.ramps import STANDING, TimeLaw
from plan.spline import Splines

SCHEMA = "plan.result/1"
Status = Literal["solved", "infeasible", "budget_spent"]
# What of a result stands in its record as it is, before and behind what the motion is.
HEAD = ("status", "reason", "robot", "joints", "held", "carried", "method", "objective", "metric")
REST = (
    "evaluations",
    "seconds",
    "cpu_seconds",
    "seed",
    "bound",
    "reference_gap",
    "starts",
    "notes",
    "provenance",
)


class StartRecord(TypedDict, total=False):
    """What became of an initial trajectory; what was never known is missing."""

    label: Required[str]
    reason: Required[str]  # why it failed, or was left out; "" where neither
    target_m: list[float]  # where it was to lead the tool [m]
    via_points_rad: list[list[float]]
    initial_via_points_rad: list[list[float]]  # as the search began from it
    cost: float | None  # that it reached; None where it did not become feasible
    violation: float


@dataclass(frozen=True, eq=False)
class PlanResult(Result):
    """Outcome of one planning task."""

    SHOWN_BY = "plan.show.results"

    status: Status  # `solved`, `infeasible` or `budget_spent`
    method: str  # what was asked for
    objective: str
    metric: Metric
    seed: int
    reason: str = ""  # why there is no plan; empty where there is one
    splines: Splines | None = None  # the motion, a batch of one; None without
    certificate: Certificate | None = None  # what the motion was found to be
    evaluations: int = 0  # what was spent; processor time is that of the process alone
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    # What no motion's cost can undercut, whatever its path; None where none is known.
    bound: float | None = None
    # Cost above the default method's, as a share; None if that was not computed.
    reference_gap: float | None = None
    # One record an initial trajectory: label, via points, cost reached, reason where it failed.
    starts: tuple[StartRecord, ...] = ()
    # Evaluations, processor seconds and best cost, each time it fell.
    history: tuple[tuple[int, float, float], ...] = ()
    notes: tuple[str, ...] = ()  # remarks of the planner
    robot: str = ""  # name of the arm and of the joints that move
    joints: tuple[str, ...] = ()
    # Positions of the joints that stand still [rad or m].
    held: Mapping[str, float] = field(default_factory=dict)
    # What the arm carries, and the frame on which each of it hangs.
    carried: tuple[dict[str, object], ...] = ()
    standby: float = 0.0  # power that the cell takes all the while [W]
    # Where the duration was free: durations that were looked at [s], and the least energy found for
    # each [J].
    energy_curve: tuple[tuple[float, float], ...] = ()

    @property
    def stands(self) -> bool:
        """Whether the plan is one of zero length."""
        return self.splines is not None and float(self.splines.total[0]) <= 0.0

    @property
    def execution(self) -> TimeLaw:
        """How the motion is executed from rest to rest."""
        return STANDING if self.certificate is None else self.certificate.time_law

    def with_standby(self, power: float) -> PlanResult:
        """The same where the cell takes a power all the while, counted in costs found on the way.

        Args:
            power: What it takes [W].
        """
        if self.splines is None:
            return replace(self, standby=power)
        duration = float(self.splines.total[0])
        history = []
        for count, seconds, energy in self.history:
            history.append((count, seconds, energy_cost(energy, duration, power)))
        return replace(self, standby=power, history=tuple(history))

    @property
    def solved(self) -> bool:
        """Whether there is a certified plan."""
        return self.status == "solved"

    @property
    def cost(self) -> float:
        """Energy by the metric, and of the cell's standby [J], or duration [s].

        Infinite without a plan.
        """
        if self.certificate is None or self.splines is None or not self.solved:
            return float("inf")
        energies = self.certificate.energy
        duration = float(self.splines.total[0])
        return plan_cost(self.objective, duration, lambda: energies[self.metric], self.standby)

    @property
    def executed_cost(self) -> float:
        """Cost of the motion as a controller executes it, from rest to rest, in `cost`'s unit.

        Infinite without a plan.
        """
        if not self.solved:
            return float("inf")
        duration = self.execution.duration
        energies = dict(self.execution.energy)
        if self.objective != "time" and self.metric not in energies:
            return self.cost
        return plan_cost(self.objective, duration, lambda: energies[self.metric], self.standby)

    def to_dict(self) -> dict[str, object]:
        """The record of `plan.result/1`; lengths in m, angles in rad."""
        names = ("duration_s", "energy_J")
        curve = [dict(zip(names, row, strict=True)) for row in self.energy_curve]
        return {
            "schema": SCHEMA,
            **self._fields(HEAD),
            **self._motion(),
            "standby_W": self.standby,
            "energy_curve": curve,
            **self._fields(REST),
            "history": [list(row) for row in self.history if np.isfinite(row[2])],
        }

    def _fields(self, names: tuple[str, ...]) -> dict[str, object]:
        return {name: as_record(getattr(self, name)) for name in names}

    def _motion(self) -> dict[str, object]:
        """What the record says of the motion; nothing without one."""
        certificate = self.certificate
        splines = self.splines
        if splines is None or certificate is None:
            return {}
        energy = dict(certificate.energy)
        copper = energy.pop("copper")
        closest = certificate.closest
        points = splines.points[0]
        acceleration = jerk = np.zeros(points.shape[1])
        if not self.stands:
            acceleration = splines.top_acceleration[0]
            jerk = splines.top_jerk[0]
        controller = certificate.controller
        reserve = certificate.reserve
        return {
            "energy_J": {metric: energy[metric] for metric in METRICS if metric in energy},
            "copper_N2m2s": copper,
            "duration_s": float(splines.total[0]),
            "peak_torque_share": certificate.torque_share.tolist(),
            "peak_speed_share": certificate.speed_share.tolist(),
            "limits": _largest(certificate.shares),
            "peak_acceleration_rad_s2": acceleration.tolist(),
            "peak_jerk_rad_s3": jerk.tolist(),
            "execution": certificate.time_law.to_dict(),
            "controller": None if controller is None else controller.name,
            "extrapolation": _worst_share(certificate.extrapolation),
            "beyond_training": as_record(certificate.extrapolation or ()),
            "torque_reserve_Nm": None if reserve is None else reserve.tolist(),
            "energy_half_width_J": certificate.energy_half_width,
            "collision_free": closest.collision_free,
            "clearance_m": closest.proven if closest.checks else None,
            "closest": {"pair": closest.pair, "time_s": closest.time},
            "asked_clearance_m": certificate.asked_clearance,
            "clearance_cuts": [
                {**cut.to_dict(), "proven_m": clearance.proven}
                for cut, clearance in certificate.cuts
            ],
            "rules": as_record(certificate.rules),
            "coarser_obstacles": list(certificate.scene.coarser),
            **certificate.scene.to_dict(),
            "start_rad": points[0].tolist(),
            "goal_rad": points[-1].tolist(),
            "via_points_rad": points[1:-1].tolist(),
            "times_s": np.cumsum(splines.durations[0])[:-1].tolist(),
        }


def _largest(shares: Mapping[str, Float[Array, " n"] | None]) -> dict[str, float | None]:
    """The largest of the joints' shares of each limit; None without a limit."""
    largest: dict[str, float | None] = {}
    for name, values in shares.items():
        largest[name] = None if values is None else float(values.max())
    return largest


def _worst_share(extrapolation: tuple[Extrapolation, ...] | None) -> float | None:
    """How far the worst quantity lies outside the training, as a share of its range's width."""
    if extrapolation is None:
        return None
    return max((quantity.share for quantity in extrapolation), default=0.0)
