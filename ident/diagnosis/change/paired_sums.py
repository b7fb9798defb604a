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
        is_later = np.zeros(int(folds.max()) + 1, dtype=bool)
        is_later[folds[self.later_blocks]] = True
        return is_later

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

    Args:
        session: The runs of both sets.
        later: Which runs are of the later set.
        settings: Least length of a block and of a stretch of friction.
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
        of_side = later[run_of_block] == side
        runs = run_of_block[of_side]
        runs = runs - runs.min()
        if runs.max() + 1 >= CHANGE.pieces:
            dealt = runs % CHANGE.folds
        else:
            dealt = np.arange(len(runs)) % CHANGE.pieces
        folds[of_side] = first + dealt
        first = int(folds[of_side].max()) + 1
    return folds


@dataclass(frozen=True, eq=False)
class PairedSums:
    """Block sums of both kinds of columns."""

    # Its layout's groups are the changes; the same effects in all runs are part of the baseline.
    evidence: Evidence
    always: Int[Array, " P"]  # for each column of a change, the same effect's column in all runs
    # Effects whose columns in all runs are the baseline's further ones, in their order.
    common: tuple[Group, ...]


@dataclass(frozen=True, eq=False)
class _PairedColumns:
    """Columns of both kinds, and where their sums come from."""

    layout: Layout  # of the new columns
    origin: Int[Array, " P"]  # of each new column and of the torque, the one in all runs
    changes_from: int  # first column of a change


def pair_sums(evidence: Evidence, sides: Sides, finer: Sequence[Variant] = ()) -> PairedSums:
    """The sums with every candidate twice: in all runs, and in the later set alone.

    The new columns are the baseline's, those of common laws in all runs, those of all other groups
    in all runs (shadows, from which permuted sets are made), and those of changes.

    Args:
        evidence: Sums of all candidates' columns in all runs.
        sides: The set of each block.
        finer: Points of finer grids: of the later set alone, for the baseline has the coarse ones.
    """
    old = evidence.layout
    candidates = [group for group in old.groups if not isinstance(group.effect, HeldFriction)]
    common = _common_groups(old, finer)
    in_common = {int(group.columns[0]) for group in common}
    shadows = [group for group in old.groups if int(group.columns[0]) not in in_common]
    start = old.rank + LOSS_PARAMETERS * old.n
    groups_in_order = (*common, *shadows, *candidates)
    source = [np.arange(start), *(group.columns for group in groups_in_order)]
    origin = np.append(np.concatenate(source), old.size)
    ends = np.cumsum([len(columns) for columns in source])
    changes_from = int(ends[len(common) + len(shadows)])
    # Of each old column, the new one of the same effect in all runs.
    in_all_runs = np.zeros(old.size, dtype=int)
    in_all_runs[origin[start:changes_from]] = np.arange(start, changes_from)
    groups: list[Group] = []
    always = np.zeros(len(origin), dtype=int)
    first = changes_from
    for candidate in candidates:
        columns = first + np.arange(len(candidate.columns))
        first += len(columns)
        groups += _as_changes(candidate, columns)
        always[columns] = in_all_runs[candidate.columns]
    new = np.arange(start, len(origin) - 1)
    # Each column belongs to the joint of its source.
    by_joint = tuple(new[np.isin(origin[new], columns)] for columns in old.by_joint)
    layout = replace(
        old,
        groups=tuple(groups),
        by_joint=by_joint,
        shared=new[np.isin(origin[new], old.shared)],
        further=int(ends[len(common)] - start),
        further_std=(),
    )
    paired = _PairedColumns(layout, origin, changes_from)
    return PairedSums(_sums(evidence, paired, sides), always, tuple(common))


def _common_groups(layout: Layout, finer: Sequence[Variant]) -> list[Group]:
    """The groups whose columns in all runs are a part of the baseline.

    Not those in its span already, nor the points of finer grids, nor mixtures of points.
    """
    of_finer_grids = {id(variant) for variant in finer}
    further = [group for group in layout.groups if group.effect.id not in IN_THE_BASELINE]
    coarse = [group for group in further if id(group.variant) not in of_finer_grids]
    return [group for group in coarse if not group.variant.shape.get("mix")]


def _as_changes(candidate: Group, columns: Int[Array, " k"]) -> list[Group]:
    """The change of a candidate at some columns, and the changes of its parts."""
    change = ChangeOf(candidate.effect)
    changes = [Group(change, candidate.joint, candidate.variant, columns)]
    for variant, places in optional.parts(change, candidate.variant):
        of_variant = columns[list(places)]
        changes.append(Group(change, candidate.joint, variant, of_variant, borrows=True))
    return changes


def _sums(evidence: Evidence, paired: _PairedColumns, sides: Sides) -> Evidence:
    """The sums in the new layout.

    Those of a change's columns are zero in blocks of the earlier set.
    """
    layout = paired.layout
    white: list[SymmetricSums] = []
    plain: list[SymmetricSums] = []
    friction: list[Array] = []
    dwells: list[DwellRows] = []
    earlier_blocks = ~sides.later_blocks
    earlier_folds = ~sides.later_folds
    earlier_pieces = earlier_blocks[evidence.friction.block]
    for j, local in enumerate(layout.local):
        place_of = evidence.layout.places[j]
        places = np.array([place_of[int(column)] for column in paired.origin[local]])
        of_changes = (local >= paired.changes_from) & (local < layout.size)
        white.append(_without(evidence.free[j], places, earlier_blocks, of_changes))
        plain.append(_without(evidence.plain[j], places, earlier_folds, of_changes))
        tied = evidence.friction.sums[j][:, :, places]
        tied[np.ix_(earlier_pieces, np.arange(2), of_changes)] = 0.0
        friction.append(tied)
        if evidence.dwells:
            held = evidence.dwells[j]
            rows = held.rows[:, places]
            rows[np.ix_(earlier_blocks[held.block], of_changes)] = 0.0
            dwells.append(replace(held, rows=rows))
    return replace(
        evidence,
        layout=layout,
        scale=evidence.scale[paired.origin],
        free=tuple(white),
        plain=tuple(plain),
        noise_power=evidence.noise_power[paired.origin],
        friction=replace(evidence.friction, sums=tuple(friction)),
        dwells=tuple(dwells),
    )


def _without(
    sums: SymmetricSums,
    places: Int[Array, " k"],
    earlier: Bool[Array, " B"],
    of_changes: Bool[Array, " k"],
) -> SymmetricSums:
    """Sums at some places, those of changes zero in the blocks or folds of the earlier set."""
    whole = sums.part(places)
    whole[np.ix_(earlier, of_changes)] = 0.0
    whole[np.ix_(earlier, np.arange(len(places)), of_changes)] = 0.0
    return SymmetricSums.of(whole)
