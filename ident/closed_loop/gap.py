"""How far a model is from recordings that it never saw, in each joint's noise; and whether that is sure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ident.arrays import Array, Float
from ident.closed_loop.warmth import NO_WARMTH, Warmth
from ident.export.law_model import SimulatorModel, log_error
from ident.motion.motion import Motion

# A gap within so much of the noise counts as closed.
MARGIN = 1.10
# One-sided chance that a gap told to be closed is not.
DOUBT = 0.05


@dataclass(frozen=True, eq=False)
class GapFloors:
    """A model's torque gap in noise floors.

    Attributes:
        joints: RMS of what is left at each joint over its noise floor, shape (n,).
        together: Root mean square over the joints.
        upper: The same at the upper end of its one-sided interval, by how the runs differ.
    """

    joints: Float[Array, " n"]
    together: float
    upper: float

    @property
    def small(self) -> bool:
        """Whether hardly more than noise is left, as far as these runs say."""
        return self.together <= MARGIN

    @property
    def closed(self) -> bool:
        """Whether that is sure."""
        return self.upper <= MARGIN


def measure_floors(
    model: SimulatorModel, motions: Sequence[Motion], floors: Float[Array, " n"], warmth: Warmth = NO_WARMTH
) -> GapFloors:
    """Compares what a model says of the log with the log, both through the run's own filter, where a joint slides.

    Args:
        model: The model.
        motions: Runs.
        floors: Noise of each joint [N m].
        warmth: How warm the model's joints are before the first of these runs.
    """
    squares, counts = [], []
    for one, run in zip(warmth.along(model, motions), motions, strict=True):
        squares.append(np.sum((log_error(one, run) / floors) ** 2, axis=0))
        counts.append(run.settled.sum(axis=0))
    return pool_runs(np.array(squares), np.array(counts, dtype=float))


def pool_runs(squares: Float[Array, "R n"], counts: Float[Array, "R n"]) -> GapFloors:
    """Mean squares of runs of unequal length, and the upper bound of their mean over the joints.

    Neighbouring samples are copies of each other, so that a run counts as one draw; the variance is that of a ratio of
    sums. Joints that never slide are left out.

    Source: Cochran, Sampling Techniques (1977), section 6.3.
    """
    total = np.maximum(counts.sum(axis=0), 1.0)
    mean = squares.sum(axis=0) / total
    slid = counts.sum(axis=0) > 0
    runs, n = len(squares), max(int(slid.sum()), 1)
    # What each run adds to the mean over the joints, about its expectation.
    apart = ((squares - mean * counts) / total)[:, slid].sum(axis=1) / n
    together = float(mean[slid].sum() / n)
    if runs < 2:
        return GapFloors(np.sqrt(mean), float(np.sqrt(together)), np.inf)
    error = np.sqrt(np.sum(apart**2) * runs / (runs - 1))
    upper = together + student.ppf(1.0 - DOUBT, runs - 1) * error
    return GapFloors(np.sqrt(mean), float(np.sqrt(together)), float(np.sqrt(upper)))
