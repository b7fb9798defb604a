"""The joint torque regressor of a chain: τ = Y(q, dq, ddq) π, for whole batches of states.

Pinocchio computes it for one state at a time; recordings have 10⁵ and more. The recursion is compiled here and runs
over all states on all cores. π holds ten numbers a link in Pinocchio's order: mass, first moments (m c), and the
inertia about the joint frame's origin as xx, xy, yy, xz, yz, zz.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3 (recursive Newton-Euler), linear in π
as in Khalil and Dombre, Modeling, Identification and Control of Robots (2002), section 12.3.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from ident.arrays import Array, Float


@njit(cache=True, inline="always")
def _cross(a: Array, b: Array, out: Array) -> None:
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]


@njit(cache=True)
def _joint_rotation(placement: Array, axis: Array, angle: float, out: Array) -> None:
    """out = placement · Rot(axis, angle): child axes seen from the parent."""
    s, c = np.sin(angle), np.cos(angle)
    t = 1.0 - c
    x, y, z = axis
    turn = np.array(
        [
            [t * x * x + c, t * x * y - s * z, t * x * z + s * y],
            [t * x * y + s * z, t * y * y + c, t * y * z - s * x],
            [t * x * z - s * y, t * y * z + s * x, t * z * z + c],
        ]
    )
    for i in range(3):
        for j in range(3):
            out[i, j] = placement[i, 0] * turn[0, j] + placement[i, 1] * turn[1, j] + placement[i, 2] * turn[2, j]


@njit(cache=True)
def _body_wrench(omega: Array, alpha: Array, acc: Array, wrench: Array) -> None:
    """Columns of force (rows 0–2) and moment (rows 3–5) on a body at its frame's origin, shape (6, 10).

    force = m a + (α× + ω×ω×) m c;  moment = m c × a + I α + ω × I ω.
    """
    wrench[:] = 0.0
    wx, wy, wz = omega
    ax, ay, az = alpha
    for i in range(3):
        wrench[i, 0] = acc[i]
    # d(force)/d(m c) = [α]× + [ω]×[ω]×
    wrench[0, 1] = -wy * wy - wz * wz
    wrench[0, 2] = -az + wx * wy
    wrench[0, 3] = ay + wx * wz
    wrench[1, 1] = az + wx * wy
    wrench[1, 2] = -wx * wx - wz * wz
    wrench[1, 3] = -ax + wy * wz
    wrench[2, 1] = -ay + wx * wz
    wrench[2, 2] = ax + wy * wz
    wrench[2, 3] = -wx * wx - wy * wy
    # d(moment)/d(m c) = -[a]×
    wrench[3, 2] = acc[2]
    wrench[3, 3] = -acc[1]
    wrench[4, 1] = -acc[2]
    wrench[4, 3] = acc[0]
    wrench[5, 1] = acc[1]
    wrench[5, 2] = -acc[0]
    # I α for each of xx, xy, yy, xz, yz, zz, and ω × I ω
    wrench[3, 4], wrench[4, 4], wrench[5, 4] = ax, wx * wz, -wx * wy
    wrench[3, 5], wrench[4, 5], wrench[5, 5] = ay - wx * wz, ax + wy * wz, wx * wx - wy * wy
    wrench[3, 6], wrench[4, 6], wrench[5, 6] = -wy * wz, ay, wx * wy
    wrench[3, 7], wrench[4, 7], wrench[5, 7] = az + wx * wy, wz * wz - wx * wx, ax - wy * wz
    wrench[3, 8], wrench[4, 8], wrench[5, 8] = wy * wy - wz * wz, az - wx * wy, ay + wx * wz
    wrench[3, 9], wrench[4, 9], wrench[5, 9] = wy * wz, -wx * wz, az


@njit(cache=True, parallel=True)
def _regressor(
    rotations: Array,
    offsets: Array,
    axes: Array,
    sliding: Array,
    gravity: Array,
    q: Array,
    dq: Array,
    ddq: Array,
) -> Array:
    samples, n = q.shape
    out = np.zeros((samples, n, 10 * n))
    for t in prange(samples):
        turn = np.empty((n, 3, 3))
        arm = np.empty((n, 3))
        wrench = np.empty((6, 10))
        omega, alpha, acc = np.zeros(3), np.zeros(3), -gravity
        u, w = np.empty(3), np.empty(3)
        for i in range(n):
            slides = sliding[i]
            _joint_rotation(rotations[i], axes[i], 0.0 if slides else q[t, i], turn[i])
            for k in range(3):
                arm[i, k] = offsets[i, k]
                if slides:
                    for m in range(3):
                        arm[i, k] += turn[i, k, m] * axes[i, m] * q[t, i]
            # Classical acceleration of the joint frame's origin, still in the parent's axes.
            _cross(omega, arm[i], u)
            _cross(omega, u, w)
            _cross(alpha, arm[i], u)
            acc_parent = acc + u + w
            parent_omega, parent_alpha = omega, alpha
            omega, alpha, acc = np.zeros(3), np.zeros(3), np.zeros(3)
            for k in range(3):
                for m in range(3):
                    omega[k] += turn[i, m, k] * parent_omega[m]
                    alpha[k] += turn[i, m, k] * parent_alpha[m]
                    acc[k] += turn[i, m, k] * acc_parent[m]
            _cross(omega, axes[i], u)
            for k in range(3):
                if slides:
                    acc[k] += axes[i, k] * ddq[t, i] + 2.0 * u[k] * dq[t, i]
                else:
                    alpha[k] += axes[i, k] * ddq[t, i] + u[k] * dq[t, i]
            if not slides:
                for k in range(3):
                    omega[k] += axes[i, k] * dq[t, i]
            _body_wrench(omega, alpha, acc, wrench)
            _project(wrench, i, turn, arm, axes, sliding, out[t])
    return out


@njit(cache=True)
def _project(wrench: Array, body: int, turn: Array, arm: Array, axes: Array, sliding: Array, out: Array) -> None:
    """Carries a body's wrench columns down the chain and writes the torque at every joint below it."""
    moved = np.empty((6, 10))
    for j in range(body, -1, -1):
        first = 0 if sliding[j] else 3
        for c in range(10):
            total = 0.0
            for k in range(3):
                total += axes[j, k] * wrench[first + k, c]
            out[j, 10 * body + c] = total
        if j == 0:
            return
        for c in range(10):
            for k in range(3):
                force, moment = 0.0, 0.0
                for m in range(3):
                    force += turn[j, k, m] * wrench[m, c]
                    moment += turn[j, k, m] * wrench[3 + m, c]
                moved[k, c] = force
                moved[3 + k, c] = moment
            moved[3, c] += arm[j, 1] * moved[2, c] - arm[j, 2] * moved[1, c]
            moved[4, c] += arm[j, 2] * moved[0, c] - arm[j, 0] * moved[2, c]
            moved[5, c] += arm[j, 0] * moved[1, c] - arm[j, 1] * moved[0, c]
        wrench[:] = moved


def compute_regressor(
    rotations: Float[Array, "n 3 3"],
    offsets: Float[Array, "n 3"],
    axes: Float[Array, "n 3"],
    sliding: Array,
    gravity: Float[Array, " 3"],
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
) -> Float[Array, "T n 10n"]:
    """Torque regressor of a chain.

    Args:
        rotations: Axes of each joint frame in its parent's, at zero.
        offsets: Origin of each joint frame in its parent's [m].
        axes: Joint axes in the joint frames, unit length.
        sliding: Whether each joint is prismatic.
        gravity: Gravity in the base frame [m/s²].
        q, dq, ddq: Joint states [rad, rad/s, rad/s²].

    Returns:
        Y with τ = Y π [N m per unit of π].
    """
    state = (np.ascontiguousarray(values, dtype=float) for values in (q, dq, ddq))
    return _regressor(rotations, offsets, axes, sliding, gravity, *state)
