"""One run as the laws see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ident.laws.chain import Arm, Array, rigid_torque


def direction(dq: Array, width: Array) -> Array:
    """Direction of motion in [-1, 1]: tanh(dq / v₀), or sign(dq) where the width v₀ is zero."""
    width = np.asarray(width, dtype=float)
    return np.where(width > 0.0, np.tanh(dq / np.where(width > 0.0, width, 1.0)), np.sign(dq))


@dataclass(frozen=True, eq=False)
class Losses:
    """Losses of n joints; arrays of shape (n,).

    Attributes:
        motor_inertia: Rotor inertia [kg m²].
        viscous, coulomb: Friction [N m s/rad], [N m].
        transition: v₀, over which the sign of Coulomb friction turns round, tanh(dq / v₀) [rad/s].
        range: r, displacement over which it turns round instead, as a stop operator does; 0 for none [rad].
    """

    motor_inertia: Array
    viscous: Array
    coulomb: Array
    transition: Array
    range: Array

    def __post_init__(self) -> None:
        for name in ("motor_inertia", "viscous", "coulomb", "transition", "range"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))

    def direction(self, q: Array, dq: Array) -> Array:
        """Direction of sliding in [-1, 1] along a run, unstressed at first."""
        slip = np.tanh(dq / self.transition)
        for j in np.flatnonzero(self.range > 0.0):
            slip[:, j] = stop(q[:, j], float(self.range[j]))
        return slip

    def torque(self, dq: Array, ddq: Array, direction: Array) -> Array:
        """B ddq + C dq + f s [N m]."""
        return self.motor_inertia * ddq + self.viscous * dq + self.coulomb * direction


def stop(q: Array, size: float) -> Array:
    """Stop operator along a path from rest, z⁺ = clip(z + Δq, −r, r), as a share of its range r."""
    out = np.empty(len(q))
    follow(q, size, out)
    return out / size


def follow(q: Array, size: float, out: Array) -> None:
    """States of a stop operator, sample by sample, into an array; plain loops, which can be compiled."""
    state = 0.0
    out[0] = 0.0
    for k in range(1, len(q)):
        state = min(size, max(-size, state + q[k] - q[k - 1]))
        out[k] = state


@dataclass(frozen=True, eq=False)
class MovingArm:
    """One run as the laws see it.

    Attributes:
        arm, losses: The arm that moves.
        q, dq, ddq: States [rad, rad/s, rad/s²].
        interval: Sampling interval [s]; 0 for single states, of which laws with a memory know nothing.
        slip: Direction of sliding in [-1, 1]; if None, as the losses have it along the run.
        warmth: From 0 (coldest moment of the diagnosed session) to 1 (warmest); a number, shape (T,), or (T, n) where
            joints differ.
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
        if self.slip is not None:
            return np.asarray(self.slip, dtype=float)
        if self.interval <= 0.0:
            return np.tanh(self.dq / self.losses.transition)
        return self.losses.direction(self.q, self.dq)

    @cached_property
    def rigid(self) -> Array:
        """Rigid torque; without rotor and friction it is also the load of the gears [N m]."""
        return rigid_torque(self.arm, self.q, self.dq, self.ddq)

    def warmth_of(self, j: int) -> Array:
        """How warm a joint is."""
        warmth = np.asarray(self.warmth, dtype=float)
        return warmth[:, j] if warmth.ndim == 2 else warmth

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
