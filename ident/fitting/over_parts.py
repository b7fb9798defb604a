"""What parts of recordings say of a change of the model: whether it helps, whether work gets worse.

Each function is given a figure of every part before the change and after it.

Source: Student 1908 (the test over parts); Breiman, Friedman, Olshen and Stone 1984, section 3.4.3
(one standard error).
"""

from __future__ import annotations

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float

# How sure it must be over the parts that a law helps, by Student's test of both sides at 95 %.
SURE = 0.975
# The same of one side: once it is sure, that rows clear of reversals, of which there are fewer, do
# not speak against it.
CONFIRMED = 2.0 * SURE - 1.0


def surely_less(before: Float[Array, " f"], after: Float[Array, " f"]) -> bool:
    """Whether sums over parts fall by more than one standard error of their fall."""
    fall = before - after
    if len(fall) < 2:
        return bool(fall.sum() > 0.0)
    return bool(fall.mean() > standard_error(fall))


def helps(before: Float[Array, " f"], after: Float[Array, " f"], sure: float = SURE) -> bool:
    """Whether sums over parts fall, by Student's test over the parts.

    Returns:
        False where there are fewer than two parts.
    """
    fall = before - after
    if len(fall) < 2:
        return False
    needed = float(stdtrit(len(fall) - 1, sure))
    return bool(fall.mean() > needed * standard_error(fall))


def helps_alike(before: Float[Array, " f"], after: Float[Array, " f"], sure: float = SURE) -> bool:
    """Whether logarithms of squares fall, by Student's test over the parts that have any.

    That is the likelihood where each part has noise of its own: one that is foretold badly in any
    case counts no more than another.
    """
    positive = np.minimum(before, after) > 0.0
    log_before = np.log(before[positive])
    log_after = np.log(after[positive])
    return helps(log_before, log_after, sure)


def no_worse_work(before: Float[Array, " f"], after: Float[Array, " f"]) -> bool:
    """Whether squares of work errors grow by at most one standard error of their growth."""
    growth = after**2 - before**2
    if len(growth) < 2:
        return bool(growth.sum() <= 0.0)
    return bool(growth.mean() <= standard_error(growth))


def standard_error(change: Float[Array, " f"]) -> float:
    """Standard error of the mean over the parts."""
    return float(change.std(ddof=1) / np.sqrt(len(change)))
