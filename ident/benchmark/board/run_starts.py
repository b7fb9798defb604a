"""How runs begin: what an effect that remembers leaves where it was started in mid-motion.

Friction that turns round, a gear that twists, a delay: each has a state. Where it was started from
none at the first row of a run, the torque of its joint jumps there, and that tells the joint.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.files import KEPT_BITS

START_S = 0.15  # of a run that counts as its start [s]
USUAL_QUANTILE = 0.95  # of what comes later, taken for usual


def start_roughness(torque: Float[Array, "T n"], time: Float[Array, " T"]) -> Float[Array, " n"]:
    """Logarithm of the largest bend of each joint's torque at a run's start over a usual one later.

    A bend is the second difference of three rows; below the digits that a board keeps of the
    largest torque it is none. Zero for a run that is hardly longer than its start.

    Args:
        torque: Of all joints [N m].
        time: Of each row [s].
    """
    bends = np.abs(np.diff(torque, 2, axis=0))
    count = max(int(START_S / np.median(np.diff(time))), 3)
    if len(bends) < 3 * count:
        return np.zeros(torque.shape[1])
    least = np.ldexp(np.max(np.abs(torque), axis=0), -KEPT_BITS) + np.finfo(float).tiny
    first = np.max(bends[:count], axis=0)
    usual = np.quantile(bends[count:], USUAL_QUANTILE, axis=0)
    return np.asarray(np.log((first + least) / (usual + least)))
