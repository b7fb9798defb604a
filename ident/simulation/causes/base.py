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


# The hardware with a cause of a size, and what is true then.
Apply = Callable[[Circumstances, float], tuple[Hardware, Parameters]]


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong."""

    id: str  # the catalogue's id, or one outside it
    parameter: str  # what its size is, by the contract's name with the unit
    typical: Callable[[Circumstances], float]  # a typical size
    bounds: Callable[[Circumstances], tuple[float, float]]  # smallest and largest size that physics or motion allows
    apply: Apply  # the hardware with it, and what is true
    whole_arm: bool = False  # whether it belongs to the arm, not to a joint
    # What a fit may absorb before the rest counts as visible: rotor and linear friction in all views; beside these,
    # bias in `loss`; bias and link inertias in `refit`.
    view: View = "refit"
    inverse: bool = False  # whether a smaller size shows more
    needs_all: bool = False  # whether its amplitude needs the whole session (a trend, one event), not some of the runs
    # The hardware that it is compared with, if not the arm without it: play lies in a gear that also twists.
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


Drawn = Callable[[np.random.Generator], float]


def uniform(low: float, high: float) -> Drawn:
    return lambda rng: float(rng.uniform(low, high))


def log_uniform(low: float, high: float) -> Drawn:
    return lambda rng: float(np.exp(rng.uniform(np.log(low), np.log(high))))


def setting(part: str, column: str, parameter: str, **drawn: tuple[str, Drawn]) -> Apply:
    """A cause that sets one column of a law to its size, and others to what is drawn for them.

    Args:
        part: The law, as of `Hardware.with_laws`.
        column, parameter: Where the size stands, and its name among the true parameters.
        **drawn: By column, the name of what is drawn and its distribution.
    """

    def apply(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
        values = {name: draw(scene.rng) for name, (_, draw) in drawn.items()}
        true = {drawn[name][0]: value for name, value in values.items()}
        return scene.with_laws(part, **{column: size}, **values), {parameter: size, **true}

    return apply


def reading(column: str, parameter: str, offset: float = 0.0) -> Apply:
    """A cause that sets one column of a joint's sensors to its size, counted from a healthy sensor's value."""

    def apply(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
        sensing = scene.hardware.sensing.set(scene.joint, **{column: offset + size})
        return scene.hardware.replace(sensing=sensing), {parameter: size}

    return apply


def between(low: float, high: float) -> Callable[[Circumstances], tuple[float, float]]:
    """Bounds that do not depend on the arm."""
    return lambda _scene: (low, high)
