"""Rows of the big regression, run by run: every column and the torque, filtered and decimated, one
table a joint.

Columns of many effects go through the common filter together: one call for a batch of them costs a
fraction of one call each. A few runs are in memory at a time, with all that the effects cache with
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import RunContext, SessionContext
from ident.regression.baseline import Baseline
from ident.regression.design import LOSS_PARAMETERS, Group, Layout
from ident.regression.partition import Partition
from ident.regression.runs import noisier_run
from ident.regression.spooled import SpooledArrays
from ident.robot.chain import PER_LINK

# Samples (after decimation) times squared joints that are in memory at once, unless a run has more:
# their regressors and tables (some MiB a joint) fit into memory that the chunk before has just let
# go.
CHUNK_SIZE = 2_000 * 36
# The same of a session whose baseline's columns are kept from pass to pass, some 100 MiB at the
# most; and of runs whose tables wait in memory until noise and scale are known: those of more wait
# on disk.
KEPT_SIZE = 30_000 * 36
WAITING_SIZE = 14_000 * 36
# Columns that are filtered together: enough to keep the processor's lanes busy, few enough to stay
# in its cache.
BATCH_COLUMNS = 64


@dataclass(frozen=True, eq=False)
class Rows:
    """Columns and torque of one run, filtered and decimated: one table a joint, and where it
    counts.

    The first `rank` columns are the base parameters', then come the joint's loss parameters.
    `noise` is what one more draw of the encoder noise adds to each table, or None where none was
    drawn; its squares count `weight` times.
    """

    run: int
    rank: int
    tables: Sequence[Float[Array, "t p"]]
    counts: Bool[Array, "t n"]
    blocks: Int[Array, " t"]
    noise: Sequence[Float[Array, "t p"]] | None = None
    weight: float = 1.0


def compute_rows(
    session: SessionContext,
    baseline: Baseline,
    layout: Layout,
    partition: Partition,
    through: Bool[Array, " n"] | None = None,
) -> Iterator[Rows]:
    """Every run's tables, a chunk of runs in memory at a time.

    Args:
        session: The runs.
        baseline: The tuned model.
        layout: The columns.
        partition: How time is cut, and of which runs encoder noise is drawn once more.
        through: Joints of which rows near reversals count as well; none if None.
    """
    everything = range(len(session.runs))
    groups = [group for group in layout.groups if not group.borrows]
    weights = np.ones(len(everything)) if partition.draws is None else partition.draws
    if session.runs[0].motion.state_noise is None:
        weights = np.zeros(len(everything))
    seen = compute_tables(session, baseline, layout, groups, everything)
    again = compute_tables(
        session, baseline, layout, groups, [*map(int, np.flatnonzero(weights))], noisier=True
    )
    for i, run, tables in seen:
        noise = None
        blocks = partition.blocks_of(i, len(tables[0]))
        if weights[i]:  # in half the room: its squares are a small share of the columns'
            pairs = zip(next(again)[2], tables, strict=True)
            noise = tuple(
                np.subtract(more, table, out=more).astype(np.float32) for more, table in pairs
            )
            for drawn, smooth in zip(noise, layout.flexible_places, strict=True):
                drawn[:, smooth] = 0.0
        counts = (
            run.motion.settled
            if through is None
            else np.where(through, run.motion.moving, run.motion.settled)
        )
        yield Rows(i, layout.rank, tuple(tables), counts, blocks, noise, float(weights[i]))
        del run, tables, noise  # before the next are made


def compute_tables(
    session: SessionContext,
    baseline: Baseline,
    layout: Layout,
    groups: Sequence[Group],
    runs: Sequence[int],
    noisier: bool = False,
) -> Iterator[tuple[int, RunContext, list[Float[Array, "t p"]]]]:
    """Tables of some runs.

    Args:
        session: The runs.
        baseline: The tuned model.
        layout: The columns.
        groups: Candidates whose columns are filled in; those of all others stay zero.
        runs: Indices of the runs.
        noisier: Whether all is made of states with one more draw of the encoder noise in them.

    Returns:
        For each run its index, its context, and a table for each joint, torque last.
    """

    def of_chunk(
        chunk: Sequence[int],
    ) -> Iterator[tuple[int, RunContext, list[Float[Array, "t p"]]]]:
        # Copies, so that what the effects cache with a run goes when its chunk goes.
        fresh = (session.runs[i].copied() for i in chunk)
        copies = replace(
            session, runs=tuple(noisier_run(baseline, run) if noisier else run for run in fresh)
        )
        known = _kept_columns(session, baseline, chunk, copies.runs, noisier)
        batches = [
            _Batch(layout, run, baseline_tables(layout, k))
            for run, k in zip(copies.runs, known, strict=True)
        ]
        for group in groups:
            for batch, columns in zip(
                batches, group.effect.columns(copies, group.joint, group.variant), strict=True
            ):
                batch.add(group, columns)
        # A discrepancy's columns are so smooth that what encoder noise adds to them is nothing.
        for group in () if noisier else (block for blocks in layout.flexible for block in blocks):
            for batch, columns in zip(
                batches, group.effect.columns(copies, group.joint, group.variant), strict=True
            ):
                batch.add(group, columns)
        for batch in batches:
            batch.flush()
        return zip(chunk, copies.runs, [batch.tables for batch in batches], strict=True)

    for chunk in _chunks(session, runs):
        yield from of_chunk(chunk)  # gone before the next is made


def _chunks(session: SessionContext, runs: Sequence[int]) -> Iterator[list[int]]:
    chunk: list[int] = []
    held = 0
    for i in runs:
        length = session.runs[i].motion.filtered_length
        if chunk and (held + length) * session.n**2 > CHUNK_SIZE:
            yield chunk
            chunk = []
            held = 0
        chunk.append(i)
        held += length
    if chunk:
        yield chunk


def baseline_tables(layout: Layout, known: BaselineColumns) -> list[Float[Array, "t p"]]:
    """Tables with the baseline's columns and the torque filled in, room left for the candidates."""
    tables = []
    for j, local in enumerate(layout.local):
        table = np.zeros((len(known.target), len(local)))
        table[:, known.felt[j]] = known.base[j]
        table[:, layout.rank : layout.rank + LOSS_PARAMETERS] = known.losses[:, j]
        table[:, -1] = known.target[:, j]
        tables.append(table)
    return tables


@dataclass(frozen=True, eq=False)
class BaselineColumns:
    """The baseline's columns of a run, filtered: which base parameters each joint feels, and what
    each joint carries.

    No joint feels links before it: such columns are zero, need no filter, and are left out.
    """

    felt: tuple[Int[Array, " b"], ...]
    base: tuple[Float[Array, "t b"], ...]
    losses: Float[Array, "t n l"]
    target: Float[Array, "t n"]


def baseline_columns(baseline: Baseline, run: RunContext) -> BaselineColumns:
    """The baseline's columns of a run."""
    motion = run.motion
    # Inertias don't enter the regressor: that of the tuned arm is that of the nominal one.
    numbers = np.array(baseline.base.columns)
    felt = tuple(np.flatnonzero(numbers >= PER_LINK * j) for j in range(run.n))
    width = run.regressor.shape[2]
    in_joint = [width * j + numbers[columns] for j, columns in enumerate(felt)]
    flat = np.concatenate(in_joint)
    rows = motion.filtered(run.regressor.reshape(len(run.regressor), -1)[:, flat])
    ends = np.cumsum([len(columns) for columns in felt])[:-1]
    base = np.split(rows, ends, axis=1)
    losses = motion.filtered(np.stack([motion.ddq, motion.dq, run.direction], axis=-1))
    nominal = baseline.nominal.with_payload(motion.payload).inertial_parameters
    target = motion.tau_filtered - motion.filtered(run.regressor @ nominal)
    # Copies: what is kept must not hold on to signals at the full rate.
    return BaselineColumns(felt, tuple(column.copy() for column in base), losses.copy(), target)


def _kept_columns(
    session: SessionContext,
    baseline: Baseline,
    chunk: Sequence[int],
    runs: Sequence[RunContext],
    noisier: bool,
) -> list[BaselineColumns]:
    """The baseline's columns of some runs: of a session that is held and short, all passes but the
    first find them.

    Args:
        session: The session.
        baseline: The tuned model.
        chunk: Numbers of the runs.
        runs: The same, as they are to be seen.
        noisier: Whether that is with one more draw of the encoder noise.
    """
    held = session.runs if isinstance(session.runs, tuple) else ()
    samples = sum(run.motion.filtered_length for run in held)
    if not 0 < samples * session.n**2 <= KEPT_SIZE:
        return [baseline_columns(baseline, run) for run in runs]
    columns = []
    for i, run in zip(chunk, runs, strict=True):
        known = session.runs[i].kept
        name = (baseline, "noisier" if noisier else "baseline")
        if name not in known:
            known[name] = baseline_columns(baseline, run)
        columns.append(known[name])
    return columns


@dataclass(eq=False)
class _Batch:
    """Columns of a run that wait to be filtered together and written into its tables."""

    layout: Layout
    run: RunContext
    tables: list[Float[Array, "t p"]]
    waiting: list[tuple[Group, Float[Array, "T ..."]]] = field(default_factory=list)
    width: int = 0

    def add(self, group: Group, columns: Float[Array, "T ..."]) -> None:
        if group.effect.decimated:
            self._write(group, columns)
            return
        self.waiting.append((group, columns))
        self.width += columns[0].size
        if self.width >= BATCH_COLUMNS:
            self.flush()

    def flush(self) -> None:
        """Filters what waits and writes it into the tables of the joints that it acts on."""
        if not self.waiting:
            return
        filtered = self.run.motion.lowpass.together([columns for _, columns in self.waiting])
        start = 0
        for group, columns in self.waiting:
            end = start + columns[0].size
            piece = filtered[:, start:end]
            self._write(group, piece.reshape(-1, *columns.shape[1:]))
            start = end
        self.waiting = []
        self.width = 0

    def _write(self, group: Group, columns: Float[Array, "t ..."]) -> None:
        """Writes columns into the tables of the joints that a group acts on."""
        for j in group.acts_on(self.layout.n):
            place = self.layout.places[j][int(group.columns[0])]
            of_joint = columns if group.effect.rows == "own" else columns[:, j]
            self.tables[j][:, place : place + len(group.columns)] = of_joint


def column_scale(layout: Layout, held: Sequence[Rows]) -> Float[Array, " P"]:
    """Root mean square of each column where it counts; 1 for the torque and for columns of zeros.

    Args:
        layout: The columns.
        held: Some runs' tables.
    """
    squares = np.zeros(layout.size + 1)
    counts = np.zeros(layout.size + 1)
    for rows in held:
        for j, local in enumerate(layout.local):
            x = rows.tables[j][rows.counts[:, j]]
            squares[local] += (x**2).sum(axis=0)
            counts[local] += len(x)
    scale = np.sqrt(squares / np.maximum(counts, 1.0))
    scale[-1] = 1.0
    return np.where(scale > 1e-12, scale, 1.0)


def waiting(layout: Layout, held: Sequence[Rows], rows: Rows) -> Rows:
    """A run that is held until scale and noise are known.

    Args:
        layout: The columns.
        held: The runs that are held before it.
        rows: The run.

    Returns:
        The run itself, or a copy on disk where those before it fill the memory.
    """
    if sum(len(rows.counts) for rows in held) * layout.n**2 < WAITING_SIZE:
        return rows
    return replace(
        rows, tables=SpooledArrays(rows.tables), noise=rows.noise and SpooledArrays(rows.noise)
    )


def rescale(layout: Layout, held: Sequence[Rows], scale: Array) -> None:
    """Divides runs' columns by their scale, in place; those on disk whenever they are read."""
    for tables in (tables for rows in held for tables in (rows.tables, rows.noise or ())):
        if isinstance(tables, SpooledArrays):
            tables.change = lambda j, table: (table / scale[layout.local[j]]).astype(table.dtype)
            continue
        for j, table in enumerate(tables):
            table /= scale[layout.local[j]]
