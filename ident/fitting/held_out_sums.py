"""Sums of a fit's columns by parts of the recordings that are left out in turn.

    G_f = Σ x xᵀ,  w_f = Σ x dq Δt,   x = (columns, torque beside the URDF's arm) of one joint where it moves

Every question of the kind "would runs left out be foretold better with this?" is then small solves: what a model with
weights w leaves of a part is wᵀ G_f w, and the work that it errs by there wᵀ w_f. Rows are plain: filtered torque in
N m, wherever the joint moves, reversals included, as the torque is that a model will be asked for.

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
from ident.robot.arm import ArmModel

# Parts that are left out in turn: at the most, and at the least, for which few runs are cut.
MOST_PARTS, FEWEST_PARTS = 8, 4
# A joint's own columns: acceleration, speed, one, and the direction of motion at every width of its turning.
ROTOR, VISCOUS, CONSTANT, FIRST_DIRECTION = range(4)
OWN = FIRST_DIRECTION + len(TRANSITION_GRID)


@dataclass(frozen=True, eq=False)
class HeldOutSums:
    """Sums by joint and part; p columns of each joint: r base parameters, its own, and those of laws at it."""

    nominal: ArmModel  # the arm as its URDF describes it
    base: BaseParameters  # its base parameters
    laws: tuple[NamedLaw, ...]  # laws whose columns follow a joint's own
    squares: tuple[Float[Array, "f p p"], ...]  # of each joint, the torque last
    work: tuple[Float[Array, "f p"], ...]  # likewise
    counts: Float[Array, "f n"]  # rows

    @property
    def parts(self) -> int:
        return len(self.counts)

    def law_columns(self, number: int) -> Int[Array, " k"]:
        """Where the columns of a law stand among those of its joint."""
        own = self.laws[number]
        before = sum(law.size for law in self.laws[:number] if law.joint == own.joint)
        return self.base.rank + OWN + before + np.arange(own.size)


def split_parts(motions: Sequence[Motion]) -> list[Int[Array, " t"]]:
    """Part of every filtered sample: whole recorded runs, or pieces of them where they are few."""
    recorded = np.cumsum([not motion.continues for motion in motions]) - 1
    runs = int(recorded[-1]) + 1
    pieces = -(-FEWEST_PARTS // runs)
    lengths = np.array([motion.filtered_length for motion in motions])
    of_run = np.bincount(recorded, weights=lengths)
    found, before = [], np.zeros(runs)
    for run, length in zip(recorded, lengths, strict=True):
        place = (before[run] + np.arange(length)) * pieces // of_run[run]
        number = (run * pieces + place.astype(int)) * min(runs * pieces, MOST_PARTS) // (runs * pieces)
        found.append(number)
        before[run] += length
    return found


def gather_sums(
    motions: Sequence[Motion],
    nominal: ArmModel,
    base: BaseParameters,
    laws: Sequence[NamedLaw] = (),
    tuned: ArmModel | None = None,
    widths: Float[Array, " n"] | None = None,
) -> HeldOutSums:
    """One pass over the runs.

    Args:
        motions: Training runs; known payloads are part of the model.
        nominal: The arm as its URDF describes it.
        base: Its base parameters.
        laws: Laws of joints that may be asked for.
        tuned: The arm whose torque loads the joints in these laws; the nominal one if None.
        widths: Speed over which friction turns round in them [rad/s]; needed where there are laws.
    """
    n, parts = nominal.n, split_parts(motions)
    count = 1 + max(int(part.max()) for part in parts)
    sizes = [base.rank + OWN + sum(law.size for law in laws if law.joint == j) + 1 for j in range(n)]
    squares = tuple(np.zeros((count, size, size)) for size in sizes)
    work = tuple(np.zeros((count, size)) for size in sizes)
    counts = np.zeros((count, n))
    for motion, part in zip(motions, parts, strict=True):
        tables = _tables(motion, nominal, base, laws, tuned or nominal, widths)
        speed, step = motion.dq[motion.coarse], motion.interval * motion.lowpass.factor
        for j, table in enumerate(tables):
            for number in np.unique(part):
                rows = motion.moving[:, j] & (part == number)
                squares[j][number] += table[rows].T @ table[rows]
                work[j][number] += step * speed[rows, j] @ table[rows]
                counts[number, j] += rows.sum()
    return HeldOutSums(nominal, base, tuple(laws), squares, work, counts)


def _tables(
    motion: Motion,
    nominal: ArmModel,
    base: BaseParameters,
    laws: Sequence[NamedLaw],
    tuned: ArmModel,
    widths: Float[Array, " n"] | None,
) -> list[Float[Array, "t p"]]:
    """Each joint's filtered columns and torque of a run."""
    regressor = nominal.regressor(motion.q, motion.dq, motion.ddq, list(base.columns))
    turning = [np.tanh(motion.dq / width) for width in TRANSITION_GRID]
    own = np.stack([motion.ddq, motion.dq, np.ones_like(motion.dq), *turning], axis=-1)
    rigid = nominal.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
    load = rigid
    if laws and tuned is not nominal:
        load = tuned.with_payload(motion.payload).inverse_dynamics(motion.q, motion.dq, motion.ddq)
    slip = direction(motion.dq, np.zeros(nominal.n) if widths is None else widths)
    tables = []
    for j in range(nominal.n):
        states = states_of(j, motion.q, motion.dq, load, slip)
        beside = [law.columns(states) for law in laws if law.joint == j]
        columns = np.concatenate([regressor[:, j], own[:, j], *beside, rigid[:, j, None]], axis=1)
        table = motion.filtered(columns)
        table[:, -1] = motion.tau_filtered[:, j] - table[:, -1]
        tables.append(table)
    return tables
