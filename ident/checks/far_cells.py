"""Cells far from all else of their channel, however many they are: between them and the rest nothing was measured.

A motion, a torque or a temperature comes to a value through those on the way. Walking outwards from a channel's median,
sample by sample in order of distance, the first stretch without any sample that is several times as wide as all that
lies within parts the channel from what is not its own. Half of the samples may be bad; a spike of one sample is found
here too, if it is far enough.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Bool, Float

# How many times farther out than all else a cell must lie. Torques, speeds and positions of 82 clean sessions, five of
# them of real arms, stay below 1.25, temperatures in whole steps below 2. Where samples are rare, or steps coarse, more
# is asked.
GAP, WIDE_GAP = 3.0, 10.0
# A joint whose torque is friction alone jumps from rest to its level, and one at rest has next to no reach of its own:
# distances below what the other joints keep this share of their samples within are nothing.
SHARE = 0.95


def find_far(runs: list[Float[Array, "T n"]], gap: float = GAP, floor: float = 0.0) -> list[Bool[Array, "T n"]]:
    """Which cells of a channel lie beyond an empty stretch, by run.

    Args:
        runs: The channel.
        gap: How many times the reach of all that lies within the stretch must span.
        floor: Reach below which nothing is far, in the channel's unit.
    """
    whole = np.concatenate(runs)
    if len(whole) < 3:
        return [np.zeros(values.shape, dtype=bool) for values in runs]
    middle = np.median(whole, axis=0)
    reach = np.abs(whole - middle)
    usual = np.quantile(reach, SHARE, axis=0)
    limit = np.empty(len(middle))
    for joint in range(len(middle)):
        others = np.delete(usual, joint) if len(usual) > 1 else usual
        limit[joint] = _edge(np.sort(reach[:, joint]), gap, max(float(others.max()), floor))
    return [np.abs(values - middle) > limit for values in runs]


def _edge(reach: Float[Array, " T"], gap: float, floor: float) -> float:
    """Where the channel ends: the last distance before the first empty stretch beyond half of the samples."""
    half = len(reach) // 2
    empty = reach[half + 1 :] > gap * np.maximum(reach[half:-1], floor)
    return float(reach[half + int(np.argmax(empty))]) if floor > 0.0 and empty.any() else np.inf
