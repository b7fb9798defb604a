"""Sums of a fit's columns by parts of the recordings that are left out in turn.

    G_f = Σ x xᵀ,  w_f = Σ x dq Δt,   x = (columns, torque beside the URDF's arm)

over the samples where a joint moves.

Every question of the kind "would runs left out be foretold better with this?" is then small solves:
what a model with weights w leaves of a part is wᵀ G_f w, and the work that it errs by there wᵀ w_f.
Rows are plain: filtered torque in N m, wherever the joint moves, reversals included, as the torque
is that a model will be asked for.

Source: Stone 1974 (choice by cross-validation).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, Int
from ident.laws.carried import NamedLaw, states_of
from ident.laws.motion import direction
from ident.model.inertia import BaseParameters
from ident.model.loss import TRANSITION_GRID
from ident.motion.motion import Motion
from ident.regression.partition import Partition
from ident.robot.arm import ArmModel

# Parts that are left out in turn: few runs are cut into pieces, many are put together. Over four
# parts a law has to help by 3.2 standard errors, over eight by 2.4. On 56 splits of twelve real
# arms fits by eight parts leave 3.6 % less torque on runs that nobody saw (geometric mean) than
# fits by as many parts as there are runs, at least four.
PARTS = 8
# A joint's own columns: acceleration, speed, one, and the direction of motion at every width of its
# turning.
ROTOR, VISCOUS, CONSTANT, FIRST_DIRECTION = range(4)
OWN = FIRST_DIRECTION + len(TRANSITION_GRID)


@dataclass(frozen=True, eq=False)
class HeldOutSums:
    """Sums by joint and part.

    A joint has p columns: those of r base parameters, its own, and those of laws at it.
    """

    nominal: ArmModel  # the arm as its URDF describes it
    base: BaseParameters  # its base parameters
    laws: tuple[NamedLaw, ...]  # laws whose columns follow a joint's own
    # Of each joint, what is left of the torque by the URDF's bodies last.
    squares: tuple[Float[Array, "f p p"], ...]
    # The share of these that lies in rows clear of starts, stops and reversals, where friction has
    # turned round; and how many rows these are.
    clear: tuple[Float[Array, "f p p"], ...]
    clear_counts: Float[Array, "f n"]
    work: tuple[Float[Array, "f p"], ...]  # likewise
    counts: Float[Array, "f n"]  # rows
    torques: Float[Array, "f n"]  # sums of the torque's squares over them [N² m²]

    @property
    def parts(self) -> int:
        """Number f of parts that are left out in turn."""
        return len(self.counts)

    def clear_rmse(
        self, clear: Float[Array, "f n"], others: Float[Array, " n"]
    ) -> Float[Array, " n"]:
        """Torque error of each joint clear of starts, stops and reversals [N m].

        Args:
            clear: Squares left of each part's clear rows.
            others: What is taken of joints with fewer such rows than parts.
        """
        counts = self.clear_counts.sum(axis=0)
        rmse = np.sqrt(clear.sum(axis=0) / np.maximum(counts, 1.0))
        enough = counts >= self.parts
        positive = rmse > 0.0
        return np.where(enough & positive, rmse, others)

    def law_columns(self, number: int) -> Int[Array, " k"]:
        """Where the columns of a law stand among those of its joint."""
        asked = self.laws[number]
        earlier = self.laws[:number]
        before = sum(law.size for law in earlier if law.joint == asked.joint)
        return self.base.rank + OWN + before + np.arange(asked.size)


@dataclass(frozen=True, eq=False)
class Tuned:
    """What is known of an arm before laws of friction are tried at its joints."""

    arm: ArmModel  # whose torque loads the joints in these laws
    widths: Float[Array, " n"]  # speed over which friction turns round in them [rad/s]
    dryness: Float[Array, " n"]  # dry friction of each joint over its noise


def split_parts(motions: Sequence[Motion]) -> list[Int[Array, " t"]]:
    """Part of every filtered sample: whole recorded runs, or pieces of them where they are few."""
    recorded = np.cumsum([not motion.continues for motion in motions]) - 1
    runs = int(recorded[-1]) + 1
    pieces = -(-PARTS // runs)
    all_pieces = runs * pieces
    lengths = np.array([motion.filtered_length for motion in motions])
    length_of_run = np.bincount(recorded, weights=lengths)
    before = np.zeros(runs)
    parts = []
    for run, length in zip(recorded, lengths, strict=True):
        place = (before[run] + np.arange(length)) * pieces // length_of_run[run]
        piece = run * pieces + place.astype(int)
        parts.append(piece * PARTS // all_pieces)
        before[run] += length
    return parts


def part_of_blocks(motions: Sequence[Motion], partition: Partition) -> Int[Array, " B"]:
    """The part that most of each block's samples lie in.

    Args:
        motions: The runs.
        partition: How a regression cuts them into blocks.
    """
    parts = split_parts(motions)
    size = (len(partition.folds), 1 + max(int(part_of_row.max()) for part_of_row in parts))
    counts = np.zeros(size, dtype=int)
    for run, part_of_row in enumerate(parts):
        np.add.at(counts, (partition.blocks_of(run, len(part_of_row)), part_of_row), 1)
    return np.argmax(counts, axis=1)


def gather_sums(
    motions: Sequence[Motion],
    nominal: ArmModel,
    base: BaseParameters,
    laws: Sequence[NamedLaw] = (),
    tuned: Tuned | None = None,
) -> HeldOutSums:
    """One pass over the runs.

    Args:
        motions: Training runs; known payloads are part of the model.
        nominal: The arm as its URDF describes it.
        base: Its base parameters.
        laws: Laws of joints that may be asked for.
        tuned: What is known beside the laws; needed where there are any. With it rows in which
            friction still turns round are less clear (`turned`).
    """
    n = nominal.n
    parts = split_parts(motions)
    count = 1 + max(int(part_of_row.max()) for part_of_row in parts)
    sizes = np.full(n, base.rank + OWN + 1)
    for law in laws:
        sizes[law.joint] += law.size
    squares = tuple(np.zeros((count, size, size)) for size in sizes)
    clear = tuple(np.zeros((count, size, size)) for size in sizes)
    work = tuple(np.zeros((count, size)) for size in sizes)
    counts = np.zeros((count, n))
    clear_counts = np.zeros((count, n))
    torques = np.zeros((count, n))
    for motion, part_of_row in zip(motions, parts, strict=True):
        tables = _tables(motion, nominal, base, laws, tuned)
        speed = motion.dq[motion.coarse]
        step = motion.interval * motion.lowpass.factor
        moving = motion.moving
        clear_weights = motion.settled.astype(float)
        if tuned is not None:
            clear_weights *= turned(speed, tuned.widths, tuned.dryness)
        for j, table in enumerate(tables):
            for number in np.unique(part_of_row):
                rows = moving[:, j] & (part_of_row == number)
                columns = table[rows]
                weights = clear_weights[rows, j]
                squares[j][number] += columns.T @ columns
                weighted = weights[:, None] * columns
                clear[j][number] += columns.T @ weighted
                power = speed[rows, j] @ columns
                work[j][number] += step * power
                counts[number, j] += rows.sum()
                clear_counts[number, j] += weights.sum()
                torques[number, j] += np.sum(motion.tau_filtered[rows, j] ** 2)
    return HeldOutSums(
        nominal, base, tuple(laws), squares, clear, clear_counts, work, counts, torques
    )


def turned(
    speed: Float[Array, "t n"], widths: Float[Array, " n"], dryness: Float[Array, " n"]
) -> Float[Array, "t n"]:
    """How clear of friction's turning each row is: 1 / (1 + d² (1 - |tanh(v / v₀)|)²).

    While friction turns round it is known to no more than what it lacks of its level: a joint may
    stick, creep, or turn in another way than by a tanh. What is lacking adds to the noise, and a
    row counts by one over its variance.

    Args:
        speed: Speeds [rad/s].
        widths: Speed over which each joint's friction turns round [rad/s].
        dryness: d, dry friction of each joint over its noise.
    """
    slip = np.tanh(speed / widths)
    lacking = dryness * (1.0 - np.abs(slip))
    variance = 1.0 + lacking**2
    return np.asarray(1.0 / variance)


def _tables(
    motion: Motion,
    nominal: ArmModel,
    base: BaseParameters,
    laws: Sequence[NamedLaw],
    tuned: Tuned | None,
) -> list[Float[Array, "t p"]]:
    """Each joint's filtered columns and torque of a run."""
    q = motion.q
    dq = motion.dq
    ddq = motion.ddq
    regressor = nominal.regressor(q, dq, ddq, list(base.columns))
    turning = [np.tanh(dq / width) for width in TRANSITION_GRID]
    joint_columns = np.stack([ddq, dq, np.ones_like(dq), *turning], axis=-1)
    rigid = nominal.with_payload(motion.payload).inverse_dynamics(q, dq, ddq)
    load = rigid
    slip = np.sign(dq)
    if laws and tuned is not None:
        load = tuned.arm.with_payload(motion.payload).inverse_dynamics(q, dq, ddq)
        slip = direction(dq, tuned.widths)
    tables = []
    for j in range(nominal.n):
        states = states_of(j, q, dq, load, slip)
        law_columns = [law.columns(states) for law in laws if law.joint == j]
        rest = rigid[:, j, None]
        columns = [regressor[:, j], joint_columns[:, j], *law_columns, rest]
        table = motion.filtered(np.concatenate(columns, axis=1))
        table[:, -1] = motion.tau_filtered[:, j] - table[:, -1]
        tables.append(table)
    return tables
