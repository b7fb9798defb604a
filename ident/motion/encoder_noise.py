"""What encoders add to positions: white noise and the steps of their resolution, found from the log and drawn anew."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.motion.smoothing import NoiseLevels

# Changes from sample to sample are steps of a resolution where nearly all small ones are whole multiples of it. Of more
# than so many steps at once no remainder can be told.
STEPS_SHARE, WHOLE_WITHIN, MOST_STEPS = 0.98, 0.05, 10.0
LEAST_CHANGES = 20
# A finer step than this many standard deviations of the noise can't be told from none.
LEAST_STEP = 1.0


def find_resolution(position: Float[Array, "T n"]) -> Float[Array, " n"]:
    """Step of each joint's encoder as logged; 0 where there is none to be seen [rad].

    Args:
        position: Measured positions of a run [rad].
    """
    found = np.zeros(position.shape[1])
    for j, change in enumerate(np.abs(np.diff(position, axis=0)).T):
        moved = change[change > 1e-9]
        if len(moved) < LEAST_CHANGES:
            continue
        step = float(np.median(moved[moved < 1.5 * moved.min()]))
        multiples = moved[moved < MOST_STEPS * step] / step
        whole = np.abs(multiples - np.round(multiples)) < WHOLE_WITHIN
        if len(multiples) >= LEAST_CHANGES and np.mean(whole) > STEPS_SHARE:
            found[j] = step
    return found


def draw_errors(
    q: Float[Array, "T n"], levels: NoiseLevels, resolution: Float[Array, " n"], rng: np.random.Generator
) -> Float[Array, "T n"]:
    """Errors of one more measurement of a motion by the same encoders [rad].

    Args:
        q: The motion, smoothed [rad].
        levels: Noise of the joints.
        resolution: Of each encoder, 0 for none [rad].
        rng: Source of chance.
    """
    std = np.sqrt(levels.position)
    coarse = resolution > LEAST_STEP * std
    steps = np.where(coarse, resolution, 1.0)
    # Steps alone have a variance of a twelfth of their square; what is beyond that is noise before the step.
    before = np.where(coarse, np.sqrt(np.maximum(levels.position - resolution**2 / 12, 0.0)), std)
    error = before * rng.standard_normal(q.shape)
    shift = steps * rng.uniform(size=q.shape[1])
    stepped = steps * np.round((q + error + shift) / steps) - shift - q
    return np.where(coarse, stepped, error)
