"""Intervals about a value that lies beside the one of least variance.

Let the value of least variance be off by s T, T by Student's t, and a value that is preferred for
another reason lie d beside it. What the truth is off the preferred one is d + s T, and an interval
about that value that holds the truth with probability p has the half width c with

    F((c − d) / s) − F((−c − d) / s) = p.

It is s times the usual quantile for d = 0, and |d| and s times the quantile of one side where d is
large: less than a normal interval of the mean square error, s² + d², would be.
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtr, stdtrit

from ident.arrays import Array, Float

# Degrees of freedom from which on Student's t is the normal distribution.
MOST_DOF = 1e6
# Halvings of the range in which a half width is looked for.
HALVINGS = 50


def quantile(dof: Float[Array, "..."], level: float = 0.95) -> Float[Array, "..."]:
    """Half width of an interval in standard deviations, by Student's t."""
    return np.asarray(stdtrit(np.minimum(dof, MOST_DOF), 0.5 + level / 2))


def half_width(
    deviation: Float[Array, "..."],
    shift: Float[Array, "..."],
    dof: Float[Array, "..."],
    level: float = 0.95,
) -> Float[Array, "..."]:
    """Half width of intervals about values beside those of least variance.

    Args:
        deviation: Standard deviation of the values of least variance.
        shift: How far beside those the intervals' middles lie.
        dof: Degrees of freedom of the standard deviations.
        level: Probability with which an interval holds the truth.
    """
    plain = quantile(dof, level) * deviation
    if not np.any(shift):
        return np.asarray(plain)
    degrees = np.minimum(dof, MOST_DOF)
    off = np.abs(shift)
    unit = np.maximum(deviation, np.finfo(float).tiny)
    low = np.zeros_like(off)
    high = off + plain
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        held = stdtr(degrees, (middle - off) / unit) - stdtr(degrees, (-middle - off) / unit)
        enough = held >= level
        high = np.where(enough, middle, high)
        low = np.where(enough, low, middle)
    return np.asarray(np.where(off > 0.0, high, plain))
