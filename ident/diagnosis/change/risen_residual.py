"""Residuals that rose between two sets, by no law: vibration, a bearing, a loose cable.

A law's test asks whether torque follows a function of the motion; what shakes follows none. Here
the mean square of what a model leaves of each joint is compared, later set over earlier. With l_p
the logarithm of part p's, δ_j the difference of their means over the sets' parts and s_j its
standard deviation from their scatter within the sets, that of the joint or of all, whichever is
more, and of each part at least what a mean square of so many rows scatters by,

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
from functools import cached_property
from typing import NamedTuple

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


class _Mean(NamedTuple):
    """Mean logarithm of the mean squares of a set's parts, joint by joint, and its variance."""

    logs: Float[Array, " n"]
    variance: Float[Array, " n"]


@dataclass(frozen=True, eq=False)
class _Parts:
    """Mean squares of what a model leaves of the parts of both sets."""

    logs: Float[Array, "K n"]  # their logarithms; 0 of a part that tells nothing of a joint
    rows: Float[Array, "K n"]  # rows in motion behind each
    tells: Bool[Array, "K n"]  # whether a part has rows enough
    later: Bool[Array, " K"]  # its set

    def of(self, later: bool) -> Bool[Array, "K n"]:
        """The parts of a set that tell of each joint."""
        return np.asarray(self.tells & (self.later == later)[:, None])

    @cached_property
    def freedom(self) -> Int[Array, " n"]:
        """Parts that tell of each joint, less one a set."""
        return np.asarray(self.tells.sum(axis=0) - 2)

    @cached_property
    def seen(self) -> Int[Array, " s"]:
        """Joints of which two parts of either set tell, the fewest that have a scatter."""
        fewest = np.minimum(self.of(False).sum(axis=0), self.of(True).sum(axis=0))
        return np.flatnonzero(fewest >= 2)

    @cached_property
    def within(self) -> Float[Array, " n"]:
        """Variance between parts of one set: the joint's or that of all joints, whichever is more.

        A few parts alone tell no variance: that of all joints is one.
        """
        squares = np.zeros(self.logs.shape[1])
        for side in (False, True):
            of_side = self.of(side)
            mean = (of_side * self.logs).sum(axis=0) / np.maximum(of_side.sum(axis=0), 1)
            squares += (of_side * (self.logs - mean) ** 2).sum(axis=0)
        freedom = int(self.freedom[self.seen].sum())
        of_all = squares[self.seen].sum() / max(freedom, 1)
        return np.maximum(squares / np.maximum(self.freedom, 1), of_all)

    def mean(self, later: bool) -> _Mean:
        """That of a set; a part counts by how surely it is known."""
        of_rows = polygamma(1, 0.5 * np.maximum(self.rows, 1.0))
        weights = self.of(later) / np.maximum(self.within, of_rows)
        total = np.maximum(weights.sum(axis=0), 1e-300)
        return _Mean((weights * self.logs).sum(axis=0) / total, 1.0 / total)


def _parts_left(
    squares: Float[Array, "n B"],
    rows: Float[Array, "B n"],
    held_rows: Float[Array, "B n"],
    label: Int[Array, " B"],
    later: Bool[Array, " B"],
) -> _Parts:
    """The parts of both sets; arguments as in `find_risen`."""
    blocks_of = [np.flatnonzero(label == number) for number in range(int(label.max()) + 1)]
    total = np.stack([squares[:, blocks].sum(axis=1) for blocks in blocks_of])
    count = np.stack([rows[blocks].sum(axis=0) for blocks in blocks_of])
    in_motion = count - np.stack([held_rows[blocks].sum(axis=0) for blocks in blocks_of])
    is_later = np.array([bool(later[blocks[0]]) for blocks in blocks_of])
    tells = (in_motion >= CHANGE.fewest_rows) & (total > 0.0)
    divided_by = np.where(is_later[:, None], count, in_motion)
    ratio = np.where(tells, total, 1.0) / np.where(tells, divided_by, 1.0)
    return _Parts(np.log(ratio), in_motion, tells, is_later)


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
    parts = _parts_left(squares, rows, held_rows, label, later)
    seen = parts.seen
    if not len(seen):
        return ()
    before = parts.mean(False)
    after = parts.mean(True)
    rise = (after.logs - before.logs)[seen]
    freedom = int(parts.freedom[seen].sum())
    scatter = np.hypot(median_abs_deviation(rise, scale="normal"), CHANGE.usual_rise)
    error = np.sqrt((before.variance + after.variance)[seen] + scatter**2)
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
