"""Ceiling of each joint: how much of the residual beside the accepted effects a function of the state could explain.

Two flexible functions are tried. The discrepancy (`inference.components`) is smooth over its inputs. A
nearest-neighbour mean over the joint's angle, each way by itself, finds what repeats many times a turn, such as torque
or friction of gear teeth; it is tested on other runs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from ident.arrays import Array, Float
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_CEILING, CeilingSettings


@dataclass(frozen=True, eq=False)
class Ceiling:
    """How much of a joint's residual can be explained."""

    rms: float  # residual that the better function would leave [N m]
    before: float  # residual beside the accepted effects [N m]
    kind: str | None  # its inputs: state, memory, time or coupling; None if no function explains the residual

    @property
    def ratio(self) -> float:
        """What the better function leaves of the residual, as a share; one where there is no residual."""
        return self.rms / self.before if self.before > 0.0 else 1.0


def measure_ceiling(
    series: Sequence[RunResidual],
    joint: int,
    share: float,
    kind: str | None,
    settings: CeilingSettings = USUAL_CEILING,
) -> Ceiling:
    """How much of a joint's residual beside the accepted effects can be explained.

    Args:
        series, joint: Residuals of all runs, and index of the joint.
        share, kind: What a discrepancy explains of its squares, and which block of it most; nothing where it is chance.
        settings: Thresholds of significance.
    """
    moving = [item.valid[:, joint] for item in series]
    y = np.concatenate([item.after[inside, joint] for item, inside in zip(series, moving, strict=True)])
    q = np.concatenate(
        [item.run.motion.q[item.run.motion.coarse][inside, joint] for item, inside in zip(series, moving, strict=True)]
    )
    dq = np.concatenate([item.speed[inside, joint] for item, inside in zip(series, moving, strict=True)])
    piece = np.concatenate(
        [np.full(int(inside.sum()), item.index) for item, inside in zip(series, moving, strict=True)]
    )
    before = float(np.sqrt(np.mean(y**2))) if len(y) else 0.0
    # Samples of opposite motion are no neighbours.
    each_way = q + np.where(dq < 0.0, 2.0 * np.ptp(q), 0.0) if len(q) else q
    repeated = _share_repeated_by_angle(each_way, y, piece, settings)
    if repeated > share:
        share, kind = repeated, "state"
    return Ceiling(before * float(np.sqrt(1.0 - share)), before, kind)


def _share_repeated_by_angle(
    q: Float[Array, " t"], y: Float[Array, " t"], piece: Array, settings: CeilingSettings
) -> float:
    """Share of the mean square that the same angles of other runs predict; 0 where it is not significant."""
    if len(np.unique(piece)) < settings.folds:
        piece = np.arange(len(y)) * 3 * settings.folds // max(len(y), 1)
    step = max(1, len(y) // settings.most_samples)
    q, y, piece = q[::step, None], y[::step], piece[::step]
    if len(y) < settings.least_samples:
        return 0.0
    fold = np.unique(piece, return_inverse=True)[1] % settings.folds
    falls = []
    for k in range(settings.folds):
        rest, held = fold != k, fold == k
        error = y[held] - _neighbours(q[rest], y[rest], q[held], settings)
        falls.append(1.0 - float(np.mean(error**2)) / max(float(np.mean(y[held] ** 2)), 1e-300))
        if sum(fall <= 0 for fall in falls) > settings.folds - settings.sure_folds:
            return 0.0
    mean, error = float(np.mean(falls)), float(np.std(falls, ddof=1)) / np.sqrt(settings.folds)
    return mean if mean > max(settings.least_fall, error) else 0.0


def _neighbours(
    x: Float[Array, "t 1"], y: Float[Array, " t"], other: Float[Array, "s 1"], settings: CeilingSettings
) -> Float[Array, " s"]:
    """Mean of the nearest samples, shrunk by the slope with which one half of the samples predicts the other."""
    half = np.arange(len(y)) * settings.folds // max(len(y), 1) % 2 == 0

    def nearest(one: Array, there: Array) -> Array:
        return np.asarray(y[one][KDTree(x[one]).query(there, settings.neighbours)[1]].mean(axis=1))

    predicted = np.concatenate([nearest(half, x[~half]), nearest(~half, x[half])])
    true = np.concatenate([y[~half], y[half]])
    shrink = np.clip(predicted @ true / max(float(predicted @ predicted), 1e-300), 0.0, 1.0)
    return np.asarray(shrink * nearest(np.ones(len(y), dtype=bool), other))
