"""The pass over the recordings that fills block sums (`ident.regression.gram`)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.effects.base import SessionContext
from ident.progress import step
from ident.regression.baseline import Baseline
from ident.regression.block_sums import half_size
from ident.regression.design import LOSS_PARAMETERS, Layout
from ident.regression.dwells import DwellRows, dwell_rows, join_runs, static_level
from ident.regression.friction_sums import FRICTION
from ident.regression.gram import Evidence
from ident.regression.noise import Whitening, estimate_noise
from ident.regression.partition import Partition, build_partition
from ident.regression.rows import Rows, column_scale, compute_rows, rescale, waiting
from ident.regression.running_sums import RunningSums
from ident.regression.settings import RegressionSettings


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
    settings = baseline.settings
    if partition is None:
        settings = _within_memory(settings, layout)
        partition = build_partition(session, settings)
    level = static_level(session) if rest else None
    holds: list[list[DwellRows]] = [[] for _ in range(layout.n)]
    runs = compute_rows(session, baseline, layout, partition, through)
    first = _first_runs(runs, layout, settings, len(session.runs))
    scale = column_scale(layout, first)
    rescale(layout, first, scale)
    whitening = known or estimate_noise(layout, first[:alike], settings)
    sums = RunningSums(layout, partition, whitening, settings)
    for rows in _in_turn(first, runs, layout, scale):
        sums.add(rows)
        step(rows.run + 1, len(session.runs))
        if level is not None:
            motion = session.runs[rows.run].motion
            of_run = dwell_rows(motion, rows.tables, level, whitening.of_mean, rows.blocks)
            for of_joint, held in zip(holds, of_run, strict=True):
                of_joint.append(held)
        del rows  # before the next are made
    evidence = sums.evidence(scale, _friction_level(baseline, layout, scale))
    dwells = tuple(join_runs(of_joint, alike) for of_joint in holds if of_joint)
    return replace(evidence, dwells=dwells)


def _first_runs(
    runs: Iterator[Rows], layout: Layout, settings: RegressionSettings, count: int
) -> list[Rows]:
    """The first runs, as many as the noise is estimated of; what of them waits is kept small."""
    first: list[Rows] = []
    for rows in runs:
        first.append(waiting(layout, first, rows))
        samples = sum(len(waited.counts) for waited in first)
        if samples >= settings.noise_samples or rows.run >= count - 1:
            break
    return first


def _in_turn(
    first: list[Rows], runs: Iterator[Rows], layout: Layout, scale: Float[Array, " P"]
) -> Iterator[Rows]:
    """The first runs, which are scaled already, then all others; none is held on to."""
    while first:
        yield first.pop(0)
    for rows in runs:
        rescale(layout, [rows], scale)
        yield rows
        del rows  # before the next are made


def _friction_level(
    baseline: Baseline, layout: Layout, scale: Float[Array, " P"]
) -> Float[Array, "n 2"]:
    """Viscous and Coulomb coefficient of each joint, in units of the scaled columns."""
    of_loss = np.stack([baseline.loss.viscous, baseline.loss.coulomb], axis=1)
    first = layout.rank + LOSS_PARAMETERS * np.arange(layout.n)
    columns = first[:, None] + np.arange(FRICTION.start, FRICTION.stop)
    return np.asarray(of_loss * scale[columns])


def _within_memory(settings: RegressionSettings, layout: Layout) -> RegressionSettings:
    """Settings with so few blocks and folds that all sums take `most_sums_mb` at most.

    Args:
        settings: They come back as they are where their blocks fit.
        layout: Its columns give the size of a block's sums.
    """
    block_mb = 8e-6 * sum(half_size(len(local)) for local in layout.local)
    blocks = max(settings.fewest_blocks, int(settings.most_sums_mb / block_mb))
    if blocks >= settings.most_blocks:
        return settings
    folds = min(settings.folds, max(settings.fewest_folds, blocks // 4))
    return settings.but(most_blocks=blocks, folds=folds)
