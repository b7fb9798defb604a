"""A chain of one-axis joints, its inverse dynamics, and one run as the laws see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of one-axis joints."""

    rotations: Array  # placement of each joint in the one before, shapes (n, 3, 3) and (n, 3) [m]
    offsets: Array
    axes: Array  # axis of each joint in its own frame, shape (n, 3)
    sliding: Array  # which joints are prismatic, shape (n,)
    # Ten numbers a link: m, m c, and inertia about the joint frame as xx, xy, yy, xz, yz, zz, shape
    # (n, 10).
    links: Array
    gravity: Array  # in the base frame [m/s²], shape (3,)
    gears: Array | None  # gear ratios, or None
    rated: Array  # rated torques [N m], shape (n,)

    def __post_init__(self) -> None:
        for name in ("rotations", "offsets", "axes", "links", "gravity", "rated"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))


def rigid_torque(
    arm: Arm,
    q: Array,
    dq: Array,
    ddq: Array,
    gravity: Array | None = None,
    links: Array | None = None,
) -> Array:
    """Inverse dynamics by the recursive Newton-Euler algorithm, all samples at once [N m].

    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3.
    """
    samples, n = q.shape
    links = arm.links if links is None else links
    omega = np.zeros((samples, 3))
    alpha = np.zeros((samples, 3))
    pull = arm.gravity if gravity is None else gravity
    acc = np.tile(-pull, (samples, 1))
    turns = []
    levers = []
    wrenches = []
    for i in range(n):
        axis = arm.axes[i]
        slides = bool(arm.sliding[i])
        angle = np.zeros(samples) if slides else q[:, i]
        turn = arm.rotations[i] @ rotation_about(axis, angle)
        lever = arm.offsets[i]
        if slides:
            lever = lever + turn @ axis * q[:, i, None]
        swept = np.cross(omega, np.cross(omega, lever))
        acc = acc + np.cross(alpha, lever) + swept
        omega = np.einsum("tji,tj->ti", turn, omega)
        alpha = np.einsum("tji,tj->ti", turn, alpha)
        acc = np.einsum("tji,tj->ti", turn, acc)
        speed = axis * dq[:, i, None]
        if slides:
            slid = axis * ddq[:, i, None]
            acc = acc + 2.0 * np.cross(omega, speed) + slid
        else:
            alpha = alpha + axis * ddq[:, i, None] + np.cross(omega, speed)
            omega = omega + speed
        turns.append(turn)
        levers.append(lever)
        wrenches.append(_wrench(links[i], omega, alpha, acc))
    torque = np.empty((samples, n))
    force = np.zeros((samples, 3))
    moment = np.zeros((samples, 3))
    for i in reversed(range(n)):
        force = force + wrenches[i][0]
        moment = moment + wrenches[i][1]
        driven = force if arm.sliding[i] else moment
        torque[:, i] = driven @ arm.axes[i]
        force = np.einsum("tij,tj->ti", turns[i], force)
        moment = np.einsum("tij,tj->ti", turns[i], moment) + np.cross(levers[i], force)
    return torque


def rotation_about(axis: Array, angle: Array) -> Array:
    """Rotations about one unit vector by many angles [rad], shape (T, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s = np.sin(angle)[:, None, None]
    c = np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def _wrench(link: Array, omega: Array, alpha: Array, acc: Array) -> tuple[Array, Array]:
    """Force and moment about the joint frame's origin that a link's motion takes [N, N m]."""
    mass = link[0]
    first = link[1:4]
    xx, xy, yy, xz, yz, zz = link[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    swept = np.cross(omega, np.cross(omega, first))
    force = mass * acc + np.cross(alpha, first) + swept
    gyration = np.cross(omega, omega @ inertia)
    moment = np.cross(first, acc) + alpha @ inertia + gyration
    return force, moment


def direction(dq: Array, width: Array) -> Array:
    """Direction of motion in [-1, 1]: tanh(dq / v₀), or sign(dq) where the width v₀ is zero."""
    width = np.asarray(width, dtype=float)
    smooth = np.tanh(dq / np.where(width > 0.0, width, 1.0))
    return np.where(width > 0.0, smooth, np.sign(dq))


@dataclass(frozen=True, eq=False)
class Losses:
    """Losses of n joints; arrays of shape (n,)."""

    motor_inertia: Array  # rotor inertia [kg m²]
    viscous: Array  # friction [N m s/rad], [N m]
    coulomb: Array
    # v₀, over which the sign of Coulomb friction turns round, tanh(dq / v₀) [rad/s]
    transition: Array
    # r, displacement over which it turns round instead, as a stop operator does; 0 for none [rad]
    range: Array
    # Of |v| v and v³, where friction that a file can't state is stood in for by a polynomial, shape
    # (n, 2).
    bend: Any = None

    def __post_init__(self) -> None:
        if self.bend is None:
            object.__setattr__(self, "bend", np.zeros((len(self.viscous), 2)))
        for name in ("motor_inertia", "viscous", "coulomb", "transition", "range", "bend"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))

    def direction(self, q: Array, dq: Array) -> Array:
        """Direction of sliding in [-1, 1] along a run, unstressed at first."""
        slip = np.tanh(dq / self.transition)
        for j in np.flatnonzero(self.range > 0.0):
            slip[:, j] = stop(q[:, j], float(self.range[j]))
        return slip

    def torque(self, dq: Array, ddq: Array, direction: Array) -> Array:
        """B ddq + (C + b₁ |dq| + b₂ dq²) dq + f s [N m]."""
        bent = self.bend[:, 0] * np.abs(dq)
        damping = self.viscous + bent + self.bend[:, 1] * dq**2
        return self.motor_inertia * ddq + damping * dq + self.coulomb * direction


def stop(q: Array, size: float) -> Array:
    """Stop operator along a path from rest, z⁺ = clip(z + Δq, −r, r), as a share of its range r."""
    out = np.empty(len(q))
    follow(q, size, out)
    return out / size


def follow(q: Array, size: float, out: Array) -> None:
    """States of a stop operator, sample by sample, into an array; plain loops, which can be
    compiled.

    Args:
        q: The path, shape (T,) [rad].
        size: The operator's range [rad].
        out: Gets the states, from −size to size, 0 at first, shape (T,) [rad].
    """
    state = 0.0
    out[0] = 0.0
    for k in range(1, len(q)):
        state = min(size, max(-size, state + q[k] - q[k - 1]))
        out[k] = state


@dataclass(frozen=True, eq=False)
class MovingArm:
    """One run as the laws see it."""

    arm: Arm  # the arm that moves
    losses: Losses
    q: Array  # states [rad, rad/s, rad/s²]
    dq: Array
    ddq: Array
    # sampling interval [s]; 0 for single states, of which laws with a memory know nothing
    interval: float = 0.0
    # direction of sliding in [-1, 1]; if None, as the losses have it along the run
    slip: Array | None = None
    # From 0 (coldest moment of the diagnosed session) to 1 (warmest); a number, shape (T,), or (T,
    # n) where joints differ.
    warmth: float | Array = 0.5

    @cached_property
    def direction(self) -> Array:
        """Direction of sliding in [-1, 1], shape (T, n).

        As given (`slip`); of single states tanh(dq / v) with the losses' transition v [rad/s]; else
        along the run, as the losses have it.
        """
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
        """How warm a joint is, from 0 (cold) to 1: one number, or one for each sample where
        `warmth` has so many.
        """
        warmth = np.asarray(self.warmth, dtype=float)
        return warmth[:, j] if warmth.ndim == 2 else warmth

    def at(self, j: int, torque: Array) -> Array:
        """A torque on one joint and none on the others, shape (T, n) [N m]."""
        whole = np.zeros_like(self.q)
        whole[:, j] = torque
        return whole

    def sampled(self, law: str) -> float:
        """The sampling interval, of which laws with a memory make use [s].

        Raises:
            ValueError: There is none, or no whole run; names the law that asks.
        """
        if self.interval <= 0.0 or len(self.q) < 3:
            raise ValueError(f"{law} remembers: give a whole run, evenly sampled, and its interval")
        return self.interval
