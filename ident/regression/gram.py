"""One pass over the data into block sums: Gram matrices of all columns and the torque, joint by
joint.

    G_b = Σ_{t in block b} x xᵀ,  x = (columns, torque) of one joint at one instant

Cross-validation, tests, grid search and nested models are then sums of small matrices and small
solves; memory does not grow with the recording. Two kinds are kept: `white`, where columns and
torque went through the same autoregressive whitening filter and count in units of the noise, for
inference; and `plain`, in N m, for sizes that people ask for.

Columns are made of smoothed positions, and what is left of the encoders' noise in them is in their
sums as well: it makes coefficients too small and other columns of the same noise look useful. A
second draw of that noise goes through the same smoother, columns and filters; the sums of what it
adds are taken off, G_b = Σ x xᵀ − Σ e eᵀ, which leaves unbiased estimates of the sums of noise-free
columns. Where many runs share a block, some of them, chosen at random, tell the noise of all: it is
a small part of a column, and its own sums vary little over so many samples.

Friction differs from run to run, whatever the model. In the whitened sums of a run, its Coulomb and
viscous level are free within a standard deviation of their own, joint by joint: with F the run's
two friction columns and Λ their variance, Xᵀ (I + F Λ Fᵀ)⁻¹ X = XᵀX − XᵀF (Λ⁻¹ + FᵀF)⁻¹ FᵀX.
Without it, friction that seems to depend on place or temperature is found wherever runs cover
different places at different times. Only FᵀX is kept of each run, so that Λ may change afterwards.

Source: Frisch, Waugh and Lovell for the projections that use these sums; Hamilton 1994, section 8.3
(whitening by AR); Fuller 1987, section 3.1 (sums corrected for measurement error); Cook and
Stefanski 1994 (remeasurement); Searle, Casella and McCulloch 1992 (variance components).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import SessionContext
from ident.model.linearisation import LEAST_MOVING
from ident.progress import step
from ident.regression.baseline import Baseline
from ident.regression.block_sums import (
    SymmetricSums,
    add_half,
    add_products,
    half_size,
    stored,
)
from ident.regression.design import LOSS_PARAMETERS, Layout
from ident.regression.dwells import DwellRows, dwell_rows, join_runs, static_level
from ident.regression.friction_sums import FRICTION, FrictionSums
from ident.regression.noise import Whitening, estimate_noise, shorter_filters, whiten_after_gaps
from ident.regression.partition import Partition, build_partition
from ident.regression.rows import Rows, column_scale, compute_rows, rescale, waiting
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings
from ident.regression.spooled import SpooledArrays


@dataclass(frozen=True, eq=False)
class Evidence:
    """Block sums of a session."""

    layout: Layout  # what the columns are
    scale: Float[Array, " P"]  # each column was divided by this, length `layout.size` + 1
    # for each joint, whitened sums of every block, friction the same in all runs
    free: tuple[SymmetricSums, ...]
    plain: tuple[SymmetricSums, ...]  # for each joint, sums of every fold in N² m²
    # fold of each block; folds are whole runs where there are enough
    fold_of_block: Int[Array, " B"]
    rows: Float[Array, "B n"]  # whitened samples of each block and joint, shape (B, n)
    weights: Float[Array, "F n"]  # plain samples of each fold and joint, shape (F, n)
    whitening: Whitening  # the noise
    # Whitened squares of each column that are encoder noise, taken off already; length as `scale`.
    noise_power: Float[Array, " P"]
    friction: FrictionSums  # what each run's own friction level goes with
    # Relative standard deviation from run to run of each joint's friction, counted in whatever is
    # computed.
    spread: Float[Array, " n"]
    # What each joint's whitened sums were divided by: mean square of what nothing explains there.
    dispersion: Float[Array, " n"]
    settings: RegressionSettings = USUAL_REGRESSION  # what the regression counts with
    # For each joint what its holds say; in none of the sums until `with_dwells` adds them.
    dwells: tuple[DwellRows, ...] = ()
    # For each joint the whitened sums of its discrepancy's columns with all columns of its rows,
    # over all time, friction the same in all runs; they are zero in the sums of blocks and folds.
    flexible: tuple[Float[Array, "m p"], ...] = ()

    def with_dwells(self) -> Evidence:
        """The same with each joint's holds in the whitened sums, a row as one sample, and no longer
        beside them.

        Errors in N m are of motion; of a joint that hardly moves they are of its holds, too.
        """
        white = list(self.free)
        plain = list(self.plain)
        rows = np.array(self.rows)
        weights = np.array(self.weights)
        still = weights.sum(axis=0) < LEAST_MOVING
        flexible = list(self.flexible)
        for j, held in enumerate(self.dwells):
            smooth = self.layout.flexible_places[j]
            weighted = np.asarray(held.weighted, dtype=float)
            if flexible:
                flexible[j] = flexible[j] + weighted[:, smooth].T @ weighted
            weighted[:, smooth] = 0.0
            white[j] = white[j].with_rows(weighted, held.block)
            if still[j]:
                level = float(self.whitening.level[j])
                fold = self.fold_of_block[held.block]
                plain[j] = plain[j].with_rows(level * held.weighted, fold)
                np.add.at(weights[:, j], fold, (level / held.std) ** 2)
            np.add.at(rows[:, j], held.block, 1.0)
        return replace(
            self,
            free=tuple(white),
            plain=tuple(plain),
            flexible=tuple(flexible),
            rows=rows,
            weights=weights,
            dwells=(),
        )

    def with_held(self, friction: Sequence[float]) -> Evidence:
        """The same, before `with_dwells`, with other levels of static friction, joint by joint [N
        m].
        """
        pairs = zip(self.dwells, friction, strict=True)
        return replace(self, dwells=tuple(replace(rows, friction=level) for rows, level in pairs))

    def with_run_spread(self, spread: Float[Array, " n"]) -> Evidence:
        """The same sums where each joint's friction varies from run to run by another share.

        Args:
            spread: Relative standard deviation of each joint's friction level.
        """
        return replace(self, spread=np.array(spread, dtype=float))

    def with_dispersion(self, dispersion: Float[Array, " n"]) -> Evidence:
        """The same where each joint's rows have so many times the variance of whitened noise.

        What nobody can explain at a joint is noise to all that is estimated: without it, a joint
        with a gap of many times its noise would decide the inertias that it shares with others, and
        drown what they show.

        Args:
            dispersion: Of each joint, as a whole.
        """
        if np.array_equal(dispersion, self.dispersion):
            return self
        factor = np.asarray(dispersion / self.dispersion)
        power, weighted = np.zeros((2, len(self.noise_power)))
        for j, local in enumerate(self.layout.local):
            power_of_column = np.abs(self.free[j].diagonal())
            power[local] += power_of_column
            weighted[local] += power_of_column / factor[j]
        sums = tuple(sums.divided(float(factor[j])) for j, sums in enumerate(self.free))
        flexible = tuple(sums / factor[j] for j, sums in enumerate(self.flexible))
        tied = tuple(sums / factor[j] for j, sums in enumerate(self.friction.sums))
        return replace(
            self,
            free=sums,
            flexible=flexible,
            friction=replace(self.friction, sums=tied),
            noise_power=self.noise_power * weighted / np.maximum(power, 1e-300),
            dispersion=np.array(dispersion, dtype=float),
        )

    def weighted(self, weights: Float[Array, "B n"]) -> Evidence:
        """The same where every block counts by a weight of its own at each joint.

        Args:
            weights: Of each block and joint, shape (B, n).
        """
        of_stretch = weights[self.friction.block].T
        tied = tuple(
            sums * weight[:, None, None]
            for sums, weight in zip(self.friction.sums, of_stretch, strict=True)
        )
        return replace(
            self,
            free=tuple(
                sums.weighted(weight) for sums, weight in zip(self.free, weights.T, strict=True)
            ),
            friction=replace(self.friction, sums=tied),
            rows=self.rows * weights,
        )

    @property
    def samples(self) -> Float[Array, " n"]:
        """Whitened samples of each joint."""
        return np.asarray(self.rows.sum(axis=0))

    @cached_property
    def total(self) -> tuple[SymmetricSums, ...]:
        """For each joint, its whitened sums over all blocks, as one block."""
        taken = (self.friction.taken(j, float(self.spread[j])) for j in range(self.layout.n))
        return tuple(
            SymmetricSums.of((sums.over() - off)[None])
            for sums, off in zip(self.free, taken, strict=True)
        )

    def fold_sums(
        self, joint: int, places: Int[Array, " c"]
    ) -> tuple[Float[Array, "F c c"], Float[Array, "F c c"]]:
        """Whitened sums of some columns of a joint's rows over all folds but each in turn, and over
        each fold.

        Args:
            joint: The joint.
            places: Where the columns stand in its rows.
        """
        folds = int(self.fold_of_block.max()) + 1
        of_fold = np.zeros((folds, len(places), len(places)))
        np.add.at(of_fold, self.fold_of_block, self.free[joint].part(places))
        spread = float(self.spread[joint])
        return self.friction.part(of_fold, joint, spread, self.fold_of_block, places)

    def times(self, joint: int, weights: Float[Array, " p"]) -> Float[Array, "B p"]:
        """Whitened sums of every block times weights of a joint's columns."""
        product = self.free[joint].times(weights)
        taken = self.friction.taken_of_blocks(
            joint, float(self.spread[joint]), weights, len(product)
        )
        return np.asarray(product - taken)

    @cached_property
    def friction_noise(self) -> Float[Array, " n"]:
        """What friction that varies from run to run adds to each joint's torque, root mean square
        [N m].
        """
        deviations = np.zeros(self.layout.n)
        columns = np.arange(self.layout.tuned)[self.friction.columns]
        for j, sums in enumerate(self.plain):
            level = self.friction.level[j]
            power = (
                level
                @ sums.part(columns).sum(axis=0)
                @ level
                / max(float(self.weights[:, j].sum()), 1.0)
            )
            deviations[j] = self.spread[j] * np.sqrt(max(float(power), 0.0))
        return deviations

    @property
    def floor(self) -> Float[Array, " n"]:
        """What no model of the state can go below: the torque's noise and friction's run-to-run
        variation [N m].
        """
        return np.hypot(self.whitening.level, self.friction_noise)

    def misfit(self, joint: int, weights: Float[Array, " P"]) -> float:
        """Mean square of what a model leaves of a joint's whitened rows, one at the least.

        Whitened noise has a variance of one where the model fits; where more is left, all is less
        certain.

        Args:
            joint: The joint.
            weights: What the model leaves of a row is their product.
        """
        of_joint = weights[self.layout.local[joint]]
        return max(
            float(
                self.total[joint].times(of_joint)[0]
                @ of_joint
                / max(float(self.samples[joint]), 1.0)
            ),
            1.0,
        )

    def gram(self) -> Float[Array, "P P"]:
        """Whitened sums of all joints over all blocks, in the layout's order; read-only."""
        return self._gram

    @cached_property
    def _gram(self) -> Float[Array, "P P"]:
        total = np.zeros((self.layout.size + 1, self.layout.size + 1))
        for local, sums in zip(self.layout.local, self.total, strict=True):
            total[np.ix_(local, local)] += sums.over()
        total.setflags(write=False)
        return total


def gather(
    session: SessionContext,
    baseline: Baseline,
    layout: Layout,
    known: Whitening | None = None,
    partition: Partition | None = None,
    alike: int | None = None,
    rest: bool = False,
    through: Bool[Array, " n"] | None = None,
) -> Evidence:
    """The one pass: noise from the first chunk, if it isn't known, then sums over all runs.

    Friction is the same in all runs, until `Evidence.with_run_spread` says otherwise.

    Args:
        session: The runs.
        baseline: The tuned model.
        layout: The columns.
        known: The noise, if it is known.
        partition: How time is cut; as `build_partition` does it if None.
        alike: How many of the first runs are of one and the same arm, for the noise to be taken
            from; all if None.
        rest: Whether holds are rows, too (`Evidence.dwells`).
        through: Joints of which rows near reversals count as well; none if None.
    """
    settings = (
        baseline.settings if partition is not None else _within_memory(baseline.settings, layout)
    )
    level = static_level(session) if rest else None
    held_rows: list[list[DwellRows]] = [[] for _ in range(layout.n)]
    partition = partition or build_partition(session, settings)
    scale: Array | None = None
    sums: _Sums | None = None
    held: list[Rows] = []
    for rows in compute_rows(session, baseline, layout, partition, through):
        if sums is None:
            held.append(waiting(layout, held, rows))
            if (
                sum(len(rows.counts) for rows in held) < settings.noise_samples
                and rows.run < len(session.runs) - 1
            ):
                continue
            scale = column_scale(layout, held)
            rescale(layout, held, scale)
            sums = _Sums(
                layout, partition, known or estimate_noise(layout, held[:alike], settings), settings
            )
            batch = held
            held = []
        elif scale is not None:
            batch = [rows]
            rescale(layout, batch, scale)
        while batch:  # each run's tables go when their sums come
            rows_of_run = batch.pop(0)
            sums.add(rows_of_run)
            step(rows_of_run.run + 1, len(session.runs))
            if level is not None:
                motion = session.runs[rows_of_run.run].motion
                holds = dwell_rows(
                    motion, rows_of_run.tables, level, sums.whitening.of_mean, rows_of_run.blocks
                )
                for of_joint, rows_of_joint in zip(held_rows, holds, strict=True):
                    of_joint.append(rows_of_joint)
        del rows, rows_of_run  # before the next are made
    assert sums is not None
    assert scale is not None
    of_loss = np.stack([baseline.loss.viscous, baseline.loss.coulomb], axis=1)
    first = layout.rank + LOSS_PARAMETERS * np.arange(layout.n)
    evidence = sums.evidence(
        scale, of_loss * scale[first[:, None] + np.arange(FRICTION.start, FRICTION.stop)]
    )
    return replace(
        evidence, dwells=tuple(join_runs(of_joint, alike) for of_joint in held_rows if of_joint)
    )


def _within_memory(settings: RegressionSettings, layout: Layout) -> RegressionSettings:
    """The same with fewer blocks and folds where the sums of very many columns would fill the
    memory.
    """
    block_mb = 8e-6 * sum(half_size(len(local)) for local in layout.local)
    blocks = max(settings.fewest_blocks, int(settings.most_sums_mb / block_mb))
    if blocks >= settings.most_blocks:
        return settings
    folds = min(settings.folds, max(settings.fewest_folds, blocks // 4))
    return settings.but(most_blocks=blocks, folds=folds)


class _Sums:
    """Sums as they grow, run by run."""

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
        self.kept = [layout.rank + np.arange(FRICTION.start, FRICTION.stop) for _ in layout.local]
        room = SpooledArrays()
        nothing = np.zeros(0)
        self.white, self.plain = (
            [
                stored(count * [nothing], count * half_size(len(local)), room)
                for local in layout.local
            ]
            for count in (blocks, folds)
        )
        self.rows = np.zeros((blocks, layout.n))
        self.weights = np.zeros((folds, layout.n))
        self.noise_power = np.zeros(layout.size + 1)
        self.pieces: list[tuple[int, int]] = []
        self.friction: list[list[Array]] = [[] for _ in range(layout.n)]
        self.flexible = [
            np.zeros((len(smooth), len(local)))
            for smooth, local in zip(layout.flexible_places, layout.local, strict=True)
        ]

    def add(self, rows: Rows) -> None:
        """Adds a run: what was seen, less what of it is encoder noise."""
        blocks = np.unique(rows.blocks)
        stretches = self.partition.stretches[blocks]
        # A block that several runs share is no stretch of time: there the run is one.
        shared = len(self.partition.starts) > self.settings.most_lone_runs
        self.pieces += [
            (rows.run if shared else int(s), int(b)) for s, b in zip(stretches, blocks, strict=True)
        ]
        for j in range(self.layout.n):
            self._add_tables(rows, j)

    def _add_tables(self, rows: Rows, j: int) -> None:
        """Adds a joint's rows.

        What was seen and its noise come block by block, while a block's sums are at hand.
        """
        counts = rows.counts[:, j]
        folds = self.partition.folds[rows.blocks]
        filters = shorter_filters(
            self.whitening.coefficients[j], float(self.whitening.innovation[j])
        )
        full = [rows.tables[j]] if rows.noise is None else [rows.tables[j], rows.noise[j]]
        # Columns that are not zero any more stand last, so that older sums are as they were.
        smooth = self.layout.flexible_places[j]
        shown = np.flatnonzero(np.any([table.any(axis=0) for table in full], axis=0))
        shown = np.setdiff1d(shown, smooth)
        self.kept[j] = np.append(self.kept[j], np.setdiff1d(shown, self.kept[j]))
        columns = self.kept[j]
        local = self.layout.local[j]
        tables = [table[:, columns].astype(float) for table in full]
        filtered = [whiten_after_gaps(table, counts, filters) for table in tables]
        bent = whiten_after_gaps(full[0][:, smooth].astype(float), counts, filters)
        self.flexible[j][:, columns] += _where(bent, counts).T @ _where(filtered[0], counts)
        self.flexible[j][:, smooth] += _where(bent, counts).T @ _where(bent, counts)
        power = np.zeros(len(columns))
        sums = np.zeros((len(columns), len(columns)))
        first = FRICTION.stop - FRICTION.start
        for block, inside in _stretches(rows.blocks):
            seen, *noise = (_where(table[inside], counts[inside]) for table in filtered)
            sums[:] = 0.0
            add_products(sums, seen, 1.0)
            self.rows[block, j] += len(seen)
            tied = np.zeros((first, len(local)))
            tied[:, columns] = seen[:, :first].T @ seen
            tied[:, smooth] = seen[:, :first].T @ _where(bent[inside], counts[inside])
            for drawn in noise:
                add_products(sums, drawn, -rows.weight)
                tied[:, columns] -= rows.weight * (drawn[:, :first].T @ drawn)
                power += rows.weight * np.einsum("tp,tp->p", drawn, drawn)
            add_half(self.white[j], block, sums)
            self.friction[j].append(tied)
        self.noise_power[local[columns]] += power
        for fold, inside in _stretches(folds):
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
        for sums, columns in zip((*self.white, *self.plain), 2 * self.kept, strict=True):
            for k, half in enumerate(sums):
                if len(half) < half_size(len(columns)):  # later columns are zero there
                    sums[k] = np.pad(half, (0, half_size(len(columns)) - len(half)))
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
            fold_of_block=self.partition.folds,
            rows=self.rows,
            weights=self.weights,
            whitening=self.whitening,
            noise_power=self.noise_power,
            friction=friction,
            spread=np.zeros(self.layout.n),
            dispersion=np.ones(self.layout.n),
            settings=self.settings,
            flexible=tuple(self.flexible) if self.layout.flexible else (),
        )


def _where(table: Float[Array, "t p"], counts: Bool[Array, " t"]) -> Float[Array, "k p"]:
    """The rows that count; mostly all of them do, and none is copied."""
    return table if counts.all() else table[counts]


def _stretches(labels: Int[Array, " t"]) -> Iterator[tuple[int, slice]]:
    """Each stretch of equal labels, and where it is."""
    bounds = np.flatnonzero(np.diff(labels, prepend=labels[:1] - 1, append=labels[-1:] - 1))
    for start, end in pairwise(bounds):
        yield int(labels[start]), slice(int(start), int(end))
