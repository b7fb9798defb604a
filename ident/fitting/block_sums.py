"""One pass over the runs: second moments of torque and columns, joint by joint and block by block.

All that the joint estimate asks of the data (weights, run effects, scores, what is left) is a sum of small matrices
over blocks of 1.5 s, so memory doesn't grow with the recording, and repeated weighting costs no second pass.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.laws.carried import NamedLaw, named_columns
from ident.model.inertia import BaseParameters
from ident.motion.motion import Motion
from ident.robot.arm import ArmModel

# Length of the blocks whose scores are taken as independent: several times the correlation time of residuals of
# arms (0.1 to 0.3 s) [s].
BLOCK_DURATION = 1.5
# Neighbouring blocks are added up as soon as there are twice as many, so that ten hours of six joints take 160 MB.
MOST_BLOCKS = 1000
# A joint with a smaller share of its moving samples clear of reversals is fitted where it moves at all.
LEAST_SETTLED = 0.1
LEAST_ROWS = 20
LOSS_COLUMNS = 4  # acceleration, speed, direction, one
# Blurs by which rows keep further away from stops and turns than samples that count as settled. After one blur the
# filter still rings with 2 % of a step, after one and a half with 0.6 %; a stop's unknown friction is such a step, it
# goes with the acceleration, and at one blur it made rotor inertia 1 to 2 % too small in recordings without any noise.
EXTRA_PERIODS = 0.5


@dataclass(frozen=True, eq=False)
class BlockSums:
    """Sums over the rows that count; b blocks, n joints, k = r + 4 columns and the torque as the last one.

    Columns: the r base parameters' regressor columns, then acceleration, speed, direction and one.
    """

    moments: Float[Array, "b n c c"]  # XᵀX of each block and joint, shape (b, n, k + 1, k + 1)
    rows: Int[Array, "b n"]  # number of rows, shape (b, n)
    run: Int[Array, " b"]  # index of the run that each block lies in
    through_reversals: tuple[str, ...]  # joints for which samples near reversals had to be used too
    rank: int  # number r of base parameters
    shared: int = 0  # number of columns of named laws, between those of the losses and the torque

    def of(self, columns: Sequence[int]) -> tuple[Float[Array, "b n p p"], Float[Array, "b n p"], Float[Array, "b n"]]:
        """XᵀX, Xᵀy and yᵀy of some columns."""
        count = len(columns)
        if list(columns) == list(range(count)):  # the usual case, without copies
            chosen = self.moments[:, :, :count]
            return chosen[..., :count], chosen[..., -1], self.moments[..., -1, -1]
        chosen = self.moments[:, :, columns]
        return chosen[..., columns], chosen[..., -1], self.moments[..., -1, -1]


@dataclass(frozen=True, eq=False)
class FitColumns:
    """What a fit asks of a run."""

    arm: ArmModel  # the arm as its URDF describes it; the torque is what it leaves
    base: BaseParameters  # its base parameters
    named: Sequence[NamedLaw] = ()  # laws of joints whose coefficients are parameters too
    bearing: ArmModel | None = None  # the arm whose rigid torque is the joints' load; the arm itself if None

    @property
    def shared(self) -> int:
        """Number of columns of named laws."""
        return sum(law.size for law in self.named)

    def of(self, motion: Motion) -> Float[Array, "t n c"]:
        """Columns and torque of a run through the common filter.

        Direction is a plain sign: clear of reversals it is one, and any smooth step would be mistaken for lower
        friction at low speed (with a width of 0.02 rad/s Coulomb friction came out 0.6 % too high and viscous 0.6 %
        too low).
        """
        q, dq, ddq = motion.q, motion.dq, motion.ddq
        known = self.arm.with_payload(motion.payload).inverse_dynamics(q, dq, ddq)
        filtered = motion.filtered(np.stack([ddq, dq, np.sign(dq), motion.tau - known], axis=-1))
        parts = [motion.filtered(self.arm.regressor(q, dq, ddq, self.base.columns)), filtered[..., :3]]
        parts.append(np.ones_like(filtered[..., :1]))
        if self.named:
            load = (self.bearing or self.arm).with_payload(motion.payload).inverse_dynamics(q, dq, ddq)
            parts.append(motion.filtered(named_columns(self.named, q, dq, load)))
        return np.concatenate([*parts, filtered[..., 3:]], axis=-1)


def sum_blocks(motions: Sequence[Motion], columns: FitColumns, through: Bool[Array, " n"] | None = None) -> BlockSums:
    """Goes through the runs once.

    Args:
        motions: Runs; known payloads are part of the model.
        columns: What is asked of each.
        through: Joints of which all moving rows count.
    """
    moving, settled = (
        sum((one(motion).sum(axis=0) for motion in motions), np.zeros(motions[0].n))
        for one in (lambda motion: motion.moving, clear_of_stops)
    )
    too_few = np.asarray(settled < np.maximum(LEAST_ROWS, LEAST_SETTLED * moving))
    use_moving = too_few if through is None else too_few | through
    moments: list[Array] = []
    rows: list[Array] = []
    runs: list[int] = []
    for motion, run in zip(motions, run_numbers(motions), strict=True):
        x, mask = columns.of(motion), np.where(use_moving, motion.moving, clear_of_stops(motion))
        x[~mask] = 0.0
        label = ((motion.time[motion.coarse] - motion.time[0]) // BLOCK_DURATION).astype(int)
        edges = [0, *(np.flatnonzero(np.diff(label)) + 1), len(label)]
        for start, end in pairwise(edges):
            part = x[start:end].transpose(1, 0, 2)
            moments.append(part.transpose(0, 2, 1) @ part)
            rows.append(mask[start:end].sum(axis=0))
            runs.append(run)
        if len(moments) >= 2 * MOST_BLOCKS:
            moments, rows, runs = _in_pairs(moments, rows, runs)
    joints = tuple(name for name, all_of_it in zip(motions[0].joints, too_few, strict=True) if all_of_it)
    parts = np.array(moments), np.array(rows), np.array(runs)
    return BlockSums(*parts, joints, columns.base.rank, columns.shared)


def run_numbers(motions: Iterable[Motion]) -> list[int]:
    """Number of the recorded run that each motion is, or is a piece of."""
    numbers: list[int] = []
    before = None
    for motion in motions:
        name = re.sub(r"(\[\d+\])+$", "", motion.name)
        piece = name != motion.name and name == before
        numbers.append(numbers[-1] if numbers and (piece or motion.continues) else (numbers[-1] + 1 if numbers else 0))
        before = name
    return numbers


def clear_of_stops(motion: Motion) -> Bool[Array, "t n"]:
    """Where each joint moves and the filter's ringing after a stop or a turn has died away."""
    clear = motion.settled.copy()
    reach = np.round(EXTRA_PERIODS * motion.blurred).astype(int)
    for shift in range(1, min(int(reach.max()), len(clear) - 1) + 1):
        beyond = shift > reach
        clear[shift:] &= motion.settled[:-shift] | beyond
        clear[:-shift] &= motion.settled[shift:] | beyond
    return clear


def _in_pairs(moments: list[Array], rows: list[Array], runs: list[int]) -> tuple[list[Array], list[Array], list[int]]:
    """Neighbouring blocks of one run added up."""
    kept: tuple[list[Array], list[Array], list[int]] = ([], [], [])
    i = 0
    while i < len(runs):
        pair = i + 1 < len(runs) and runs[i + 1] == runs[i]
        kept[0].append(moments[i] + moments[i + 1] if pair else moments[i])
        kept[1].append(rows[i] + rows[i + 1] if pair else rows[i])
        kept[2].append(runs[i])
        i += 2 if pair else 1
    return kept
