"""Gravity's torque on a chain for one metre a second squared along each axis of its base.

The torque that holds joint j against a gravity g is linear in g. With M the mass of all that the
joint moves, s its first moment, z the joint's axis and o its origin, all in the base frame,

    τ_j = − (z × (s − M o)) · g    where the joint turns,    τ_j = − M z · g    where it slides.

One walk along the chain gives all three directions, for batches of states.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float, read_only
from ident.compiled import compiled
from ident.robot.chain import Chain


def gravity_along_axes(chain: Chain, q: Float[Array, "T n"]) -> Float[Array, "T n 3"]:
    """Joint torques that hold the arm still under 1 m/s² along each axis of its base [N m or N]."""
    out = np.empty((*np.shape(q), 3))
    vectors = np.stack([chain.offsets, chain.axes, chain.centres], axis=1)
    values = (chain.rotations, vectors, chain.sliding, chain.masses, q)
    _fill_gravity(*map(read_only, values), out)
    return out


@compiled(error_model="numpy", nogil=True)
def _fill_gravity(
    rotations: Array,
    vectors: Array,
    sliding: Array,
    masses: Array,
    q: Array,
    out: Array,
) -> None:
    """Axes, origins and centres of mass from the base on, then the torques from the tip on.

    Vectors of each joint are its offset in its parent's frame, then its axis and its link's centre
    of mass in its own.
    """
    count = q.shape[1]
    axis = np.empty((count, 3))
    origin = np.empty((count, 3))
    centre = np.empty((count, 3))
    turn = np.empty((3, 3))
    step = np.empty((3, 3))
    place = np.empty(3)
    for t in range(len(q)):
        for k in range(3):
            place[k] = 0.0
            for m in range(3):
                turn[k, m] = 1.0 if k == m else 0.0
        for i in range(count):
            sine = 0.0
            versine = 0.0
            if sliding[i] == 0.0:
                sine = np.sin(q[t, i])
                versine = 1.0 - np.cos(q[t, i])
            for k in range(3):
                for m in range(3):
                    turned = sine * rotations[i, 1, k, m] + versine * rotations[i, 2, k, m]
                    step[k, m] = rotations[i, 0, k, m] + turned
            for k in range(3):
                x = turn[k, 0]
                y = turn[k, 1]
                z = turn[k, 2]
                place[k] += x * vectors[i, 0, 0] + y * vectors[i, 0, 1] + z * vectors[i, 0, 2]
                for m in range(3):
                    turn[k, m] = x * step[0, m] + y * step[1, m] + z * step[2, m]
            for k in range(3):
                x = turn[k, 0]
                y = turn[k, 1]
                z = turn[k, 2]
                axis[i, k] = x * vectors[i, 1, 0] + y * vectors[i, 1, 1] + z * vectors[i, 1, 2]
                if sliding[i] != 0.0:
                    place[k] += axis[i, k] * q[t, i]
                origin[i, k] = place[k]
                beyond = x * vectors[i, 2, 0] + y * vectors[i, 2, 1] + z * vectors[i, 2, 2]
                centre[i, k] = place[k] + beyond
        mass = 0.0
        for k in range(3):
            place[k] = 0.0  # the first moment of all that is beyond
        for i in range(count - 1, -1, -1):
            mass += masses[i]
            for k in range(3):
                place[k] += masses[i] * centre[i, k]
            if sliding[i] != 0.0:
                for k in range(3):
                    out[t, i, k] = -mass * axis[i, k]
                continue
            x = place[0] - mass * origin[i, 0]
            y = place[1] - mass * origin[i, 1]
            z = place[2] - mass * origin[i, 2]
            out[t, i, 0] = axis[i, 2] * y - axis[i, 1] * z
            out[t, i, 1] = axis[i, 0] * z - axis[i, 2] * x
            out[t, i, 2] = axis[i, 1] * x - axis[i, 0] * y
