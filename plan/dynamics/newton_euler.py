"""Compiled recursive Newton-Euler over a chain: torque of many states, an order faster than one call a state.

Pinocchio stays the reference (the certificate uses it); this loop exists because a planner asks for 10⁷ states and
needs them fused with the reading of trajectories.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from plan.dynamics.chain import Chain


@njit(cache=True, fastmath=True, nogil=True)
def _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q, dq, ddq, work, tau):  # type: ignore[no-untyped-def]
    """Newton-Euler of one state.

    Args:
        work: Scratch, shape (n, 18): rotation 9, force 3, moment 3, lever 3.
    """
    n = q.shape[0]
    wx, wy, wz, bx, by, bz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    ax, ay, az = -gravity[0], -gravity[1], -gravity[2]
    for i in range(n):
        r = work[i]
        if sliding[i] > 0.5:
            s, c, d, v, a = 0.0, 0.0, q[i], dq[i], ddq[i]
            ex, ey, ez = 0.0, 0.0, 0.0
            lx, ly, lz = axes[i, 0], axes[i, 1], axes[i, 2]
        else:
            s, c, d, v, a = math.sin(q[i]), 1.0 - math.cos(q[i]), 0.0, dq[i], ddq[i]
            ex, ey, ez = axes[i, 0], axes[i, 1], axes[i, 2]
            lx, ly, lz = 0.0, 0.0, 0.0
        for k in range(3):
            for m in range(3):
                r[3 * k + m] = rot[i, 0, k, m] + s * rot[i, 1, k, m] + c * rot[i, 2, k, m]
        # Lever from the parent's origin to this one, in the parent's axes; a slide moves it along its axis.
        px = off[i, 0] + d * (r[0] * lx + r[1] * ly + r[2] * lz)
        py = off[i, 1] + d * (r[3] * lx + r[4] * ly + r[5] * lz)
        pz = off[i, 2] + d * (r[6] * lx + r[7] * ly + r[8] * lz)
        r[15], r[16], r[17] = px, py, pz
        # Acceleration of this origin in the parent's axes: a + β×p + ω×(ω×p).
        ux, uy, uz = wy * pz - wz * py, wz * px - wx * pz, wx * py - wy * px
        gx = ax + by * pz - bz * py + wy * uz - wz * uy
        gy = ay + bz * px - bx * pz + wz * ux - wx * uz
        gz = az + bx * py - by * px + wx * uy - wy * ux
        # Into this frame's axes.
        tx, ty, tz = (
            r[0] * wx + r[3] * wy + r[6] * wz,
            r[1] * wx + r[4] * wy + r[7] * wz,
            r[2] * wx + r[5] * wy + r[8] * wz,
        )
        sx, sy, sz = (
            r[0] * bx + r[3] * by + r[6] * bz,
            r[1] * bx + r[4] * by + r[7] * bz,
            r[2] * bx + r[5] * by + r[8] * bz,
        )
        ax, ay, az = (
            r[0] * gx + r[3] * gy + r[6] * gz,
            r[1] * gx + r[4] * gy + r[7] * gz,
            r[2] * gx + r[5] * gy + r[8] * gz,
        )
        ax += lx * a + 2.0 * v * (ty * lz - tz * ly)
        ay += ly * a + 2.0 * v * (tz * lx - tx * lz)
        az += lz * a + 2.0 * v * (tx * ly - ty * lx)
        bx = sx + ex * a + v * (ty * ez - tz * ey)
        by = sy + ey * a + v * (tz * ex - tx * ez)
        bz = sz + ez * a + v * (tx * ey - ty * ex)
        wx, wy, wz = tx + ex * v, ty + ey * v, tz + ez * v
        # Force and moment that move this link, about its origin.
        cx, cy, cz = com[i, 0], com[i, 1], com[i, 2]
        ux, uy, uz = wy * cz - wz * cy, wz * cx - wx * cz, wx * cy - wy * cx
        fx = mass[i] * (ax + by * cz - bz * cy + wy * uz - wz * uy)
        fy = mass[i] * (ay + bz * cx - bx * cz + wz * ux - wx * uz)
        fz = mass[i] * (az + bx * cy - by * cx + wx * uy - wy * ux)
        hx = inertia[i, 0, 0] * wx + inertia[i, 0, 1] * wy + inertia[i, 0, 2] * wz
        hy = inertia[i, 1, 0] * wx + inertia[i, 1, 1] * wy + inertia[i, 1, 2] * wz
        hz = inertia[i, 2, 0] * wx + inertia[i, 2, 1] * wy + inertia[i, 2, 2] * wz
        nx = inertia[i, 0, 0] * bx + inertia[i, 0, 1] * by + inertia[i, 0, 2] * bz + wy * hz - wz * hy
        ny = inertia[i, 1, 0] * bx + inertia[i, 1, 1] * by + inertia[i, 1, 2] * bz + wz * hx - wx * hz
        nz = inertia[i, 2, 0] * bx + inertia[i, 2, 1] * by + inertia[i, 2, 2] * bz + wx * hy - wy * hx
        r[9], r[10], r[11] = fx, fy, fz
        r[12], r[13], r[14] = nx + cy * fz - cz * fy, ny + cz * fx - cx * fz, nz + cx * fy - cy * fx
    for i in range(n - 1, -1, -1):
        r = work[i]
        first = 9 if sliding[i] > 0.5 else 12
        tau[i] = axes[i, 0] * r[first] + axes[i, 1] * r[first + 1] + axes[i, 2] * r[first + 2]
        if i > 0:
            below = work[i - 1]
            fx = r[0] * r[9] + r[1] * r[10] + r[2] * r[11]
            fy = r[3] * r[9] + r[4] * r[10] + r[5] * r[11]
            fz = r[6] * r[9] + r[7] * r[10] + r[8] * r[11]
            below[9] += fx
            below[10] += fy
            below[11] += fz
            below[12] += r[0] * r[12] + r[1] * r[13] + r[2] * r[14] + r[16] * fz - r[17] * fy
            below[13] += r[3] * r[12] + r[4] * r[13] + r[5] * r[14] + r[17] * fx - r[15] * fz
            below[14] += r[6] * r[12] + r[7] * r[13] + r[8] * r[14] + r[15] * fy - r[16] * fx


@njit(cache=True, fastmath=True, nogil=True)
def _rnea_states(rot, off, axes, sliding, mass, com, inertia, gravity, q, dq, ddq):  # type: ignore[no-untyped-def]
    tau = np.empty(q.shape)
    work = np.empty((q.shape[1], 18))
    for t in range(q.shape[0]):
        _rnea(rot, off, axes, sliding, mass, com, inertia, gravity, q[t], dq[t], ddq[t], work, tau[t])
    return tau


def inverse_dynamics(
    chain: Chain, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> Float[Array, "T n"]:
    """Torque of the rigid chain, M ddq + C dq + G [N m].

    Args:
        chain: The arm.
        q, dq, ddq: Joint states [rad, rad/s, rad/s²].

    Source: paper, eq. 2 (with the erratum: C(θ, dθ) dθ).
    """
    states = (np.ascontiguousarray(values, dtype=float) for values in (q, dq, ddq))
    return _rnea_states(*chain.dynamics, *states)
