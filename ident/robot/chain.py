"""A chain over whole batches of states: poses of its joints, and the compiled torque regressor, τ =
Y(q, dq, ddq) π.

Pinocchio computes it for one state at a time; recordings have 10⁵ and more. π holds ten numbers a
link in Pinocchio's order: mass, first moments (m c), and the inertia about the joint frame's origin
as xx, xy, yy, xz, yz, zz.

The force and moment of link i act on joint j ≤ i through the joint's axis and lever, both seen from
link i:

    τ_j = z · moment + (z × p) · force,  p from joint j's origin to link i's.

Source: Featherstone, Rigid Body Dynamics Algorithms (2008), section 5.3 (recursive Newton-Euler),
linear in π as in Khalil and Dombre, Modeling, Identification and Control of Robots (2002), section
12.3.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.arrays import Array, Float, read_only
from ident.compiled import compiled

PER_LINK = 10


class Chain(NamedTuple):
    """A chain of n one-axis joints, base to tip, as compiled loops read it.

    The rotation of joint i is A₀ + sin q A₁ + (1 − cos q) A₂: Rodrigues' formula with the placement
    multiplied in, so that a loop needs no case for the axis.
    """

    rotations: Array  # A₀, A₁, A₂ of each joint; A₁ = A₂ = 0 for a sliding one; shape (n, 3, 3, 3)
    offsets: Array  # origin of each joint frame in its parent's [m], shape (n, 3)
    axes: Array  # joint axes in the joint frames, unit length, shape (n, 3)
    sliding: Array  # whether each joint is prismatic
    gravity: Array  # gravity in the base frame [m/s²]
    masses: Array  # link masses [kg]
    centres: Array  # centres of mass in the joint frames [m], shape (n, 3)
    # moments of inertia about the centres of mass, joint frame axes [kg m²], shape (n, 3, 3)
    inertias: Array


def compute_joint_poses(
    chain: Chain, q: Float[Array, "T n"], wanted: Sequence[int]
) -> dict[int, tuple[Float[Array, "T 3 3"], Float[Array, "T 3"]]]:
    """Orientation and origin [m] of some joints' frames in the base frame, their own motion
    included.

    Args:
        chain: The chain.
        q: Positions [rad or m].
        wanted: Which joints, from 1 as Pinocchio counts them; 0 is the base.
    """
    turn = np.tile(np.eye(3), (len(q), 1, 1))
    origin = np.zeros((len(q), 3))
    poses = {0: (turn, origin)} if 0 in wanted else {}
    for i in range(max(wanted, default=0)):
        placed, sine, cosine = chain.rotations[i]
        still = np.zeros((len(q), 1, 1))
        angle = still if chain.sliding[i] else q[:, i, None, None]
        origin = origin + turn @ chain.offsets[i]
        turned = placed + np.sin(angle) * sine + (1.0 - np.cos(angle)) * cosine
        turn = turn @ turned
        if chain.sliding[i]:
            travel = q[:, i : i + 1]
            origin = origin + travel * (turn @ chain.axes[i])
        if i + 1 in wanted:
            poses[i + 1] = turn, origin
    return poses


def compute_regressor(
    chain: Chain,
    q: Float[Array, "T n"],
    dq: Float[Array, "T n"],
    ddq: Float[Array, "T n"],
    columns: Sequence[int] | None = None,
) -> Float[Array, "T n k"]:
    """Y with τ = Y π [N m per unit of π]; of all of its 10 n columns, or those asked for, in their
    order.
    """
    samples, n = np.shape(q)
    chosen = range(PER_LINK * n) if columns is None else columns
    place = np.full(PER_LINK * n, -1.0)
    place[list(chosen)] = np.arange(len(chosen))
    out = np.zeros((samples, n, len(chosen)))
    parts = (*chain[:5], q, dq, ddq)
    _fill_regressor(*map(read_only, parts), place, out)
    return out


@compiled(error_model="numpy", nogil=True)
def _fill_regressor(
    rotations: Array,
    offsets: Array,
    axes: Array,
    sliding: Array,
    gravity: Array,
    q: Array,
    dq: Array,
    ddq: Array,
    place: Array,
    out: Array,
) -> None:
    """Walks down the chain with each state; `screw` holds axis and z × p of each joint so far.

    ω, α and a are a link's angular velocity and acceleration, and the acceleration of its origin
    less gravity, all in its own axes. Row k of `turn` is axis k of the parent in the link's, so
    that v in the link's axes is turnᵀ v.
    """
    screw = np.empty((q.shape[1], 6))
    turn = np.empty((3, 3))
    for t in range(len(q)):
        wx = 0.0
        wy = 0.0
        wz = 0.0
        ax = 0.0
        ay = 0.0
        az = 0.0
        bx = -gravity[0]
        by = -gravity[1]
        bz = -gravity[2]
        for i in range(q.shape[1]):
            x = axes[i, 0]
            y = axes[i, 1]
            z = axes[i, 2]
            px = offsets[i, 0]
            py = offsets[i, 1]
            pz = offsets[i, 2]
            s = 0.0
            u = 0.0
            if sliding[i] == 0.0:
                s = np.sin(q[t, i])
                u = 1.0 - np.cos(q[t, i])
            for k in range(3):
                for m in range(3):
                    turn[k, m] = (
                        rotations[i, 0, k, m]
                        + s * rotations[i, 1, k, m]
                        + u * rotations[i, 2, k, m]
                    )
                if sliding[i] != 0.0:
                    along = turn[k, 0] * x + turn[k, 1] * y + turn[k, 2] * z
                    if k == 0:
                        px += along * q[t, i]
                    elif k == 1:
                        py += along * q[t, i]
                    else:
                        pz += along * q[t, i]
            # Acceleration of the link's origin: a + α × p + ω × (ω × p).
            sx = wy * pz - wz * py
            sy = wz * px - wx * pz
            sz = wx * py - wy * px
            bx = bx + ay * pz - az * py + wy * sz - wz * sy
            by = by + az * px - ax * pz + wz * sx - wx * sz
            bz = bz + ax * py - ay * px + wx * sy - wy * sx
            wx, wy, wz = (
                turn[0, 0] * wx + turn[1, 0] * wy + turn[2, 0] * wz,
                turn[0, 1] * wx + turn[1, 1] * wy + turn[2, 1] * wz,
                turn[0, 2] * wx + turn[1, 2] * wy + turn[2, 2] * wz,
            )
            ax, ay, az = (
                turn[0, 0] * ax + turn[1, 0] * ay + turn[2, 0] * az,
                turn[0, 1] * ax + turn[1, 1] * ay + turn[2, 1] * az,
                turn[0, 2] * ax + turn[1, 2] * ay + turn[2, 2] * az,
            )
            bx, by, bz = (
                turn[0, 0] * bx + turn[1, 0] * by + turn[2, 0] * bz,
                turn[0, 1] * bx + turn[1, 1] * by + turn[2, 1] * bz,
                turn[0, 2] * bx + turn[1, 2] * by + turn[2, 2] * bz,
            )
            v = dq[t, i]
            g = ddq[t, i]
            cx = (wy * z - wz * y) * v
            cy = (wz * x - wx * z) * v
            cz = (wx * y - wy * x) * v
            if sliding[i] != 0.0:
                bx = bx + x * g + 2.0 * cx
                by = by + y * g + 2.0 * cy
                bz = bz + z * g + 2.0 * cz
            else:
                ax = ax + x * g + cx
                ay = ay + y * g + cy
                az = az + z * g + cz
                wx = wx + x * v
                wy = wy + y * v
                wz = wz + z * v
            # The screws of the joints before, seen from this link: moments of forces grow by the
            # lever.
            for j in range(i):
                mx = screw[j, 0]
                my = screw[j, 1]
                mz = screw[j, 2]
                fx = screw[j, 3] + my * pz - mz * py
                fy = screw[j, 4] + mz * px - mx * pz
                fz = screw[j, 5] + mx * py - my * px
                for k in range(3):
                    screw[j, k] = turn[0, k] * mx + turn[1, k] * my + turn[2, k] * mz
                    screw[j, 3 + k] = turn[0, k] * fx + turn[1, k] * fy + turn[2, k] * fz
            for k in range(3):
                screw[i, k] = 0.0 if sliding[i] != 0.0 else axes[i, k]
                screw[i, 3 + k] = axes[i, k] if sliding[i] != 0.0 else 0.0
            xx = wx * wx
            yy = wy * wy
            zz = wz * wz
            xy = wx * wy
            xz = wx * wz
            yz = wy * wz
            first = PER_LINK * i
            for j in range(i + 1):
                mx = screw[j, 0]
                my = screw[j, 1]
                mz = screw[j, 2]
                fx = screw[j, 3]
                fy = screw[j, 4]
                fz = screw[j, 5]
                along = wx * fx + wy * fy + wz * fz
                square = xx + yy + zz
                # Force m a + (α × + ω × ω ×) m c, moment m c × a and the derivative of I α + ω × I
                # ω by I.
                values = (
                    fx * bx + fy * by + fz * bz,
                    fy * az - fz * ay + wx * along - fx * square + by * mz - bz * my,
                    fz * ax - fx * az + wy * along - fy * square + bz * mx - bx * mz,
                    fx * ay - fy * ax + wz * along - fz * square + bx * my - by * mx,
                    mx * ax + my * xz - mz * xy,
                    mx * (ay - xz) + my * (ax + yz) + mz * (xx - yy),
                    my * ay - mx * yz + mz * xy,
                    mx * (az + xy) + my * (zz - xx) + mz * (ax - yz),
                    mx * (yy - zz) + my * (az - xy) + mz * (ay + xz),
                    mx * yz - my * xz + mz * az,
                )
                for k in range(PER_LINK):
                    column = int(place[first + k])
                    if column >= 0:
                        out[t, j, column] = values[k]
