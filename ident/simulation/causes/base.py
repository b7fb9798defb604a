"""A cause: what it does to the hardware, how large it may be, and how its visible amplitude is measured."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from ident.errors import InputError
from ident.simulation.hardware import Hardware
from ident.trajectories.reference import ReferenceMotion

View = Literal["refit", "loss", "raw"]
Parameters = dict[str, float | str]


@dataclass(frozen=True, eq=False)
class Circumstances:
    """Where a cause acts.

    Attributes:
        hardware: The arm before it.
        joint: Index of the joint; of an effect of the whole arm, the last.
        motions: What the arm is going to do.
        rng: Source of the cause's other parameters; the same for every size that is tried.
    """

    hardware: Hardware
    joint: int
    motions: Sequence[ReferenceMotion]
    rng: np.random.Generator

    @property
    def coulomb(self) -> float:
        """Dry friction of the joint [N m]."""
        return float(self.hardware.friction.coulomb[self.joint])

    @property
    def rated(self) -> float:
        """Rated torque of the joint [N m]."""
        return float(self.hardware.drive.effort_limit[self.joint])

    def with_laws(self, part: str, **values: Any) -> Hardware:
        """The hardware with some columns of a law changed at the joint."""
        return self.hardware.with_laws(part, self.joint, **values)

    @property
    def neighbour(self) -> int:
        """The joint before, or after the first."""
        return self.joint - 1 if self.joint > 0 else min(1, self.hardware.n - 1)

    def peak_torque(self) -> float:
        """Largest torque that the motions ask of the joint's drive, as far as is known beforehand [N m]."""
        h, j = self.hardware, self.joint
        peak = 0.0
        for motion in self.motions:
            q, dq, ddq = motion.q[::5], motion.dq[::5], motion.ddq[::5]
            torque = h.arm.inverse_dynamics(q, dq, ddq)[:, j] + h.drive.rotor_inertia[j] * ddq[:, j]
            torque += h.friction.viscous[j] * dq[:, j] + h.friction.coulomb[j] * np.sign(dq[:, j])
            peak = max(peak, float(np.abs(torque).max()))
        return peak


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong.

    Attributes:
        id: The catalogue's id, or one outside it.
        parameter: What its size is, by the contract's name with the unit.
        typical: A typical size.
        bounds: Smallest and largest size that physics or the session allows.
        apply: The hardware with it, and its true parameters.
        whole_arm: Whether it belongs to the arm, not to a joint.
        view: What a fit may absorb before the rest counts as visible: `refit`: link inertias, rotor, linear
            friction, bias; `loss`: rotor, linear friction, bias; `raw`: rotor, linear friction.
        inverse: Whether a smaller size shows more.
        beside: The hardware that it is compared with, if not the arm without it: play lies in a gear that also twists,
            and that twist is no play.
        needs_all: Whether its amplitude needs the whole session (a trend, one event), not a part of the runs.
    """

    id: str
    parameter: str
    typical: Callable[[Circumstances], float]
    bounds: Callable[[Circumstances], tuple[float, float]]
    apply: Callable[[Circumstances, float], tuple[Hardware, Parameters]]
    whole_arm: bool = False
    view: View = "refit"
    inverse: bool = False
    needs_all: bool = False
    beside: Callable[[Circumstances], Hardware] | None = None

    def checked(self, scene: Circumstances, size: float) -> float:
        """The size, if it is physical.

        Raises:
            InputError: It is not; the message tells the bounds.
        """
        low, high = self.bounds(scene)
        if not low <= size <= high:
            raise InputError(
                f"--effect {self.id}",
                f"{self.parameter} = {size:g} is outside physics",
                f"choose between {low:.4g} and {high:.4g}",
            )
        return size


def between(low: float, high: float) -> Callable[[Circumstances], tuple[float, float]]:
    """Bounds that do not depend on the arm."""
    return lambda _scene: (low, high)
