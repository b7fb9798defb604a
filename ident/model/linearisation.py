"""Direction of sliding: how dry friction turns round when a joint does.

Bearings and gears turn their friction round over a small displacement: a stop operator, a spring of
range r in series with a slider, z⁺ = clip(z + Δq, −r, r), is ±1 (as z / r) while the joint slides
and goes from one to the other over 2 r after a reversal, however fast the joint moves there. Drives
that compensate friction, and controllers that model it, do so by a smooth sign of the speed,
tanh(dq / v₀). Which of both an arm shows, and its figure, is found joint by joint.

Source: Al-Bender 2005 (generalised Maxwell slip).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.compiled import compiled
from ident.laws.friction_laws import bent
from ident.laws.motion import direction, follow
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion

# Samples in motion, all runs together, below which a joint has no loss to be fitted.
LEAST_MOVING = 20
# Ranges tried [rad]: beyond them friction with such a memory is an effect of its own.
RANGE_GRID = (2e-5, 5e-5, 1e-4, 2e-4, 4e-4)
# A range of fewer standard deviations of the position than this follows noise.
NOISE_FACTOR = 8.0
# Friction's possible curves beside the straight line: powers of the speed, the least of them
# straight below a knee [rad/s].
CONCAVE = (0.3, 0.6)
KNEES = (0.05, 0.2)
# What falls off at these speeds [rad/s], with these powers of the speed in the exponent.
FALLS = ((0.02, 1.0), (0.06, 1.0), (0.18, 1.0), (0.1, 2.0), (0.3, 2.0))
# What differs by so many nats is as likely.
AS_LIKELY = 2.0
# Length of the stretches by which misfits are held against each other [s].
STRETCH = 2.0

_follow = compiled(error_model="numpy", nogil=True)(follow)


def stop_operator(q: Float[Array, " T"], size: float) -> Float[Array, " T"]:
    """State of a stop operator of a range along a path, from rest."""
    out = np.empty(len(q))
    _follow(np.ascontiguousarray(q), size, out)
    return out


@dataclass(frozen=True, eq=False)
class Sliding:
    """How each of n joints turns its friction round: over a range, or else over a speed."""

    range: Float[Array, " n"]  # displacement r [rad]
    speed: Float[Array, " n"]  # v₀ [rad/s]

    def __post_init__(self) -> None:
        for name in ("range", "speed"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    def direction(self, motion: Motion) -> Float[Array, "T n"]:
        """Direction of sliding in [-1, 1] of each joint, unstressed at first."""
        slip = np.array(direction(motion.dq, self.speed))
        for j in np.flatnonzero(self.range > 0.0):
            angle = np.ascontiguousarray(motion.q[:, j])
            state = stop_operator(angle, float(self.range[j]))
            slip[:, j] = state / self.range[j]
        return slip


@dataclass(frozen=True, eq=False)
class _Known:
    """What all trials share of a run."""

    motion: Motion
    moving: Bool[Array, "t n"]  # where each joint moves
    # Filtered columns of motion and, last, torque to be explained; zero where it does not move.
    rows: Float[Array, "n t k"]
    sums: Float[Array, "s n k k"]  # their squares and products, stretch by stretch

    @classmethod
    def of(cls, motion: Motion, torque: Float[Array, "T n"]) -> _Known:
        """Columns of a run: acceleration, speed and concave curves over it, which turn sharply.

        Laws of friction are no slow turning.
        """
        moving = _between_rests(motion)
        target = motion.tau_filtered - motion.filtered(torque)
        heading = np.sign(motion.dq)
        pace = np.abs(motion.dq)
        curves = [(power, 0.0) for power in CONCAVE]
        curves += [(CONCAVE[0], knee) for knee in KNEES]
        concave = [heading * bent(pace, power, knee) for power, knee in curves]
        columns = motion.filtered(np.stack([motion.ddq, motion.dq, *concave], axis=-1))
        rows = np.concatenate([columns, target[:, :, None]], axis=2)
        rows = np.swapaxes(np.where(moving[:, :, None], rows, 0.0), 0, 1)
        rows = np.ascontiguousarray(rows)
        pieces = [rows[:, piece] for piece in _pieces(len(moving), motion)]
        sums = np.array([np.swapaxes(piece, 1, 2) @ piece for piece in pieces])
        return cls(motion, moving, rows, sums)

    @property
    def pieces(self) -> list[slice]:
        """Where each stretch lies among the filtered samples."""
        return _pieces(len(self.moving), self.motion)


def fit_sliding(
    motions: Sequence[Motion],
    rigid: Sequence[Float[Array, "T n"]],
    beside: Sequence[Float[Array, "T n"]] = (),
    freedom: int = 0,
) -> Sliding:
    """For each joint what leaves least of the torque beside inertia and concave friction.

    Inertia of the rotor, and friction of any concave law of speed.

    Args:
        motions: Runs.
        rigid: Modelled rigid torque of each run [N m], not filtered.
        beside: The same of a model with more freedom; none if empty. It counts at the joints where
            its evidence is greater (Schwarz 1978).
        freedom: How many numbers that model has more.
    """
    n = motions[0].n
    known = [_Known.of(motion, torque) for motion, torque in zip(motions, rigid, strict=True)]
    # Ranges no smaller than the position's noise allows.
    least = NOISE_FACTOR * np.max([motion.std[0] for motion in motions], axis=0)
    grid = [Sliding(np.maximum(size, least), np.ones(n)) for size in RANGE_GRID]
    grid += [Sliding(np.zeros(n), np.full(n, speed)) for speed in TRANSITION_GRID]
    stretches = []
    for run in known:
        stretches += [run.moving[piece].sum(axis=0) for piece in run.pieces]
    samples = np.array(stretches)
    misfit = np.array([_misfit(known, trial) for trial in grid])
    if beside:
        freer = [_Known.of(motion, torque) for motion, torque in zip(motions, beside, strict=True)]
        of_freer = np.array([_misfit(freer, trial) for trial in grid])
        gain = _worth(of_freer, samples) * np.log(_best(misfit) / _best(of_freer))
        counts = np.maximum(samples.sum(axis=0), 1.0)
        misfit = np.where(gain > freedom * np.log(counts), of_freer, misfit)
    best = _sharpest(misfit, samples)
    ranges = [grid[trial].range[joint] for joint, trial in enumerate(best)]
    speeds = [grid[trial].speed[joint] for joint, trial in enumerate(best)]
    return Sliding(np.array(ranges), np.array(speeds))


def _best(misfit: Float[Array, "trials stretches n"]) -> Float[Array, " n"]:
    """Each joint's misfit by the best trial."""
    return np.asarray(np.maximum(misfit.sum(axis=1), 1e-300).min(axis=0))


def _worth(
    misfit: Float[Array, "trials stretches n"], samples: Float[Array, "stretches n"]
) -> Float[Array, " n"]:
    """How many independent samples each joint's are worth.

    Neighbouring samples of torque err alike, and no trial is quite right: they count for as much
    less as the best one's misfit varies more over stretches of time than that of independent
    samples would.
    """
    count = np.maximum(samples.sum(axis=0), 1.0)
    best = misfit.sum(axis=1).argmin(axis=0)
    left = np.take_along_axis(misfit, best[None, None], axis=0)[0]
    variance = np.maximum(left.sum(axis=0) / count, 1e-300)
    alike = np.sum((left / variance - samples) ** 2, axis=0) / (2.0 * count)
    return np.asarray(count / np.maximum(alike, 1.0))


def _sharpest(
    misfit: Float[Array, "trials stretches n"], samples: Float[Array, "stretches n"]
) -> Int[Array, " n"]:
    """Of the turnings that are as likely as the best one, the first.

    Where friction's own law is smooth, any will do. Of so many trials the best is ahead of the
    others by chance: by the log of their number.
    """
    total = np.maximum(misfit.sum(axis=1), 1e-300)
    ratio = np.log(total / total.min(axis=0))
    worse = 0.5 * _worth(misfit, samples) * ratio
    return np.argmax(worse <= AS_LIKELY + np.log(len(misfit)), axis=0)


def _between_rests(motion: Motion) -> Bool[Array, "t n"]:
    """Where each joint moves, or turns round, out of the smoother's reach of a standstill.

    And of the run's ends. A smoothed speed dies away while the joint stands already, held by any
    torque: that looks like a slow turning.
    """
    clear = motion.moving.copy()
    for j, reach in enumerate(motion.blurred):
        still = np.concatenate([[True], ~motion.moving[:, j], [True]])
        edges = np.flatnonzero(np.diff(still.astype(int)))
        starts = edges[::2]
        ends = edges[1::2]
        # Between two stretches of motion lies a rest or a mere turn; before the first and after the
        # last, nobody knows.
        rests = starts[1:] - ends[:-1] > reach
        after_rest = np.concatenate([[True], rests])[: len(starts)]
        for start in starts[after_rest]:
            clear[start : start + reach, j] = False
        before_rest = np.concatenate([rests, [True]])[: len(ends)]
        for start, end in zip(starts[before_rest], ends[before_rest], strict=True):
            clear[max(end - reach, start) : end, j] = False
    return clear


def _pieces(samples: int, motion: Motion) -> list[slice]:
    """Where each stretch of a run lies among its filtered samples."""
    length = max(1, round(STRETCH / (motion.interval * motion.lowpass.factor)))
    return [slice(start, start + length) for start in range(0, samples, length)]


def _misfit(known: Sequence[_Known], trial: Sliding) -> Float[Array, "stretches n"]:
    """Sum of squares that each joint leaves where it moves, no term of friction driving it [N² m²].

    What falls off from rest turns round with dry friction: turning sharply it would make up for a
    slow turning.
    """
    grams = np.concatenate([_trial_sums(run, trial) for run in known])
    left = np.zeros(grams.shape[:2])
    for j, sums in enumerate(grams.sum(axis=0)):
        scale = np.sqrt(np.maximum(np.diag(sums), 1e-24))
        ridge = 1e-10 * np.eye(len(sums))
        root = np.linalg.cholesky(sums / np.outer(scale, scale) + ridge).T
        solution, _ = nnls(root[:, :-1], root[:, -1])
        weights = np.append(-solution, 1.0) * scale[-1] / scale
        left[:, j] = np.einsum("bac,a,c->b", grams[:, j], weights, weights)
    return left


def _trial_sums(run: _Known, trial: Sliding) -> Float[Array, "s n p p"]:
    """Squares and products of a trial's columns and the run's, stretch by stretch."""
    motion = run.motion
    pace = np.abs(motion.dq)
    slip = trial.direction(motion)
    falling = []
    for speed, power in FALLS:
        fade = (pace / speed) ** power
        falling.append(slip * np.exp(-fade))
    turning = motion.filtered(np.stack([slip, *falling], axis=-1))
    turning = np.moveaxis(np.where(run.moving[:, :, None], turning, 0.0), 0, 2)
    first = 1 + len(FALLS)
    count = first + run.rows.shape[2]
    grams = np.empty((*run.sums.shape[:2], count, count))
    grams[..., first:, first:] = run.sums
    for k, piece in enumerate(run.pieces):
        columns = turning[..., piece]
        beside = columns @ run.rows[:, piece]
        grams[k, :, :first, :first] = columns @ np.swapaxes(columns, 1, 2)
        grams[k, :, :first, first:] = beside
        grams[k, :, first:, :first] = np.swapaxes(beside, 1, 2)
    return grams
