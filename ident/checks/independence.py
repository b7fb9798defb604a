"""Does a joint's motion tell what goes with its angle from what goes with its acceleration, and show it repeatedly?

In one sinusoid the acceleration is the angle times a constant: rotor and link inertia, a spring and gravity's slope are
then one figure, however long it was recorded, and no held-out part of it says otherwise.
Optimised and everyday motion shows shares of 0.3 to 0.95.

Source: Marquardt, Generalized inverses, ridge regression, biased linear estimation (1970): inflation beyond ten.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.checks.settings import USUAL_EXCITATION, ExcitationSettings

# Parts of a single recording that are left out in turn, as the held-out splits do.
PARTS = 5


@dataclass(frozen=True)
class MotionShown:
    """What the recordings show of each joint.

    Attributes:
        share: Of the acceleration's variance that does not follow from the angle, the least over what is left where
            one recording is left out; NaN where the joint does not move.
        strokes: Strokes in the positive and in the negative direction.
        settings: How much is enough.
    """

    share: Float[Array, " n"]
    strokes: Int[Array, "2 n"]
    settings: ExcitationSettings = USUAL_EXCITATION

    @property
    def one_sinusoid(self) -> Bool[Array, " n"]:
        """Joints whose acceleration follows from their angle."""
        return self.share < self.settings.least_share

    @property
    def once(self) -> Bool[Array, " n"]:
        """Joints that move, but in one direction less often than it takes to repeat it."""
        return np.isfinite(self.share) & (self.strokes.min(axis=0) < self.settings.least_strokes)


class Independence:
    """Sums over recordings, each taken and none kept.

    Args:
        settings: How much is enough.
    """

    def __init__(self, settings: ExcitationSettings = USUAL_EXCITATION) -> None:
        self._settings, self._travel = settings, settings.least_travel
        self._sums: list[list[Float[Array, "5 5"]]] = []
        self._strokes: Int[Array, "2 n"] = np.zeros((2, 0), dtype=int)

    def take(self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> None:
        """Adds one recording's filtered motion."""
        joints = q.shape[1]
        if not self._sums:
            self._sums, self._strokes = [[] for _ in range(joints)], np.zeros((2, joints), dtype=int)
        for j in range(joints):
            if np.ptp(q[:, j]) >= self._travel:
                table = np.column_stack([np.ones(len(q)), q[:, j], np.sin(q[:, j]), np.cos(q[:, j]), ddq[:, j]])
                self._sums[j].append(np.stack([part.T @ part for part in np.array_split(table, PARTS)]))
            self._strokes[:, j] += count_strokes(q[:, j], dq[:, j], self._travel)

    def shown(self) -> MotionShown:
        """All that was taken, together; the shares are the least where one recording, or a part of it, is left out."""
        least = []
        for taken in self._sums:
            parts = np.array([one.sum(axis=0) for one in taken] if len(taken) > 1 else list(taken[0]) if taken else [])
            shares = _shares(parts.sum(axis=0) - parts) if taken else np.empty(0)
            least.append(float(np.min(shares[np.isfinite(shares)])) if np.isfinite(shares).any() else np.nan)
        return MotionShown(np.array(least), self._strokes, self._settings)


def count_strokes(q: Float[Array, " T"], dq: Float[Array, " T"], travel: float) -> tuple[int, int]:
    """Pieces of motion between reversals that go far enough, in the positive and in the negative direction."""
    cuts = np.r_[0, np.flatnonzero(np.diff(np.sign(dq))) + 1, len(q) - 1]
    gone = np.diff(q[cuts])
    return int((gone > travel).sum()), int((gone < -travel).sum())


def _shares(sums: Float[Array, "p 5 5"]) -> Float[Array, " p"]:
    """Of the last column's variance, what does not follow from the others; of several sums."""
    columns, target = sums[:, :4, :4], sums[:, :4, 4]
    size = np.sqrt(np.maximum(np.diagonal(columns, axis1=1, axis2=2), 1e-300))
    inverse = np.linalg.pinv(columns / (size[:, :, None] * size[:, None, :]), rcond=1e-9, hermitian=True)
    explained = np.einsum("pi,pij,pj->p", target / size, inverse, target / size)
    variance = sums[:, 4, 4] - target[:, 0] ** 2 / sums[:, 0, 0]
    known = variance > 0.0
    share = np.divide(sums[:, 4, 4] - explained, variance, out=np.full(len(sums), np.nan), where=known)
    return np.where(known, np.clip(share, 0.0, 1.0), np.nan)
