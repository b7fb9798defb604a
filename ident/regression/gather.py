"""The one pass over the recordings: rows of all runs into block sums, and sums over all time of further columns.

Noise is learnt from the first rows; then each run's tables go as soon as their sums have come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import SessionContext
from ident.progress import step
from ident.regression.baseline import Baseline
from ident.regression.block_sums import SymmetricSums, add_half, add_products, half_size, stored
from ident.regression.design import LOSS_PARAMETERS, Layout
from ident.regression.dwells import DwellRows, dwell_rows, join_runs, static_level
from ident.regression.friction_sums import FRICTION, FrictionSums
from ident.regression.gram import Evidence
from ident.regression.noise import Whitening, estimate_noise, shorter_filters, whiten_after_gaps
from ident.regression.partition import Partition, build_partition
from ident.regression.rows import Rows, column_scale, compute_rows, rescale, waiting
from ident.regression.settings import RegressionSettings
from ident.regression.spooled import SpooledArrays


def gather(
    session: SessionContext,
    baseline: Baseline,
    layout: Layout,
    known: Whitening | None = None,
    partition: Partition | None = None,
    alike: int | None = None,
    rest: bool = False,
    through: Bool[Array, " n"] | None = None,
    whole: bool = False,
) -> Evidence:
    """The one pass: noise from the first chunk, if it isn't known, then sums over all runs.

    Friction is the same in all runs, until `Evidence.with_run_spread` says otherwise.

    Args:
        session: The runs.
        baseline: The tuned model.
        layout: The columns.
        known: The noise, if it is known.
        partition: How time is cut; as `build_partition` does it if None.
        alike: How many of the first runs are of one and the same arm, for the noise to be taken from; all if None.
        rest: Whether holds are rows, too (`Evidence.dwells`).
        through: Joints of which rows near reversals count as well; none if None.
        whole: Whether the sums over all time are enough: one block and one fold.
    """
    views = [_View.of(layout, layout, whole)]
    return _gather(session, baseline, views, known, partition, alike, rest, through)[0]


def gather_beside(
    session: SessionContext, baseline: Baseline, layout: Layout, wide: Layout
) -> tuple[Evidence, Evidence]:
    """Sums of a layout, holds among them, and in the same pass those of a wider one over all time.

    Args:
        session, baseline: The runs, and the tuned model.
        layout, wide: The columns, and these with further groups (`extended`).
    """
    views = [_View.of(layout, wide), _View.of(wide, wide, whole=True)]
    both = [one.with_dwells() for one in _gather(session, baseline, views, rest=True)]
    return both[0], both[1]


@dataclass(frozen=True, eq=False)
class _View:
    """Columns that are summed of the tables of a layout, the widest."""

    layout: Layout  # the columns
    places: tuple[Int[Array, " p"], ...]  # of each joint where its columns stand in the tables
    numbers: Int[Array, " P"]  # number of each column in the widest layout
    whole: bool  # whether they are summed over all time, as one block

    @classmethod
    def of(cls, layout: Layout, widest: Layout, whole: bool = False) -> _View:
        numbers = np.append(np.arange(layout.size), widest.size)
        places = (np.flatnonzero(np.isin(local, numbers)) for local in widest.local)
        return cls(layout, tuple(places), numbers, whole)

    def rows(self, rows: Rows) -> Rows:
        """A run's rows with its columns alone."""
        tables = [table[:, at] for table, at in zip(rows.tables, self.places, strict=True)]
        noise = rows.noise and [table[:, at] for table, at in zip(rows.noise, self.places, strict=True)]
        return replace(rows, tables=tables, noise=noise)

    def dwells(self, rows: DwellRows, joint: int) -> DwellRows:
        """A joint's holds with its columns alone."""
        block = np.zeros_like(rows.block) if self.whole else rows.block
        return replace(rows, rows=rows.rows[:, self.places[joint]], block=block)


def _gather(
    session: SessionContext,
    baseline: Baseline,
    views: Sequence[_View],
    known: Whitening | None = None,
    partition: Partition | None = None,
    alike: int | None = None,
    rest: bool = False,
    through: Bool[Array, " n"] | None = None,
) -> list[Evidence]:
    """Sums of several views, the widest the last; the noise is learnt from the first. Arguments as of `gather`."""
    layout, widest = views[0].layout, views[-1].layout
    settings = baseline.settings if partition is not None else _within_memory(baseline.settings, layout)
    level = static_level(session) if rest else None
    held_rows: list[list[DwellRows]] = [[] for _ in range(layout.n)]
    partition = partition or build_partition(session, settings)
    scale: Array | None = None
    sums: list[_Sums] = []
    held: list[Rows] = []
    for rows in compute_rows(session, baseline, widest, partition, through):
        if not sums:
            held.append(waiting(widest, held, rows))
            if sum(len(one.counts) for one in held) < settings.noise_samples and rows.run < len(session.runs) - 1:
                continue
            scale = column_scale(widest, held)
            rescale(widest, held, scale)
            whitening = known or estimate_noise(
                layout, [one if len(views) == 1 else views[0].rows(one) for one in held[:alike]], settings
            )
            sums = [_Sums(view, partition, whitening, settings) for view in views]
            batch, held = held, []
        elif scale is not None:
            batch = [rows]
            rescale(widest, batch, scale)
        while batch:  # each run's tables go when their sums come
            part = batch.pop(0)
            for one in sums:
                one.add(part)
            step(part.run + 1, len(session.runs))
            if level is not None:
                motion = session.runs[part.run].motion
                found = dwell_rows(motion, part.tables, level, sums[0].whitening.of_mean, part.blocks)
                for own, joint in zip(held_rows, found, strict=True):
                    own.append(joint)
        del rows, part  # before the next are made
    assert sums
    assert scale is not None
    of_loss = np.stack([baseline.loss.viscous, baseline.loss.coulomb], axis=1)
    losses = layout.rank + LOSS_PARAMETERS * np.arange(layout.n)
    level_of_friction = of_loss * scale[losses[:, None] + np.arange(FRICTION.start, FRICTION.stop)]
    joined = [join_runs(own, alike) for own in held_rows if own]
    return [
        replace(
            one.evidence(scale[view.numbers], level_of_friction),
            dwells=tuple(view.dwells(rows, j) for j, rows in enumerate(joined)),
        )
        for one, view in zip(sums, views, strict=True)
    ]


def _within_memory(settings: RegressionSettings, layout: Layout) -> RegressionSettings:
    """The same with fewer blocks and folds where the sums of very many columns would fill the memory."""
    block_mb = 8e-6 * sum(half_size(len(local)) for local in layout.local)
    blocks = max(settings.fewest_blocks, int(settings.most_sums_mb / block_mb))
    if blocks >= settings.most_blocks:
        return settings
    folds = min(settings.folds, max(settings.fewest_folds, blocks // 4))
    return settings.but(most_blocks=blocks, folds=folds)


class _Sums:
    """Sums as they grow, run by run."""

    def __init__(self, view: _View, partition: Partition, whitening: Whitening, settings: RegressionSettings) -> None:
        self.layout = layout = view.layout
        self.view, self.partition, self.whitening, self.settings = view, partition, whitening, settings
        self.fold_of_block = np.zeros(1, dtype=int) if view.whole else partition.folds
        blocks, folds = len(self.fold_of_block), int(self.fold_of_block.max()) + 1
        # Of each joint the friction columns first, then the others in the order in which they cease to be zero.
        self.kept = [layout.rank + np.arange(FRICTION.start, FRICTION.stop) for _ in layout.local]
        room, nothing = SpooledArrays(), np.zeros(0)
        self.white, self.plain = (
            [stored(count * [nothing], count * half_size(len(local)), room) for local in layout.local]
            for count in (blocks, folds)
        )
        self.rows, self.weights = np.zeros((blocks, layout.n)), np.zeros((folds, layout.n))
        self.noise_power = np.zeros(layout.size + 1)
        self.pieces: list[tuple[int, int]] = []
        self.friction: list[list[Array]] = [[] for _ in range(layout.n)]

    def add(self, rows: Rows) -> None:
        """Adds a run: what was seen, less what of it is encoder noise."""
        # A block that several runs share is no stretch of time: there the run is one.
        shared = len(self.partition.starts) > self.settings.most_lone_runs
        stretches = np.full(len(rows.blocks), rows.run) if shared else self.partition.stretches[rows.blocks]
        blocks = np.zeros(len(rows.blocks), dtype=int) if self.view.whole else rows.blocks
        cuts = np.flatnonzero(np.diff(stretches) | np.diff(blocks)) + 1
        pieces = [slice(*ends) for ends in pairwise([0, *cuts.tolist(), len(blocks)])]
        self.pieces += [(int(stretches[one.start]), int(blocks[one.start])) for one in pieces]
        for j in range(self.layout.n):
            self._add_tables(rows, j, [(int(blocks[one.start]), one) for one in pieces])

    def _add_tables(self, rows: Rows, j: int, pieces: Sequence[tuple[int, slice]]) -> None:
        """Adds a joint's rows. What was seen and its noise come piece by piece, while a block's sums are at hand."""
        counts, folds = rows.counts[:, j], self.fold_of_block[[block for block, _ in pieces]]
        filters = shorter_filters(self.whitening.coefficients[j], float(self.whitening.innovation[j]))
        full, at = [rows.tables[j]] if rows.noise is None else [rows.tables[j], rows.noise[j]], self.view.places[j]
        # Columns that are not zero any more stand last, so that older sums are as they were.
        shown = np.flatnonzero(np.any([table.any(axis=0) for table in full], axis=0)[at])
        self.kept[j] = np.append(self.kept[j], np.setdiff1d(shown, self.kept[j]))
        kept, local = self.kept[j], self.layout.local[j]
        tables = [table[:, at[kept]].astype(float) for table in full]
        filtered = [whiten_after_gaps(table, counts, filters) for table in tables]
        power, sums, first = np.zeros(len(kept)), np.zeros((len(kept), len(kept))), FRICTION.stop - FRICTION.start
        for block, inside in pieces:
            seen, *noise = (_where(table[inside], counts[inside]) for table in filtered)
            sums[:] = 0.0
            add_products(sums, seen, 1.0)
            self.rows[block, j] += len(seen)
            tied = np.zeros((first, len(local)))
            tied[:, kept] = seen[:, :first].T @ seen
            for drawn in noise:
                add_products(sums, drawn, -rows.weight)
                tied[:, kept] -= rows.weight * (drawn[:, :first].T @ drawn)
                power += rows.weight * np.einsum("tp,tp->p", drawn, drawn)
            add_half(self.white[j], block, sums)
            self.friction[j].append(tied)
        self.noise_power[local[kept]] += power
        cuts = [0, *(np.flatnonzero(np.diff(folds)) + 1).tolist(), len(pieces)]
        for start, end in pairwise(cuts):
            inside, fold = slice(pieces[start][1].start, pieces[end - 1][1].stop), int(folds[start])
            seen, *noise = (_where(table[inside], counts[inside]) for table in tables)
            sums[:] = 0.0
            add_products(sums, seen, 1.0)
            self.weights[fold, j] += len(seen)
            for drawn in noise:
                add_products(sums, drawn, -rows.weight)
            add_half(self.plain[j], fold, sums)

    def evidence(self, scale: Float[Array, " P"], level: Float[Array, "n 2"]) -> Evidence:
        """All that was summed.

        Args:
            scale: What each column was divided by.
            level: Scaled viscous and Coulomb coefficient of each joint.
        """
        for sums, kept in zip((*self.white, *self.plain), 2 * self.kept, strict=True):
            for k, half in enumerate(sums):
                if len(half) < half_size(len(kept)):  # later columns are zero there
                    sums[k] = np.pad(half, (0, half_size(len(kept)) - len(half)))
        stretch, block = np.array(self.pieces).T
        sizes = [len(local) for local in self.layout.local]
        friction = FrictionSums(
            stretch, block, tuple(np.array(sums) for sums in self.friction), level, self.layout.rank
        )
        return Evidence(
            layout=self.layout,
            scale=scale,
            free=tuple(map(SymmetricSums, self.white, self.kept, sizes)),
            plain=tuple(map(SymmetricSums, self.plain, self.kept, sizes)),
            fold_of_block=self.fold_of_block,
            rows=self.rows,
            weights=self.weights,
            whitening=self.whitening,
            noise_power=self.noise_power,
            friction=friction,
            spread=np.zeros(self.layout.n),
            dispersion=np.ones(self.layout.n),
            settings=self.settings,
        )


def _where(table: Float[Array, "t p"], counts: Bool[Array, " t"]) -> Float[Array, "k p"]:
    """The rows that count; mostly all of them do, and none is copied."""
    return table if counts.all() else table[counts]
