"""References as simple controllers make them: with steps of acceleration or of jerk.

A controller is sent positions at a slow, even rate and joins them by straight lines; a moving average over one period
makes the velocity a chain of ramps (steps of acceleration), another one makes the acceleration one (steps of jerk).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arrays import Array, Float
from ident.trajectories.reference import TICK_S, ReferenceMotion

# Period at which positions are sent [s]: ordinary motions, and those that swing fast.
PERIOD_S, FAST_PERIOD_S = 0.08, 0.02
FAST = ("chirp",)
AVERAGES = {"acceleration": 1, "jerk": 2}


def stepped(motion: ReferenceMotion, shape: str) -> ReferenceMotion:
    """The motion as such a controller would follow it.

    Args:
        motion: A smooth motion that rests at both ends for longer than the averages last.
        shape: `smooth` for the motion as it is, `jerk` or `acceleration` for what is to step.
    """
    if shape not in AVERAGES:
        return motion
    period = round((FAST_PERIOD_S if motion.name in FAST else PERIOD_S) / TICK_S)
    ticks = np.arange(len(motion.q))
    sent = np.append(np.arange(0, len(motion.q), period), len(motion.q) - 1)
    q = np.column_stack([np.interp(ticks, sent, column[sent]) for column in motion.q.T])
    for _ in range(AVERAGES[shape]):
        q = _averaged(q, period)
    dq = np.gradient(q, TICK_S, axis=0)
    ddq = np.gradient(dq, TICK_S, axis=0)
    return ReferenceMotion(motion.name, q, dq, ddq)


def _averaged(q: Float[Array, "K n"], period: int) -> Float[Array, "K n"]:
    """Mean over one period about each tick; an odd number of ticks, so that nothing is late."""
    mean: Float[Array, "K n"] = uniform_filter1d(q, period + 1 - period % 2, axis=0, mode="nearest")
    return mean
