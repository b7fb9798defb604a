"""References as simple controllers make them.

Such a controller is sent positions at a slow, even rate and joins them by straight lines; a moving
average over one period makes the velocity a chain of ramps (steps of acceleration), another one
makes the acceleration one (steps of jerk).
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from ident.arrays import Array, Float
from ident.trajectories.reference import TICK_S, ReferenceMotion

# Period at which positions are sent [s]: ordinary motions, and those that swing fast.
PERIOD_S = 0.08
FAST_PERIOD_S = 0.02
FAST = ("chirp",)
# Moving averages behind each shape.
AVERAGES = {"acceleration": 1, "jerk": 2}


def stepped(motion: ReferenceMotion, shape: str) -> ReferenceMotion:
    """A motion that rests at both ends as such a controller follows it.

    Args:
        motion: What it is asked for.
        shape: With steps of `jerk` or `acceleration`; unchanged if another one.
    """
    if shape not in AVERAGES:
        return motion
    seconds = FAST_PERIOD_S if motion.name in FAST else PERIOD_S
    period = round(seconds / TICK_S)
    ticks = np.arange(len(motion.q))
    last = len(motion.q) - 1
    sent = np.append(np.arange(0, len(motion.q), period), last)
    columns = [np.interp(ticks, sent, column[sent]) for column in motion.q.T]
    q = np.column_stack(columns)
    for _ in range(AVERAGES[shape]):
        # Mean over one period about each tick.
        width = period + 1 - period % 2
        mean: Float[Array, "K n"] = uniform_filter1d(q, width, axis=0, mode="nearest")
        q = mean
    dq = np.gradient(q, TICK_S, axis=0)
    ddq = np.gradient(dq, TICK_S, axis=0)
    return ReferenceMotion(motion.name, q, dq, ddq)
