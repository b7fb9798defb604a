"""A cause: what it does to the hardware, how large it may be, and how its visible amplitude is measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from ident.simulation.hardware import Hardware
from ident.trajectories.reference import ReferenceMotion

View = Literal["refit", "loss", "raw"]
Parameters = dict[str, float | str]
# A number, or a share of what the joint has, as of `Circumstances.size_of`.
Size = float | str


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Where a cause acts."""

    hardware: Hardware  # the arm before it
    joint: int  # index of the joint; of an effect of the whole arm, the last
    motions: Sequence[ReferenceMotion]  # what the arm is going to do
    rng: np.random.Generator  # source of the cause's other parameters; the same for every size that is tried

    @property
    def coulomb(self) -> float:
        """Dry friction of the joint [N m]."""
        return float(self.hardware.friction.coulomb[self.joint])

    @property
    def rated(self) -> float:
        """Rated torque of the joint [N m]."""
        return float(self.hardware.drive.effort_limit[self.joint])

    @property
    def peak(self) -> float:
        """Largest torque that the motions ask of the joint's drive, as far as is known beforehand [N m]."""
        h, j = self.hardware, self.joint
        peak = 0.0
        for motion in self.motions:
            q, dq, ddq = motion.q[::5], motion.dq[::5], motion.ddq[::5]
            torque = h.arm.inverse_dynamics(q, dq, ddq)[:, j] + h.drive.rotor_inertia[j] * ddq[:, j]
            torque += h.friction.viscous[j] * dq[:, j] + h.friction.coulomb[j] * np.sign(dq[:, j])
            peak = max(peak, float(np.abs(torque).max()))
        return peak

    @property
    def reach(self) -> float:
        """Rough length of the arm [m]."""
        return length_of(self.hardware.arm.model)

    @property
    def lift(self) -> float:
        """Mass that the strongest joint can hold at the stretched arm's end [kg]."""
        return float(self.hardware.drive.effort_limit.max()) / (9.81 * self.reach)

    @property
    def run(self) -> float:
        """Duration of the shortest run [s]."""
        return min(motion.duration for motion in self.motions)

    @property
    def neighbour(self) -> int:
        """The joint before, or after the first."""
        return self.joint - 1 if self.joint > 0 else min(1, self.hardware.n - 1)

    def with_laws(self, part: str, **values: Any) -> Hardware:
        """The hardware with some columns of a law changed at the joint."""
        return self.hardware.with_laws(part, self.joint, **values)

    def size_of(self, size: Size) -> float:
        """A number, or a share of a property here: "0.3 coulomb", "2 rated"."""
        if not isinstance(size, str):
            return size
        share, of = size.split()
        return float(float(share) * getattr(self, of))


def length_of(model: pin.Model) -> float:
    """Rough length of an arm [m]."""
    return float(sum(np.linalg.norm(one.translation) for one in list(model.jointPlacements)[1:])) + 1e-3
