"""Compiled recursive Newton-Euler over a chain: torque of many states, an order faster than one call a state.

Pinocchio stays the reference (the certificate uses it); this loop exists because a planner asks for 10⁷ states and
needs them fused with the reading of trajectories. Vectors are tuples of three: the compiler keeps them in registers.
"""

from __future__ import annotations

import math

from numba import njit


@njit(cache=True, fastmath=True, nogil=True)
def place_joint(chain, i, q, r):  # type: ignore[no-untyped-def]
    """Axes of joint frame i in its parent's at a position, row by row into `r`; its origin in the parent's axes."""
    off, rot, slides = chain.offsets, chain.rotations, chain.sliding[i]
    s = 0.0 if slides else math.sin(q)
    c = 0.0 if slides else 1.0 - math.cos(q)
    for k in range(3):
        for m in range(3):
            r[3 * k + m] = rot[i, 0, k, m] + s * rot[i, 1, k, m] + c * rot[i, 2, k, m]
    d = q if slides else 0.0
    x, y, z = turn(r, (chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2]))
    return off[i, 0] + d * x, off[i, 1] + d * y, off[i, 2] + d * z


@njit(cache=True, fastmath=True, nogil=True)
def turn(r, a):  # type: ignore[no-untyped-def]
    """A vector in a frame's axes, in those of its parent."""
    return (
        r[0] * a[0] + r[1] * a[1] + r[2] * a[2],
        r[3] * a[0] + r[4] * a[1] + r[5] * a[2],
        r[6] * a[0] + r[7] * a[1] + r[8] * a[2],
    )


@njit(cache=True, fastmath=True, nogil=True)
def _turn_back(r, a):  # type: ignore[no-untyped-def]
    """A vector in the parent's axes, in the frame's own."""
    return (
        r[0] * a[0] + r[3] * a[1] + r[6] * a[2],
        r[1] * a[0] + r[4] * a[1] + r[7] * a[2],
        r[2] * a[0] + r[5] * a[1] + r[8] * a[2],
    )


@njit(cache=True, fastmath=True, nogil=True)
def cross(a, b):  # type: ignore[no-untyped-def]
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@njit(cache=True, fastmath=True, nogil=True)
def _add(a, b, share=1.0):  # type: ignore[no-untyped-def]
    """a + share · b."""
    return a[0] + share * b[0], a[1] + share * b[1], a[2] + share * b[2]


@njit(cache=True, fastmath=True, nogil=True)
def _carried(a, alpha, omega, p):  # type: ignore[no-untyped-def]
    """Acceleration of a point p of a body whose origin has acceleration a: a + α × p + ω × (ω × p)."""
    return _add(_add(a, cross(alpha, p)), cross(omega, cross(omega, p)))


@njit(cache=True, fastmath=True, nogil=True)
def rnea(chain, q, dq, ddq, work, tau):  # type: ignore[no-untyped-def]
    """Newton-Euler of one state: M ddq + C dq + G. Source: paper, eq. 2 (with the erratum: C(θ, dθ) dθ).

    Args:
        chain: The arm.
        q, dq, ddq: Its state, shape (n,).
        work: Scratch, shape (n, 18): rotation 9, force 3, moment 3, lever 3.
        tau: Torque, shape (n,).
    """
    n, inertia = q.shape[0], chain.inertias
    omega, alpha = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    acc = (-chain.gravity[0], -chain.gravity[1], -chain.gravity[2])
    for i in range(n):
        r = work[i]
        p = place_joint(chain, i, q[i], r)
        acc = _turn_back(r, _carried(acc, alpha, omega, p))
        omega, alpha = _turn_back(r, omega), _turn_back(r, alpha)
        axis = (chain.axes[i, 0], chain.axes[i, 1], chain.axes[i, 2])
        gyration = cross(omega, axis)
        if chain.sliding[i]:
            acc = _add(_add(acc, axis, ddq[i]), gyration, 2.0 * dq[i])
        else:
            alpha = _add(_add(alpha, axis, ddq[i]), gyration, dq[i])
            omega = _add(omega, axis, dq[i])
        # Force and moment that move this link, about its origin.
        c = (chain.centres[i, 0], chain.centres[i, 1], chain.centres[i, 2])
        force = _add((0.0, 0.0, 0.0), _carried(acc, alpha, omega, c), chain.masses[i])
        moment = cross(c, force)
        own = inertia[i].reshape(9)
        moment = _add(_add(moment, turn(own, alpha)), cross(omega, turn(own, omega)))
        for k in range(3):
            r[9 + k], r[12 + k], r[15 + k] = force[k], moment[k], p[k]
    for i in range(n - 1, -1, -1):
        r = work[i]
        first = 9 if chain.sliding[i] else 12
        tau[i] = chain.axes[i, 0] * r[first] + chain.axes[i, 1] * r[first + 1] + chain.axes[i, 2] * r[first + 2]
        if i > 0:
            force, moment = turn(r, (r[9], r[10], r[11])), turn(r, (r[12], r[13], r[14]))
            moment = _add(moment, cross((r[15], r[16], r[17]), force))
            for k in range(3):
                work[i - 1, 9 + k] += force[k]
                work[i - 1, 12 + k] += moment[k]
