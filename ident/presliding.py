"""Direction of sliding: how dry friction turns round when a joint does.

Bearings and gears turn their friction round over a small displacement: a stop operator, a spring of range r in series
with a slider, z⁺ = clip(z + Δq, −r, r), is ±1 (as z / r) while the joint slides and goes from one to the other over 2 r
after a reversal, however fast the joint moves there. Drives that compensate friction, and controllers that model it, do
so by a smooth sign of the speed, tanh(dq / v₀). Which of both an arm shows, and its figure, is found joint by joint.

Source: Al-Bender 2005 (generalised Maxwell slip).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit

from ident.arrays import Array, Float, freeze
from ident.loss import TRANSITION_GRID, direction
from ident.signals import Motion

# Ranges tried [rad]: beyond them friction with such a memory is an effect of its own.
RANGE_GRID = (2e-5, 5e-5, 1e-4, 2e-4, 4e-4)
# A range of fewer standard deviations of the position than this follows noise.
NOISE_FACTOR = 8.0


@njit(cache=True)
def stop_operator(q: Float[Array, " T"], size: float) -> Float[Array, " T"]:
    """State of a stop operator of a range along a path, from rest."""
    out = np.empty(len(q))
    state = 0.0
    out[0] = 0.0
    for k in range(1, len(q)):
        state = min(size, max(-size, state + q[k] - q[k - 1]))
        out[k] = state
    return out


@dataclass(frozen=True, eq=False)
class Sliding:
    """How each of n joints turns its friction round: over a range, or, where that is zero, over a speed.

    Attributes:
        range: Displacement r [rad].
        speed: v₀ [rad/s].
    """

    range: Float[Array, " n"]
    speed: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in ("range", "speed"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    def direction(self, motion: Motion) -> Float[Array, "T n"]:
        """Direction of sliding in [-1, 1] of each joint, unstressed at first."""
        slip = np.array(direction(motion.dq, self.speed))
        for j in np.flatnonzero(self.range > 0.0):
            slip[:, j] = stop_operator(np.ascontiguousarray(motion.q[:, j]), float(self.range[j])) / self.range[j]
        return slip


def fit_sliding(motions: Sequence[Motion], rigid: Sequence[Float[Array, "T n"]]) -> Sliding:
    """For each joint what leaves least of the torque beside Coulomb and viscous friction and rotor inertia.

    Args:
        motions: Runs.
        rigid: Modelled rigid torque of each run [N m], not filtered.
    """
    n = motions[0].n
    targets = [motion.tau_filtered - motion.filtered(torque) for motion, torque in zip(motions, rigid, strict=True)]
    grid = _grid(motions)
    misfit = np.array([_misfit(motions, targets, trial) for trial in grid])
    best = np.argmin(misfit, axis=0)
    return Sliding(
        np.array([grid[best[j]].range[j] for j in range(n)]), np.array([grid[best[j]].speed[j] for j in range(n)])
    )


def _grid(motions: Sequence[Motion]) -> list[Sliding]:
    """All trials; ranges no smaller than the position's noise allows."""
    n = motions[0].n
    least = NOISE_FACTOR * np.max([motion.std[0] for motion in motions], axis=0)
    ranges = [Sliding(np.maximum(size, least), np.ones(n)) for size in RANGE_GRID]
    return ranges + [Sliding(np.zeros(n), np.full(n, speed)) for speed in TRANSITION_GRID]


def _misfit(motions: Sequence[Motion], targets: Sequence[Float[Array, "t n"]], trial: Sliding) -> Float[Array, " n"]:
    """Sum of squares that each joint leaves where it moves [N² m²]."""
    found = np.zeros(motions[0].n)
    rows = [motion.filtered(np.stack([motion.ddq, motion.dq, trial.direction(motion)], axis=-1)) for motion in motions]
    for j in range(len(found)):
        x = np.concatenate([row[motion.moving[:, j], j] for row, motion in zip(rows, motions, strict=True)])
        y = np.concatenate([target[motion.moving[:, j], j] for target, motion in zip(targets, motions, strict=True)])
        found[j] = np.sum((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2)
    return found
