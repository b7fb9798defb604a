"""Ceiling of each joint: what a function of the state could explain beside the accepted effects.

Two flexible functions are tried. The discrepancy (`inference.components`) is smooth over its
inputs. A nearest-neighbour mean over the joint's angle, each way by itself, finds what repeats many
times a turn, such as torque or friction of gear teeth; it is tested on other runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ident.arrays import Array, Float
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_CEILING, CeilingSettings
from ident.inference.joints_left import NOT_TESTED, Repeated


@dataclass(frozen=True, eq=False)
class Ceiling:
    """How much of a joint's residual can be explained."""

    rms: float  # residual that the better function would leave [N m]
    before: float  # residual beside the accepted effects [N m]
    # Its inputs: state, memory, time or coupling; None if no function explains the residual.
    kind: str | None

    @property
    def ratio(self) -> float:
        """Residual beside the better function over that without it, root mean squares; 1 where
        there is none.
        """
        return self.rms / self.before if self.before > 0.0 else 1.0


def measure_ceiling(
    series: Sequence[RunResidual], joint: int, share: float, kind: str | None
) -> Ceiling:
    """How much of a joint's residual beside the accepted effects can be explained.

    Args:
        series, joint: Residuals of all runs, and index of the joint.
        share, kind: What a flexible function explains of its squares, and the kind of its inputs;
            nothing where it is chance.
    """
    residuals = [item.after[item.valid[:, joint], joint] for item in series]
    left = np.concatenate(residuals)
    before = float(np.sqrt(np.mean(left**2))) if len(left) else 0.0
    return Ceiling(before * float(np.sqrt(1.0 - share)), before, kind)


def find_repeated(
    series: Sequence[RunResidual], joint: int, settings: CeilingSettings = USUAL_CEILING
) -> Repeated:
    """What the same angles of other runs predict of a joint's residual.

    Args:
        series, joint, settings: Residuals of all runs, index of the joint, and how it is tested.
    """
    lefts = []
    angles = []
    speeds = []
    pieces = []
    for item in series:
        motion = item.run.motion
        moving = item.valid[:, joint]
        lefts.append(item.after[moving, joint])
        angles.append(motion.q[motion.coarse][moving, joint])
        speeds.append(item.speed[moving, joint])
        pieces.append(np.full(int(moving.sum()), item.index))
    left = np.concatenate(lefts)
    if len(left) == 0:
        return NOT_TESTED
    angle = np.concatenate(angles)
    speed = np.concatenate(speeds)
    # Samples of opposite motion are no neighbours.
    each_way = angle + np.where(speed < 0.0, 2.0 * np.ptp(angle), 0.0)
    return _repeated_by_angle(each_way, left, np.concatenate(pieces), settings)


def _repeated_by_angle(
    q: Float[Array, " t"], y: Float[Array, " t"], piece: Array, settings: CeilingSettings
) -> Repeated:
    """What the same angles of other pieces predict of the mean square."""
    if len(np.unique(piece)) < settings.folds:
        pieces = 3 * settings.folds
        piece = np.arange(len(y)) * pieces // max(len(y), 1)
    step = max(1, len(y) // settings.most_samples)
    q = q[::step, None]
    y = y[::step]
    piece = piece[::step]
    if len(y) < settings.least_samples:
        return NOT_TESTED
    fold = np.unique(piece, return_inverse=True)[1] % settings.folds
    falls = []
    for k in range(settings.folds):
        rest = fold != k
        held = fold == k
        foretold = _neighbours(q[rest], y[rest], q[held], settings)
        left = y[held] - foretold
        square = max(float(np.mean(y[held] ** 2)), 1e-300)
        falls.append(1.0 - float(np.mean(left**2)) / square)
    error = float(np.std(falls, ddof=1)) / np.sqrt(settings.folds)
    return Repeated(float(np.mean(falls)), error)


def _neighbours(
    x: Float[Array, "t 1"],
    y: Float[Array, " t"],
    other: Float[Array, "s 1"],
    settings: CeilingSettings,
) -> Float[Array, " s"]:
    """Mean of the nearest samples, shrunk.

    By the slope with which one half of the samples predicts the other.

    Args:
        x, y: Where the samples are, and their values.
        other: Where a mean is wanted.
        settings: How many neighbours, and how many pieces make the halves.
    """
    piece = np.arange(len(y)) * settings.folds // max(len(y), 1)
    half = piece % 2 == 0

    def nearest(asked: Array, there: Array) -> Array:
        _, neighbours = KDTree(x[asked]).query(there, settings.neighbours)
        return np.asarray(y[asked][neighbours].mean(axis=1))

    of_other = nearest(half, x[~half])
    of_half = nearest(~half, x[half])
    predicted = np.concatenate([of_other, of_half])
    true = np.concatenate([y[~half], y[half]])
    shrink = np.clip(predicted @ true / max(float(predicted @ predicted), 1e-300), 0.0, 1.0)
    return np.asarray(shrink * nearest(np.ones(len(y), dtype=bool), other))
