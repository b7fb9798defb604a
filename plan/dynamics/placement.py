"""Where an arm's frames and bodies are, and how points that they carry move, compiled."""

from __future__ import annotations

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from plan.dynamics.newton_euler import cross, place_joint


def random_positions(arm: ArmModel, count: int) -> Float[Array, "{count} n"]:
    """Positions all over the joints' range, always the same: what is asked of them is a property of the arm [rad]."""
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    return np.random.default_rng(0).uniform(low, high, (count, arm.n))


@njit(cache=True, fastmath=True, nogil=True)
def place_frames(chain, q, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of every joint frame for one position; frame 0 is the world."""
    for k in range(3):
        frame_at[0, k] = 0.0
        for m in range(3):
            frame_rot[0, k, m] = 1.0 if k == m else 0.0
    r = np.empty(9)
    for i in range(q.shape[0]):
        p = place_joint(chain, i, q[i], r)
        for k in range(3):
            frame_at[i + 1, k] = frame_at[i, k]
            for m in range(3):
                frame_at[i + 1, k] += frame_rot[i, k, m] * p[m]
                frame_rot[i + 1, k, m] = (
                    frame_rot[i, k, 0] * r[m] + frame_rot[i, k, 1] * r[3 + m] + frame_rot[i, k, 2] * r[6 + m]
                )


@njit(cache=True, fastmath=True, nogil=True)
def place_bodies(bodies, start, stop, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of the bodies from `start` up to `stop`, and of their parts."""
    for i in range(start, stop):
        _place(i, bodies, frame_rot, frame_at)
        for part in range(bodies.part[i], bodies.part[i] + bodies.parts[i]):
            _place(part, bodies, frame_rot, frame_at)


@njit(cache=True, fastmath=True, nogil=True)
def _place(b, bodies, frame_rot, frame_at):  # type: ignore[no-untyped-def]
    """World placement of one body."""
    f = bodies.carrier[b]
    for k in range(3):
        bodies.placed_at[b, k] = frame_at[f, k]
        for m in range(3):
            bodies.placed_at[b, k] += frame_rot[f, k, m] * bodies.at[b, m]
            bodies.placed_rot[b, k, m] = (
                frame_rot[f, k, 0] * bodies.rot[b, 0, m]
                + frame_rot[f, k, 1] * bodies.rot[b, 1, m]
                + frame_rot[f, k, 2] * bodies.rot[b, 2, m]
            )


@njit(cache=True, fastmath=True, nogil=True)
def joint_axis(chain, frame_rot, j):  # type: ignore[no-untyped-def]
    """Axis of joint j in the base frame."""
    r, a = frame_rot[j + 1], chain.axes[j]
    return (
        r[0, 0] * a[0] + r[0, 1] * a[1] + r[0, 2] * a[2],
        r[1, 0] * a[0] + r[1, 1] * a[1] + r[1, 2] * a[2],
        r[2, 0] * a[0] + r[2, 1] * a[1] + r[2, 2] * a[2],
    )


@njit(cache=True, fastmath=True, nogil=True)
def _moves(chain, frame_rot, frame_at, j, point):  # type: ignore[no-untyped-def]
    """How a point of the base frame that joint j carries moves for a unit of that joint."""
    axis = joint_axis(chain, frame_rot, j)
    if chain.sliding[j]:
        return axis
    return cross(axis, (point[0] - frame_at[j + 1, 0], point[1] - frame_at[j + 1, 1], point[2] - frame_at[j + 1, 2]))


@njit(cache=True, fastmath=True, nogil=True)
def slopes_of_points(chain, q, joints, points, normals):  # type: ignore[no-untyped-def]
    """Derivatives by the joints of the distance of two points along a normal, each row at its own position [m/rad].

    Args:
        chain: The arm.
        q: Positions, shape (m, n).
        joints: Joint frames that carry the points, 0 for the world, shape (m, 2).
        points: The points in the base frame, the one that the normal leads away from first, shape (m, 2, 3) [m].
        normals: Unit vectors, shape (m, 3).
    """
    n, out = q.shape[1], np.zeros(q.shape)
    rot, at = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    for row in range(q.shape[0]):
        if row == 0 or np.any(q[row] != q[row - 1]):
            place_frames(chain, q[row], rot, at)
        for side in range(2):
            for j in range(joints[row, side]):
                x, y, z = _moves(chain, rot, at, j, points[row, side])
                out[row, j] += (2.0 * side - 1.0) * (normals[row, 0] * x + normals[row, 1] * y + normals[row, 2] * z)
    return out


@njit(cache=True, fastmath=True, nogil=True)
def frame_states(chain, q, joint, turn, place):  # type: ignore[no-untyped-def]
    """Where a frame is along T positions, and how it moves with each joint.

    Args:
        chain: The arm.
        q: Positions, shape (T, n) [rad].
        joint: The joint that carries the frame, 0 for the world.
        turn, place: The frame in that joint's.

    Returns:
        Place (T, 3) and axes (T, 3, 3) in the base frame; change of place (T, n, 3) and turn (T, n, 3) by the joints.
    """
    count, n = q.shape
    at, axes = np.empty((count, 3)), np.empty((count, 3, 3))
    linear, angular = np.zeros((count, n, 3)), np.zeros((count, n, 3))
    rot, origin = np.empty((n + 1, 3, 3)), np.empty((n + 1, 3))
    for t in range(count):
        place_frames(chain, q[t], rot, origin)
        for k in range(3):
            at[t, k] = origin[joint, k]
            for m in range(3):
                at[t, k] += rot[joint, k, m] * place[m]
                axes[t, k, m] = 0.0
                for i in range(3):
                    axes[t, k, m] += rot[joint, k, i] * turn[i, m]
        for j in range(joint):
            linear[t, j, 0], linear[t, j, 1], linear[t, j, 2] = _moves(chain, rot, origin, j, at[t])
            if not chain.sliding[j]:
                angular[t, j, 0], angular[t, j, 1], angular[t, j, 2] = joint_axis(chain, rot, j)
    return at, axes, linear, angular
