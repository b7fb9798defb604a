"""Block sums as they grow, run by run."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.regression.block_sums import (
    Halves,
    SymmetricSums,
    add_half,
    add_products,
    half_size,
    stored,
)
from ident.regression.design import Layout
from ident.regression.friction_sums import FRICTION, FrictionSums
from ident.regression.gram import Evidence
from ident.regression.noise import Whitening, shorter_filters, whiten_after_gaps
from ident.regression.partition import Partition
from ident.regression.rows import Rows
from ident.regression.settings import RegressionSettings
from ident.regression.spooled import SpooledArrays


@dataclass(frozen=True, eq=False)
class _Table:
    """A joint's rows of one run, of the columns that are not zero."""

    columns: Int[Array, " c"]  # where they stand in the joint's rows
    smooth: Int[Array, " m"]  # where those of its discrepancy stand
    counts: Bool[Array, " t"]  # rows that count
    signals: list[Float[Array, "t c"]]  # what was seen and, if it is known, its encoder noise
    bent: Float[Array, "t m"]  # columns of the discrepancy
    weight: float  # by which squares of the noise count

    def whitened(self, filters: Sequence[Float[Array, " q"]]) -> _Table:
        """The same through the noise's whitening filters."""
        signals = [whiten_after_gaps(signal, self.counts, filters) for signal in self.signals]
        bent = whiten_after_gaps(self.bent, self.counts, filters)
        return _Table(self.columns, self.smooth, self.counts, signals, bent, self.weight)

    def within(self, stretch: slice) -> list[Float[Array, "k c"]]:
        """The rows of a stretch that count, of each signal."""
        counts = self.counts[stretch]
        return [_where(signal[stretch], counts) for signal in self.signals]


class RunningSums:
    """Sums as they grow."""

    def __init__(
        self,
        layout: Layout,
        partition: Partition,
        whitening: Whitening,
        settings: RegressionSettings,
    ) -> None:
        blocks = len(partition.folds)
        folds = int(partition.folds.max()) + 1
        self.layout = layout
        self.partition = partition
        self.whitening = whitening
        self.settings = settings
        # Of each joint the friction columns first, then the others in the order in which they cease
        # to be zero.
        friction = layout.rank + np.arange(FRICTION.start, FRICTION.stop)
        self.shown = [friction for _ in layout.local]
        room = SpooledArrays()
        self.white = _empty_sums(layout, blocks, room)
        self.plain = _empty_sums(layout, folds, room)
        self.rows = np.zeros((blocks, layout.n))
        self.weights = np.zeros((folds, layout.n))
        self.noise_power = np.zeros(layout.size + 1)
        self.pieces: list[tuple[int, int]] = []
        self.friction: list[list[Array]] = [[] for _ in range(layout.n)]
        self.flexible = []
        for smooth, local in zip(layout.flexible_places, layout.local, strict=True):
            self.flexible.append(np.zeros((len(smooth), len(local))))

    def add(self, rows: Rows) -> None:
        """Adds a run's rows: products of what was seen, less those of its draw of encoder noise."""
        # A block that several runs share is no stretch of time: there the run is one.
        shared = len(self.partition.starts) > self.settings.most_lone_runs
        for block in np.unique(rows.blocks):
            stretch = rows.run if shared else int(self.partition.stretches[block])
            self.pieces.append((stretch, int(block)))
        for j in range(self.layout.n):
            table = self._table(rows, j)
            self._add_white(table, rows.blocks, j)
            self._add_plain(table, self.partition.folds[rows.blocks], j)

    def _table(self, rows: Rows, j: int) -> _Table:
        """A joint's rows; columns that are not zero any more stand last from now on."""
        full = [rows.tables[j]]
        if rows.noise is not None:
            full.append(rows.noise[j])
        smooth = self.layout.flexible_places[j]
        nonzero = np.any([table.any(axis=0) for table in full], axis=0)
        nonzero = np.setdiff1d(np.flatnonzero(nonzero), smooth)
        columns = np.append(self.shown[j], np.setdiff1d(nonzero, self.shown[j]))
        self.shown[j] = columns
        return _Table(
            columns=columns,
            smooth=smooth,
            counts=rows.counts[:, j],
            signals=[table[:, columns].astype(float) for table in full],
            bent=full[0][:, smooth].astype(float),
            weight=rows.weight,
        )

    def _add_white(self, table: _Table, blocks: Int[Array, " t"], j: int) -> None:
        """Adds a joint's whitened rows.

        What was seen and its noise come block by block, while a block's sums are at hand.
        """
        coefficients = self.whitening.coefficients[j]
        filters = shorter_filters(coefficients, float(self.whitening.innovation[j]))
        table = table.whitened(filters)
        columns = table.columns
        smooth = table.smooth
        local = self.layout.local[j]
        bent = _where(table.bent, table.counts)
        signal = _where(table.signals[0], table.counts)
        self.flexible[j][:, columns] += bent.T @ signal
        self.flexible[j][:, smooth] += bent.T @ bent
        power = np.zeros(len(columns))
        sums = np.zeros((len(columns), len(columns)))
        first = FRICTION.stop - FRICTION.start
        for block, stretch in _stretches(blocks):
            seen, *noise = table.within(stretch)
            sums[:] = 0.0
            add_products(sums, seen, 1.0)
            self.rows[block, j] += len(seen)
            tied = np.zeros((first, len(local)))
            friction = seen[:, :first].T
            tied[:, columns] = friction @ seen
            of_stretch = _where(table.bent[stretch], table.counts[stretch])
            tied[:, smooth] = friction @ of_stretch
            for drawn in noise:
                add_products(sums, drawn, -table.weight)
                tied[:, columns] -= table.weight * (drawn[:, :first].T @ drawn)
                power += table.weight * np.einsum("tp,tp->p", drawn, drawn)
            add_half(self.white[j], block, sums)
            self.friction[j].append(tied)
        self.noise_power[local[columns]] += power

    def _add_plain(self, table: _Table, folds: Int[Array, " t"], j: int) -> None:
        """Adds a joint's rows in N m."""
        size = len(table.columns)
        sums = np.zeros((size, size))
        for fold, stretch in _stretches(folds):
            seen, *noise = table.within(stretch)
            sums[:] = 0.0
            add_products(sums, seen, 1.0)
            self.weights[fold, j] += len(seen)
            for drawn in noise:
                add_products(sums, drawn, -table.weight)
            add_half(self.plain[j], fold, sums)

    def evidence(self, scale: Float[Array, " P"], level: Float[Array, "n 2"]) -> Evidence:
        """All that was summed.

        Args:
            scale: What each column was divided by.
            level: Scaled viscous and Coulomb coefficient of each joint.
        """
        for of_joints in (self.white, self.plain):
            for halves, columns in zip(of_joints, self.shown, strict=True):
                _fill_up(halves, half_size(len(columns)))
        stretch, block = np.array(self.pieces).T
        sizes = [len(local) for local in self.layout.local]
        tied = tuple(np.array(sums) for sums in self.friction)
        return Evidence(
            layout=self.layout,
            scale=scale,
            free=tuple(map(SymmetricSums, self.white, self.shown, sizes)),
            plain=tuple(map(SymmetricSums, self.plain, self.shown, sizes)),
            fold_of_block=self.partition.folds,
            rows=self.rows,
            held_rows=np.zeros_like(self.rows),
            weights=self.weights,
            whitening=self.whitening,
            noise_power=self.noise_power,
            friction=FrictionSums(stretch, block, tied, level, self.layout.rank),
            spread=np.zeros(self.layout.n),
            dispersion=np.ones(self.layout.n),
            settings=self.settings,
            flexible=tuple(self.flexible) if self.layout.flexible else (),
        )


def _empty_sums(layout: Layout, count: int, room: SpooledArrays) -> list[Halves]:
    """Room for the sums of so many blocks or folds, of each joint; of no column so far."""
    nothing = np.zeros(0)
    sums = []
    for local in layout.local:
        numbers = count * half_size(len(local))
        sums.append(stored(count * [nothing], numbers, room))
    return sums


def _fill_up(halves: Halves, size: int) -> None:
    """Zeros for columns that came after a block was over."""
    for block, half in enumerate(halves):
        if len(half) < size:
            halves[block] = np.pad(half, (0, size - len(half)))


def _where(table: Float[Array, "t p"], counts: Bool[Array, " t"]) -> Float[Array, "k p"]:
    """The rows that count; mostly all of them do, and none is copied."""
    return table if counts.all() else table[counts]


def _stretches(labels: Int[Array, " t"]) -> Iterator[tuple[int, slice]]:
    """Each stretch of equal labels, and where it is."""
    before = labels[:1] - 1
    after = labels[-1:] - 1
    bounds = np.flatnonzero(np.diff(labels, prepend=before, append=after))
    for start, end in pairwise(bounds):
        yield int(labels[start]), slice(int(start), int(end))
