"""Residual torque of the models as time series [N m].

For maps, pictures, the ceiling and the replay.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.effects.base import RunContext, SessionContext
from ident.regression.baseline import Baseline
from ident.regression.cross_validation import HeldOut
from ident.regression.design import Group, Layout
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection
from ident.regression.partition import build_partition
from ident.regression.rows import compute_tables


@dataclass(frozen=True, eq=False)
class RunResidual:
    """Residuals of one run, measured less modelled torque, at t filtered samples of n joints."""

    run: RunContext  # the run
    index: int  # its index in the session
    before: Float[Array, "t n"]  # residual of the tuned baseline [N m]
    after: Float[Array, "t n"]  # residual with the accepted effects [N m]
    # Residual with the URDF's inertias fixed, friction and rotors tuned [N m].
    fixed: Float[Array, "t n"]
    # `before` and `after` of the model that was not fitted to the sample's fold [N m].
    unseen_before: Float[Array, "t n"]
    unseen_after: Float[Array, "t n"]
    valid: Bool[Array, "t n"]  # samples at which each joint moves steadily

    def without_friction_level(self, spread: Float[Array, " n"]) -> RunResidual:
        """A copy whose `after` lacks the run's own level and drift of friction, viscous and dry.

        Args:
            spread: Between-run standard deviation of each joint's friction, as a share.
        """
        after = self.after.copy()
        keep = self.run.motion.coarse
        direction = self.run.direction[keep]
        duration = max(self.time[-1] - self.time[0], 1e-9)
        drift = 2.0 * (self.time - self.time[0]) / duration - 1.0
        for j in range(after.shape[1]):
            friction = self.run.friction[keep][:, j]
            speed = self.run.motion.dq[keep, j]
            kinds = np.stack([speed, direction[:, j]], axis=1)
            by_kind = kinds * np.linalg.lstsq(kinds, friction, rcond=1e-9)[0]
            columns = np.concatenate([by_kind, (friction * drift)[:, None]], axis=1)
            valid = self.valid[:, j]
            x = columns[valid]
            y = after[valid, j]
            noise = float(np.mean(y**2)) if len(y) else 0.0
            if noise > 0.0 and spread[j] > 0.0:
                prior = noise / spread[j] ** 2 * np.eye(3)
                level = np.linalg.solve(x.T @ x + prior, x.T @ y)
                after[:, j] -= columns @ level
        return replace(self, after=after)

    @property
    def time(self) -> Float[Array, " t"]:
        """Times of the filtered samples on the session's clock [s]."""
        return self.run.motion.time[self.run.motion.coarse]

    @property
    def step(self) -> float:
        """Time from one filtered sample to the next [s]."""
        return self.run.motion.interval * self.run.motion.lowpass.factor

    @property
    def speed(self) -> Float[Array, "t n"]:
        """Joint velocity at the filtered samples [rad/s]."""
        return self.run.motion.dq[self.run.motion.coarse]


def compute_residuals(
    session: SessionContext,
    baseline: Baseline,
    evidence: Evidence,
    models: tuple[Projection, Projection, Projection],
    groups: Sequence[Group],
    held_out: HeldOut,
) -> list[RunResidual]:
    """Residuals of every run.

    Args:
        session, baseline, evidence: The runs, the tuned model, and the block sums.
        models: The baseline, the baseline with the effects, and the baseline with the URDF's
            inertias fixed.
        groups, held_out: The accepted effects, and the solver of the first two models without each
            fold.
    """
    layout = evidence.layout
    whole = []
    for model in models:
        columns = np.append(model.inside, layout.size)
        weights = np.append(-model.estimate, 1.0)
        whole.append(_scatter_weights(layout, columns, weights)[None])
    by_fold = []
    for folds in (held_out.weights(), held_out.weights(groups)):
        rows = [_scatter_weights(layout, folds.columns, row) for row in folds.values]
        by_fold.append(np.array(rows))
    partition = build_partition(session, evidence.settings)
    series: list[RunResidual] = []
    every_run = range(len(session.runs))
    for i, _, tables in compute_tables(session, baseline, layout, groups, every_run):
        # The chunk's own context would keep all that effects have cached in it.
        run = session.runs[i]
        fold = evidence.fold_of_block[partition.blocks_of(i, len(tables[0]))]
        pairs = zip(tables, layout.local, strict=True)
        scaled = [table / evidence.scale[local] for table, local in pairs]
        before, after, fixed = (_residual_of(scaled, layout, weights) for weights in whole)
        unseen = (_residual_of(scaled, layout, weights, fold) for weights in by_fold)
        unseen_before, unseen_after = unseen
        residual = RunResidual(
            run, i, before, after, fixed, unseen_before, unseen_after, run.motion.settled
        )
        series.append(residual)
    return series


def _scatter_weights(
    layout: Layout, columns: Int[Array, " z"], weights: Float[Array, " z"]
) -> Float[Array, " P"]:
    """Weights of some columns, placed among those of all columns."""
    row = np.zeros(layout.size + 1)
    row[columns] = weights
    return row


def _residual_of(
    tables: Sequence[Array],
    layout: Layout,
    weights: Float[Array, "F P"],
    folds: Int[Array, " t"] | None = None,
) -> Float[Array, "t n"]:
    """Residuals of each joint's rows, by one model or by that of each sample's fold [N m].

    Args:
        tables: Scaled rows of each joint.
        layout: Which columns each joint has.
        weights: Of the models, one a row.
        folds: Which of them each sample has; the first if None.
    """
    left = np.empty((len(tables[0]), layout.n))
    for j, (table, local) in enumerate(zip(tables, layout.local, strict=True)):
        used = np.any(weights[:, local] != 0.0, axis=0)
        by_model = table[:, used] @ weights[:, local[used]].T
        if folds is not None:
            by_model = np.take_along_axis(by_model, folds[:, None], axis=1)
        left[:, j] = by_model[:, 0]
    return left


def block_labels(series: Sequence[RunResidual], length: float) -> list[Int[Array, " t"]]:
    """A block number for every sample, counted over all runs.

    Args:
        series: The runs.
        length: About how long a block is [s].

    Returns:
        For each run the numbers of its t filtered samples.
    """
    labels = []
    first = 0
    for item in series:
        label = first + ((item.time - item.time[0]) // length).astype(int)
        first = int(label[-1]) + 1
        labels.append(label)
    return labels
