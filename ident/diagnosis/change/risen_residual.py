"""Residuals that rose between two sets, by no law: vibration, a bearing, a loose cable.

A law's test asks whether torque follows a function of the motion; what shakes follows none. Here
the mean square of what a model leaves of each joint is compared, later set over earlier. With l_p
the logarithm of part p's, δ_j the difference of their means over the sets' parts and s_j its
standard deviation from their scatter within the sets, that of the joint or of all, whichever is
more, and at least what a mean square of so many rows scatters by,

    t_j = (δ_j − median δ) / √(s_j² + τ²),

where τ is the robust scatter of the δ of all joints: sets whose motions differ leave different
residuals everywhere, and no such difference is a joint's own.

What a joint's holds leave is no measure of its noise, for static friction takes it up: of the
earlier set all squares count as those of its rows in motion, of the later one as those of all rows,
so that holds never make a rise.

Source: Bartlett and Kendall 1946 (log variances are compared as means); Rousseeuw and Croux 1993
(scale by medians).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import polygamma
from scipy.stats import median_abs_deviation
from scipy.stats import t as student

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.change.settings import CHANGE
from ident.records import JsonRecord


@dataclass(frozen=True)
class RisenResidual:
    """A joint of which the later set leaves more that follows no law."""

    joint: str  # its name
    ratio: float  # root mean square of what is left, later over earlier
    low: float  # 95 % interval of that
    high: float
    p_value: float  # corrected for the number of joints

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: `joint`, `ratio` with `low` and `high`, and `p_value`."""
        return dict(vars(self))


def find_risen(
    squares: Float[Array, "n B"],
    rows: Float[Array, "B n"],
    held_rows: Float[Array, "B n"],
    label: Int[Array, " B"],
    later: Bool[Array, " B"],
    joints: Sequence[str],
) -> tuple[RisenResidual, ...]:
    """The joints whose residual rose significantly beside what the others' did.

    Args:
        squares, rows: What a model leaves of each joint's rows in each block, in squares of the
            noise; their number.
        held_rows: How many of them are holds.
        label, later: Part of its set and set of each block.
        joints: Names of the joints.

    Returns:
        Empty where nothing rose, or too few joints or parts tell.
    """
    earlier_parts = np.unique(label[~later])
    later_parts = np.unique(label[later])
    if min(len(earlier_parts), len(later_parts)) < 2:
        return ()
    blocks_of = [label == number for number in range(int(label.max()) + 1)]
    total = np.stack([squares[:, blocks].sum(axis=1) for blocks in blocks_of])
    count = np.stack([rows[blocks].sum(axis=0) for blocks in blocks_of])
    in_motion = count - np.stack([held_rows[blocks].sum(axis=0) for blocks in blocks_of])
    enough_rows = (in_motion >= CHANGE.fewest_rows).all(axis=0)
    seen = np.flatnonzero(enough_rows & (total > 0.0).all(axis=0))
    if not len(seen):
        return ()
    of_earlier = np.ix_(earlier_parts, seen)
    of_later = np.ix_(later_parts, seen)
    before = np.log(total[of_earlier] / in_motion[of_earlier])
    after = np.log(total[of_later] / count[of_later])
    freedom = len(before) + len(after) - 2
    rise = after.mean(axis=0) - before.mean(axis=0)
    of_before = len(before) * before.var(axis=0)
    of_after = len(after) * after.var(axis=0)
    within = (of_before + of_after) / freedom
    # A few parts alone tell no variance: that of all joints is one.
    of_rows = polygamma(1, 0.5 * in_motion[:, seen]).mean(axis=0)
    within = np.maximum(np.maximum(within, within.mean()), of_rows)
    freedom *= len(seen)
    scatter = np.hypot(median_abs_deviation(rise, scale="normal"), CHANGE.usual_rise)
    of_means = within * (1.0 / len(before) + 1.0 / len(after))
    error = np.sqrt(of_means + scatter**2)
    score = (rise - np.median(rise)) / error
    p_values = np.minimum(len(seen) * student.sf(score, freedom), 1.0)
    reach = float(student.ppf(0.975, freedom)) * error
    risen = []
    for k, j in enumerate(seen.tolist()):
        p_value = float(p_values[k])
        if p_value < CHANGE.risen_by_chance:
            ends = rise[k] + reach[k] * np.array([0.0, -1.0, 1.0])
            # A rise of a logarithm of squares by x is a ratio of roots of exp(x / 2).
            ratio, low, high = np.exp(0.5 * ends).tolist()
            risen.append(RisenResidual(joints[j], ratio, low, high, p_value))
    return tuple(risen)
