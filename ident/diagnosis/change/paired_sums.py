"""Block sums of every candidate in all runs, and in the later set alone, from one pass over the
recordings.

A candidate's columns in all runs belong to the shared baseline; its columns in the later set alone
are the change. A block lies in one set, so the sums of the second kind are those of the first with
the earlier set's blocks set to zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Int
from ident.diagnosis.change.candidates import IN_THE_BASELINE, ChangeOf
from ident.diagnosis.change.settings import CHANGE
from ident.effects import optional
from ident.effects.base import SessionContext, Variant
from ident.recordings.blocks import block_length
from ident.regression.block_sums import SymmetricSums
from ident.regression.design import LOSS_PARAMETERS, Group, Layout
from ident.regression.dwells import DwellRows, HeldFriction
from ident.regression.gram import Evidence
from ident.regression.partition import Partition
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings


@dataclass(frozen=True, eq=False)
class Sides:
    """The set to which each run and each block belongs."""

    later: Bool[Array, " R"]  # whether each run is of the later set
    run_of_block: Int[Array, " B"]  # run of each block
    partition: Partition  # blocks and folds; no fold holds runs of both sets

    @property
    def later_blocks(self) -> Bool[Array, " B"]:
        """Whether each block is of the later set."""
        return np.asarray(self.later[self.run_of_block])

    @property
    def later_folds(self) -> Bool[Array, " F"]:
        """Whether each fold is of the later set; no fold holds blocks of both."""
        folds = self.partition.folds
        return np.array(
            [bool(self.later_blocks[folds == fold].any()) for fold in range(int(folds.max()) + 1)]
        )

    @property
    def too_short(self) -> bool:
        """Whether one of the sets has too few blocks for any test."""
        blocks = int(self.later_blocks.sum())
        return min(blocks, len(self.run_of_block) - blocks) < CHANGE.fewest_blocks

    @property
    def counts(self) -> tuple[int, int]:
        """Number of runs of the earlier and of the later set."""
        return int((~self.later).sum()), int(self.later.sum())


def partition_sides(
    session: SessionContext,
    later: Bool[Array, " R"],
    settings: RegressionSettings = USUAL_REGRESSION,
) -> Sides:
    """Cuts the runs of both sets, which follow each other, into blocks and folds.

    Each set has its own block length, so that a short set has enough blocks for a test.
    """
    motions = [run.motion for run in session.runs]
    lengths = np.array([motion.filtered_length for motion in motions])
    seconds = lengths * np.array([motion.interval * motion.lowpass.factor for motion in motions])
    totals = np.where(later, seconds[later].sum(), seconds[~later].sum())
    of_block = block_length(totals, settings.shortest_block_s, CHANGE.side_blocks)
    partition = Partition.cut(lengths, seconds, of_block, lambda run: _folds(run, later), settings)
    return Sides(later, partition.run_of_block, partition)


def _folds(run_of_block: Int[Array, " B"], later: Bool[Array, " R"]) -> Int[Array, " B"]:
    """Fold of each block: whole runs of one set, or pieces of runs where a set has few."""
    folds = np.zeros(len(run_of_block), dtype=int)
    first = 0
    for side in (False, True):
        here = later[run_of_block] == side
        runs = run_of_block[here] - run_of_block[here].min()
        dealt = (
            runs % CHANGE.folds
            if runs.max() + 1 >= CHANGE.pieces
            else np.arange(len(runs)) % CHANGE.pieces
        )
        folds[here] = first + dealt
        first = int(folds[here].max()) + 1
    return folds


@dataclass(frozen=True, eq=False)
class PairedSums:
    """Block sums of both kinds of columns."""

    # Its layout's groups are the changes; the same effects in all runs are part of the baseline.
    evidence: Evidence
    always: Int[Array, " P"]  # for each column of a change, the same effect's column in all runs
    # Effects whose columns in all runs are the baseline's further ones, in their order.
    common: tuple[Group, ...]


def pair_sums(evidence: Evidence, sides: Sides, finer: Sequence[Variant] = ()) -> PairedSums:
    """The sums with every candidate twice: in all runs, and in the later set alone.

    Args:
        evidence: Sums of all candidates' columns in all runs.
        sides: The set of each block.
        finer: Points of finer grids: of the later set alone, for the baseline has the coarse ones.
    """
    old = evidence.layout
    candidates = [group for group in old.groups if not isinstance(group.effect, HeldFriction)]
    further = [group for group in old.groups if group.effect.id not in IN_THE_BASELINE]
    known_apart = {id(variant) for variant in finer}
    further = [group for group in further if id(group.variant) not in known_apart]
    common = [group for group in further if not group.variant.shape.get("mix")]
    known = {int(group.columns[0]) for group in common}
    shadows = [group for group in old.groups if int(group.columns[0]) not in known]
    start = old.rank + LOSS_PARAMETERS * old.n
    source = [np.arange(start), *(group.columns for group in (*common, *shadows, *candidates))]
    origin = np.append(np.concatenate(source), old.size)
    first = np.cumsum([len(columns) for columns in source])
    always = np.zeros(len(origin), dtype=int)
    split = int(first[len(common) + len(shadows)])
    where = np.zeros(old.size, dtype=int)
    where[origin[start:split]] = np.arange(start, split)
    groups = []
    at = split
    for group in candidates:
        columns = at + np.arange(len(group.columns))
        at += len(columns)
        change = ChangeOf(group.effect)
        groups.append(Group(change, group.joint, group.variant, columns))
        for part, some in optional.parts(change, group.variant):
            groups.append(Group(change, group.joint, part, columns[list(some)], borrows=True))
        always[columns] = where[group.columns]
    new = np.arange(start, len(origin) - 1)  # each belongs to the joint of its source
    layout = replace(
        old,
        groups=tuple(groups),
        own=tuple(new[np.isin(origin[new], own)] for own in old.own),
        shared=new[np.isin(origin[new], old.shared)],
        further=int(first[len(common)] - start),
        further_std=(),
    )
    return PairedSums(_sums(evidence, layout, origin, split, sides), always, tuple(common))


def _sums(
    evidence: Evidence, layout: Layout, origin: Int[Array, " P"], split: int, sides: Sides
) -> Evidence:
    """The sums in the new layout.

    Those of a change's columns are zero in blocks of the earlier set.
    """
    white: list[SymmetricSums] = []
    plain: list[SymmetricSums] = []
    friction: list[Array] = []
    dwells: list[DwellRows] = []
    pieces_before = ~sides.later_blocks[evidence.friction.block]
    for j, local in enumerate(layout.local):
        places = np.array([evidence.layout.places[j][int(column)] for column in origin[local]])
        off = (local >= split) & (local < layout.size)
        for sums, before, found in (
            (evidence.free[j], ~sides.later_blocks, white),
            (evidence.plain[j], ~sides.later_folds, plain),
        ):
            part = sums.part(places)
            part[np.ix_(before, off)] = 0.0
            part[np.ix_(before, np.arange(len(local)), off)] = 0.0
            found.append(SymmetricSums.of(part))
        tied = evidence.friction.sums[j][:, :, places]
        tied[np.ix_(pieces_before, np.arange(2), off)] = 0.0
        friction.append(tied)
        if evidence.dwells:
            held = evidence.dwells[j]
            rows = held.rows[:, places]
            rows[np.ix_(~sides.later_blocks[held.block], off)] = 0.0
            dwells.append(replace(held, rows=rows))
    return replace(
        evidence,
        layout=layout,
        scale=evidence.scale[origin],
        free=tuple(white),
        plain=tuple(plain),
        noise_power=evidence.noise_power[origin],
        friction=replace(evidence.friction, sums=tuple(friction)),
        dwells=tuple(dwells),
    )
