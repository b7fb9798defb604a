"""One run as the laws see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ident.patch.standalone.chain import Arm, Array, rigid_torque


@dataclass(frozen=True, eq=False)
class Losses:
    """Rotor inertia [kg m²], viscous [N m s/rad] and Coulomb friction [N m], width of its sign [rad/s]; each (n,)."""

    motor_inertia: Array
    viscous: Array
    coulomb: Array
    transition: Array

    def __post_init__(self) -> None:
        for name in ("motor_inertia", "viscous", "coulomb", "transition"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))

    def torque(self, dq: Array, ddq: Array, direction: Array) -> Array:
        """B ddq + C dq + f s [N m]."""
        return self.motor_inertia * ddq + self.viscous * dq + self.coulomb * direction


@dataclass(frozen=True, eq=False)
class Motion:
    """One run as the laws see it.

    Attributes:
        arm, losses: The arm that moves.
        q, dq, ddq: States [rad, rad/s, rad/s²].
        interval: Sampling interval [s]; 0 for single states, of which laws with a memory know nothing.
        slip: Direction of sliding in [-1, 1]; tanh(dq / v₀) if None.
        warmth: From 0 (coldest moment of the diagnosed session) to 1 (warmest); a number or shape (T,).
    """

    arm: Arm
    losses: Losses
    q: Array
    dq: Array
    ddq: Array
    interval: float = 0.0
    slip: Array | None = None
    warmth: Any = 0.5

    @cached_property
    def direction(self) -> Array:
        return np.tanh(self.dq / self.losses.transition) if self.slip is None else np.asarray(self.slip, dtype=float)

    @cached_property
    def rigid(self) -> Array:
        """Rigid torque; without rotor and friction it is also the load of the gears [N m]."""
        return rigid_torque(self.arm, self.q, self.dq, self.ddq)

    def at(self, j: int, torque: Array) -> Array:
        """A torque on one joint, none on the others."""
        whole = np.zeros_like(self.q)
        whole[:, j] = torque
        return whole

    def sampled(self, law: str) -> float:
        """The sampling interval, of which laws with a memory make use [s]."""
        if self.interval <= 0.0 or len(self.q) < 3:
            raise ValueError(f"{law} remembers: give a whole run, evenly sampled, and its interval")
        return self.interval
