"""How runs begin: what an effect that remembers leaves where it was started in mid-motion.

Friction that turns round, a gear that twists, a delay: each has a state. Where it was started from
none at the first row of a run, the torque of its joint jumps there, and that tells the joint.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float

START_S = 0.15  # of a run that counts as its start [s]
LEAST_START = 4  # rows of it at the least
USUAL_QUANTILE = 0.95  # of what comes later, taken for usual
# Share of a joint's largest torque below which a change is none.
LEAST_CHANGE = 1e-6


def start_roughness(torque: Float[Array, "T n"], time: Float[Array, " T"]) -> Float[Array, " n"]:
    """Logarithm of the largest bend of each joint's torque at a run's start over a usual one later.

    A bend is the second difference of three rows. Zero for a run that is hardly longer than its
    start.

    Args:
        torque: Of all joints [N m].
        time: Of each row [s].
    """
    if len(time) <= 4 * LEAST_START:
        return np.zeros(torque.shape[1])
    bends = np.abs(np.diff(torque, 2, axis=0))
    count = max(int(START_S / np.median(np.diff(time))), LEAST_START)
    count = min(count, len(bends) // 2)
    least = LEAST_CHANGE * np.max(np.abs(torque), axis=0) + 1e-12
    first = np.max(bends[:count], axis=0)
    usual = np.quantile(bends[count:], USUAL_QUANTILE, axis=0)
    return np.asarray(np.log((first + least) / (usual + least)))
