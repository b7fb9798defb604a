"""How much of what is left any function of the state could explain: the yardstick for "not in my catalogue".

Boosted trees are trained on the residual of one joint, on nested inputs, and judged on folds they never saw. What they
can't explain there is noise to anybody; what they explain and the named effects do not is a cause without a name. Which
set of inputs is the first that helps says of what kind it is: a function of the joint's state, of its past, of the
session's time, or of other joints. What repeats too often over an angle for trees to see, its neighbours foretell:
see `learners`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.diagnosis.gap.learners import Learner, neighbours, trees
from ident.diagnosis.gap.residuals import RunResidual
from ident.diagnosis.gap.settings import USUAL_TREES, TreeSettings

KINDS = ("state", "memory", "time", "coupling")


@dataclass(frozen=True, eq=False)
class Ceiling:
    """What trees make of one joint's residual.

    Attributes:
        rms: Held-out root mean square that is left [N m].
        before: Root mean square of the residual itself on the same samples [N m].
        kind: First set of inputs that helps, or None if nothing does.
        sure: Whether the fall is more than luck.
    """

    rms: float
    before: float
    kind: str | None
    sure: bool


def features(item: RunResidual, joint: int) -> Float[Array, "t f"]:
    """Inputs for one joint, ordered by kind: 5 of state, 3 of memory, 1 of time, 2 n − 2 of coupling."""
    motion = item.run.motion
    keep = motion.coarse
    q, dq, ddq = motion.q[keep], motion.dq[keep], motion.ddq[keep]
    state = [
        q[:, joint],
        dq[:, joint],
        ddq[:, joint],
        item.run.link[keep][:, joint],
        item.run.direction[keep][:, joint],
    ]
    age, moved, before = _since_reversal(item.time, q[:, joint], dq[:, joint])
    others = [k for k in range(motion.n) if k != joint]
    coupling = [values[:, k] for k in others for values in (q, dq)]
    return np.stack([*state, age, moved, before, item.time, *coupling], axis=1)


def _since_reversal(time: Array, q: Array, dq: Array) -> tuple[Array, Array, Array]:
    """Time and displacement since the last reversal, and the speed some samples ago."""
    turns = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1])
    last = turns[np.searchsorted(turns, np.arange(len(dq)), side="right") - 1]
    lag = np.concatenate([np.repeat(dq[:1], min(5, len(dq))), dq[:-5]])[: len(dq)]
    return time - time[last], q - q[last], lag


def measure_ceiling(
    series: Sequence[RunResidual],
    joint: int,
    settings: TreeSettings = USUAL_TREES,
    nested: bool = True,
    left: Literal["before", "after"] = "after",
    loud: bool = True,
) -> Ceiling:
    """What is learnt of what is left at a joint, judged on other runs (other stretches where runs are few).

    Args:
        series: Residuals of all runs.
        joint: The joint.
        settings: The learners, and what counts as more than luck.
        nested: Whether to ask for the first set of inputs that helps, and neighbours of the angle beside the trees.
        left: Before or after the named effects.
        loud: Whether more than noise is left, as far as that is known. Else only neighbours of the angle are asked:
            what repeats at an angle in other runs is no noise.
    """
    moving = [item.counts[:, joint] for item in series]
    y = np.concatenate([getattr(item, left)[inside, joint] for item, inside in zip(series, moving, strict=True)])
    piece = np.concatenate(
        [np.full(int(inside.sum()), item.index) for item, inside in zip(series, moving, strict=True)]
    )
    if len(np.unique(piece)) < settings.folds:
        piece = np.arange(len(y)) * 3 * settings.folds // max(len(y), 1)
    step = max(1, len(y) // settings.most_samples)
    y, piece = y[::step], piece[::step]
    before = float(np.mean(y**2)) if len(y) else 0.0
    if len(y) < settings.least_samples:
        return Ceiling(float(np.sqrt(before)), float(np.sqrt(before)), None, False)
    fold = _deal(piece, settings.folds)

    def inputs(of: Callable[[RunResidual], Float[Array, "t f"]]) -> Float[Array, "t f"]:
        return np.concatenate([of(item)[inside] for item, inside in zip(series, moving, strict=True)])[::step]

    full, sure, kind = before, False, None
    if loud:
        x = inputs(lambda item: features(item, joint))
        full, sure = _held_out(x, y, fold, settings, trees(settings))
        for name, width in {"state": 5, "memory": 8, "time": 9, "coupling": x.shape[1]}.items():
            if not (sure and nested):
                break
            part, _ = _held_out(x[:, :width], y, fold, settings, trees(settings))
            kind = name
            if before - part >= settings.enough * (before - full):
                break
    if nested:
        near = inputs(lambda item: item.run.motion.q[item.run.motion.coarse][:, [joint]])
        part, helps = _held_out(near, y, fold, settings, neighbours(settings))
        if helps and (part < full or not sure):
            full, sure, kind = part, True, "state"
    return Ceiling(float(np.sqrt(min(full, before))), float(np.sqrt(before)), kind, sure)


def _deal(piece: Array, folds: int) -> Array:
    """Pieces of time dealt out to folds in turn."""
    _, place = np.unique(piece, return_inverse=True)
    return place % folds


def _held_out(x: Array, y: Array, fold: Array, settings: TreeSettings, learner: Learner) -> tuple[float, bool]:
    """Mean square on held-out folds, and whether it falls in nearly all of them."""
    left = np.zeros(len(y))
    falls = []
    for k in range(settings.folds):
        held: Bool[Array, " t"] = fold == k
        left[held] = y[held] - learner(x[~held], y[~held], x[held])
        falls.append(1.0 - np.mean(left[held] ** 2) / np.mean(y[held] ** 2))
        if sum(fall <= 0 for fall in falls) > settings.folds - settings.sure_folds:
            return float(np.mean(y**2)), False  # sure it can't be any more
    sure = float(np.mean(falls)) > settings.least_fall and sum(fall > 0 for fall in falls) >= settings.sure_folds
    return float(np.mean(left**2)), bool(sure and np.mean(falls) > np.std(falls, ddof=1) / np.sqrt(settings.folds))
