"""What a model leaves, as time series in N m: for maps, pictures and the ceiling."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.baseline import Baseline
from ident.diagnosis.evidence import Evidence, baseline_tables
from ident.diagnosis.layout import LOSS_FIGURES, Group
from ident.diagnosis.projection import Projection
from ident.effects.base import RunContext, SessionContext


@dataclass(frozen=True, eq=False)
class RunResidual:
    """One run; t filtered samples of n joints.

    Attributes:
        run: The run.
        index: Its place in the session.
        before: What the tuned baseline leaves [N m].
        after: What is left with the named effects [N m].
        counts: Where each joint moves steadily.
    """

    run: RunContext
    index: int
    before: Float[Array, "t n"]
    after: Float[Array, "t n"]
    counts: Bool[Array, "t n"]

    @property
    def time(self) -> Float[Array, " t"]:
        """Times of the filtered samples, session clock [s]."""
        return self.run.motion.time[self.run.motion.coarse]


def compute_residuals(
    session: SessionContext,
    baseline: Baseline,
    evidence: Evidence,
    before: Projection,
    after: Projection,
    groups: Sequence[Group],
) -> list[RunResidual]:
    """Residuals of the baseline solved alone (`before`) and with its groups (`after`)."""
    layout = evidence.layout
    extra = [group.effect.columns(session, group.joint, group.variant) for group in groups]
    series = []
    for i, run in enumerate(session.runs):
        tables = baseline_tables(baseline, layout, run.motion)
        left_before, left_after = (
            _baseline_residual(tables, layout.rank, evidence, model) for model in (before, after)
        )
        for group, columns in zip(groups, extra, strict=True):
            at = np.flatnonzero(np.isin(after.inside, group.columns))
            beta = after.estimate[at] / evidence.scale[group.columns]
            torque = run.motion.filtered(columns[i]) @ beta
            if group.effect.rows == "own":
                left_after[:, group.joint] -= torque
            else:
                left_after -= torque
        series.append(RunResidual(run, i, left_before, left_after, run.motion.settled))
    return series


def _baseline_residual(
    tables: Sequence[Array], rank: int, evidence: Evidence, projection: Projection
) -> Float[Array, "t n"]:
    tuned = projection.estimate[: evidence.layout.tuned] / evidence.scale[: evidence.layout.tuned]
    left = np.zeros((len(tables[0]), len(tables)))
    for j, table in enumerate(tables):
        own = slice(rank + LOSS_FIGURES * j, rank + LOSS_FIGURES * (j + 1))
        explained = table[:, :rank] @ tuned[:rank] + table[:, rank : rank + LOSS_FIGURES] @ tuned[own]
        left[:, j] = table[:, -1] - explained
    return left


def block_labels(series: Sequence[RunResidual], length: float = 1.5) -> list[Int[Array, " t"]]:
    """A block number for every sample, going on from run to run; blocks of about `length` [s]."""
    labels, first = [], 0
    for item in series:
        label = first + ((item.time - item.time[0]) // length).astype(int)
        first = int(label[-1]) + 1
        labels.append(label)
    return labels
