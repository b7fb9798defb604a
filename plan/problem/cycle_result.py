"""CycleResult: what a cycle's motions are, how long it takes and what it costs; `plan.cycle/1`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

from ident.results import Result
from plan.problem.cost import energy_cost
from plan.problem.problem import PlanningProblem
from plan.problem.result import PlanResult
from plan.problem.stops import Stop
from plan.problem.task_file import Task

SCHEMA = "plan.cycle/1"


@dataclass(frozen=True, eq=False)
class Leg:
    """One motion of a cycle."""

    plan: PlanResult  # the motion and its certificate
    # Largest torque at any slower pace, as a share of its limit; None without a plan.
    slowed_torque_share: float | None
    check_seconds: float = 0.0  # what a check in full takes [s]


@dataclass(frozen=True, eq=False)
class CycleResult(Result):
    """Outcome of planning a cycle."""

    SHOWN_BY = "plan.show.results"

    status: Literal["solved", "infeasible"]
    objective: str
    robot: str  # name of the arm and of the joints that move
    joints: tuple[str, ...]
    legs: tuple[Leg, ...]  # its motions, in turn
    stops: tuple[Stop, ...]  # where it stops between them
    standby: float  # power that the cell takes all the while [W]
    # Energy of all motions as shared out on their curves, and where each takes the same multiple of
    # its shortest duration, as plans made one by one would [J]; None where time is the objective.
    shared: float | None
    even: float | None
    reason: str = ""  # why there is no plan; empty where there is one

    @classmethod
    def of(
        cls,
        task: Task,
        problem: PlanningProblem,
        legs: Sequence[Leg],
        shared: float | None,
        even: float | None,
        reason: str = "",
    ) -> CycleResult:
        """From the motions that were planned; solved where all of them are.

        Args:
            task: What the file says.
            problem: Any of its motions: all are of one arm.
            legs: Its motions in turn; none where nothing was searched.
            shared: Energy as shared out on the motions' curves [J].
            even: The same where each takes the same multiple of its shortest duration [J].
            reason: Why there is no plan; left empty, the first motion without one says so.
        """
        arm = problem.scene.arm
        for number, leg in enumerate(legs, start=1):
            if reason:
                break
            if not leg.plan.solved:
                reason = f"leg {number}: {leg.plan.reason}"
            elif leg.slowed_torque_share is not None and leg.slowed_torque_share > 1.0:
                percent = 100.0 * leg.slowed_torque_share
                reason = f"leg {number}: slowed down it takes {percent:.1f} % of a joint's torque"
        status: Literal["solved", "infeasible"] = "infeasible" if reason else "solved"
        return cls(
            status,
            problem.objective,
            arm.name,
            arm.joint_names,
            tuple(legs),
            task.stops,
            task.standby,
            shared,
            even,
            reason,
        )

    @property
    def solved(self) -> bool:
        """Whether all motions are certified."""
        return self.status == "solved"

    @property
    def moving(self) -> float:
        """How long the arm moves [s]."""
        motions = [leg.plan.splines for leg in self.legs if leg.plan.splines is not None]
        return float(sum(splines.total[0] for splines in motions))

    @property
    def dwelling(self) -> float:
        """How long it stands at its stops [s]."""
        return float(sum(stop.dwell for stop in self.stops))

    @property
    def duration(self) -> float:
        """Time that the whole cycle takes, stops included [s]."""
        return self.moving + self.dwelling

    @property
    def energy(self) -> float:
        """Energy of all motions by their metric and of the standby [J]; infinite without a plan."""
        if not self.solved:
            return float("inf")
        moved = 0.0
        for leg in self.legs:
            assert leg.plan.certificate is not None
            moved += leg.plan.certificate.energy[leg.plan.metric]
        return energy_cost(moved, self.duration, self.standby)

    def to_dict(self) -> dict[str, Any]:
        """The record of `plan.cycle/1`."""
        stops = [
            {"q_rad": stop.q.tolist(), "dwell_s": stop.dwell, "does": stop.does}
            for stop in self.stops
        ]
        motions = [
            {**leg.plan.to_dict(), "slowed_torque_share": leg.slowed_torque_share}
            for leg in self.legs
        ]
        return {
            "schema": SCHEMA,
            "status": self.status,
            "reason": self.reason,
            "objective": self.objective,
            "robot": self.robot,
            "joints": list(self.joints),
            "duration_s": self.duration if self.solved else None,
            "moving_s": self.moving if self.solved else None,
            "dwell_s": self.dwelling,
            "standby_W": self.standby,
            "cost_J": self.energy if self.solved else None,
            "energy_on_curves_J": {"shared_out": self.shared, "one_by_one": self.even},
            "stops": stops,
            "legs": motions,
            "provenance": self.provenance.to_dict(),
        }
