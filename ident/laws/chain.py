"""A chain of one-axis joints, and its inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of one-axis joints.

    Attributes:
        rotations, offsets: Placement of each joint in the one before, shapes (n, 3, 3) and (n, 3) [m].
        axes: Axis of each joint in its own frame, shape (n, 3).
        sliding: Which joints are prismatic, shape (n,).
        links: Ten numbers a link: m, m c, and inertia about the joint frame as xx, xy, yy, xz, yz, zz, shape (n, 10).
        gravity: In the base frame [m/s²], shape (3,).
        gears: Gear ratios, or None.
        rated: Rated torques [N m], shape (n,).
    """

    rotations: Array
    offsets: Array
    axes: Array
    sliding: Array
    links: Array
    gravity: Array
    gears: Array | None
    rated: Array

    def __post_init__(self) -> None:
        for name in ("rotations", "offsets", "axes", "links", "gravity", "rated"):
            object.__setattr__(self, name, np.array(getattr(self, name), dtype=float))


def rigid_torque(
    arm: Arm, q: Array, dq: Array, ddq: Array, gravity: Array | None = None, links: Array | None = None
) -> Array:
    """Inverse dynamics by the recursive Newton-Euler algorithm, all samples at once [N m].

    Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3.
    """
    samples, n = q.shape
    links = arm.links if links is None else links
    omega, alpha = np.zeros((samples, 3)), np.zeros((samples, 3))
    acc = np.tile(-(arm.gravity if gravity is None else gravity), (samples, 1))
    turns, levers, wrenches = [], [], []
    for i in range(n):
        axis, slides = arm.axes[i], bool(arm.sliding[i])
        turn = arm.rotations[i] @ rotation_about(axis, np.zeros(samples) if slides else q[:, i])
        lever = arm.offsets[i] + (turn @ axis * q[:, i, None] if slides else 0.0)
        acc = acc + np.cross(alpha, lever) + np.cross(omega, np.cross(omega, lever))
        omega, alpha, acc = (np.einsum("tji,tj->ti", turn, vector) for vector in (omega, alpha, acc))
        speed = axis * dq[:, i, None]
        if slides:
            acc = acc + 2.0 * np.cross(omega, speed) + axis * ddq[:, i, None]
        else:
            alpha = alpha + axis * ddq[:, i, None] + np.cross(omega, speed)
            omega = omega + speed
        turns.append(turn)
        levers.append(lever)
        wrenches.append(_wrench(links[i], omega, alpha, acc))
    torque = np.empty((samples, n))
    force, moment = np.zeros((samples, 3)), np.zeros((samples, 3))
    for i in reversed(range(n)):
        force, moment = force + wrenches[i][0], moment + wrenches[i][1]
        torque[:, i] = (force if arm.sliding[i] else moment) @ arm.axes[i]
        force, moment = (np.einsum("tij,tj->ti", turns[i], vector) for vector in (force, moment))
        moment = moment + np.cross(levers[i], force)
    return torque


def rotation_about(axis: Array, angle: Array) -> Array:
    """Rotations about one axis by many angles, shape (T, 3, 3)."""
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    return np.eye(3) + s * cross + (1.0 - c) * (cross @ cross)


def _wrench(link: Array, omega: Array, alpha: Array, acc: Array) -> tuple[Array, Array]:
    """Force and moment about the joint frame's origin that a link's motion takes [N, N m]."""
    mass, first = link[0], link[1:4]
    xx, xy, yy, xz, yz, zz = link[4:]
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    force = mass * acc + np.cross(alpha, first) + np.cross(omega, np.cross(omega, first))
    return force, np.cross(first, acc) + alpha @ inertia + np.cross(omega, omega @ inertia)
