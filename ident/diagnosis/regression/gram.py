"""One pass over the data into block sums: Gram matrices of all columns and the torque, joint by joint.

    G_b = Σ_{t in block b} x xᵀ,  x = (columns, torque) of one joint at one instant

Cross-validation, tests, grid search and nested models are then sums of small matrices and small solves; memory does not
grow with the recording. Two kinds are kept: `white`, where columns and torque went through the same autoregressive
whitening filter and count in units of the noise, for inference; and `plain`, in N m, for sizes that people ask for.

Friction differs a little from run to run, whatever the model. The whitened rows of a run know that: what a change of
its Coulomb and viscous level by `RUN_SPREAD` would do is shrunk by the square root of (I + F Λ Fᵀ)⁻¹, with F the run's
two friction columns and Λ their prior variance. Without it, friction that seems to depend on place or temperature is
found wherever runs cover different places at different times.

Source: Frisch, Waugh and Lovell for the projections that use these sums; Hamilton 1994, section 8.3 (whitening by AR).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_toeplitz

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.regression.baseline import Baseline
from ident.diagnosis.regression.design import LOSS_FIGURES, Layout
from ident.diagnosis.regression.rows import Partition, Rows, compute_rows
from ident.effects.base import SessionContext

AR_ORDER = 4
# Samples (after decimation) that the noise is estimated from, in whole runs.
NOISE_SAMPLES = 15_000
# Blocks that the tests flip: enough for a p-value of 0.001, few enough to hold.
MOST_BLOCKS = 128
# Runs that have blocks of their own; of more than this, several share one.
MOST_LONE_RUNS = 256
SHORTEST_BLOCK = 0.6  # [s], some correlation times of what an arm's model leaves
# Relative standard deviation of a joint's friction from run to run.
RUN_SPREAD = 0.015
# Ridge of the noise regression, as a share of each column's power.
NOISE_RIDGE = 1e-4


@dataclass(frozen=True, eq=False)
class Whitening:
    """The noise of each joint.

    Attributes:
        coefficients: Prediction-error filter (1, −a₁, …, −a_p) of each joint, shape (n, p + 1).
        innovation: Standard deviation of what can't be predicted from the past [N m].
        level: Standard deviation of the noise itself [N m].
    """

    coefficients: Float[Array, "n p"]
    innovation: Float[Array, " n"]
    level: Float[Array, " n"]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Block sums of a session.

    Attributes:
        layout: What the columns are.
        scale: Each column was divided by this, length `layout.size` + 1.
        white: For each joint, (B, p, p) whitened sums.
        plain: For each joint, (F, p, p) sums in N² m².
        fold_of_block: Fold of each block; folds are whole runs where there are enough.
        samples: Whitened samples of each joint.
        weights: Plain samples of each fold and joint, shape (F, n).
        whitening: The noise.
    """

    layout: Layout
    scale: Float[Array, " P"]
    white: tuple[Float[Array, "B p p"], ...]
    plain: tuple[Float[Array, "F p p"], ...]
    fold_of_block: Int[Array, " B"]
    samples: Float[Array, " n"]
    weights: Float[Array, "F n"]
    whitening: Whitening

    def gram(self, blocks: Bool[Array, " B"] | None = None) -> Float[Array, "P P"]:
        """Whitened sums of all joints over some blocks, in the layout's order."""
        total = np.zeros((self.layout.size + 1, self.layout.size + 1))
        for local, sums in zip(self.layout.local, self.white, strict=True):
            part = sums.sum(axis=0) if blocks is None else sums[blocks].sum(axis=0)
            total[np.ix_(local, local)] += part
        return total


def build_partition(session: SessionContext, folds: int = 10) -> Partition:
    """Cuts runs into blocks of equal length; whole recorded runs make a fold, parts of a run where runs are few.

    Very many runs share blocks, neighbours with neighbours, so that the sums stay few.
    """
    motions = (run.motion for run in session.runs)
    figures = [(each.filtered_length, each.interval * each.lowpass.factor, each.continues) for each in motions]
    lengths, steps, continues = (np.array(values) for values in zip(*figures, strict=True))
    recorded = np.cumsum(~continues) - 1
    if len(lengths) > MOST_LONE_RUNS:
        block, run_of_block = _share_blocks(recorded)
        return Partition((np.zeros(1, dtype=int),) * len(lengths), block, _deal_folds(run_of_block, folds))
    target = max(SHORTEST_BLOCK, float((lengths * steps).sum()) / MOST_BLOCKS)
    counts = np.maximum(1, np.round(lengths * steps / target).astype(int))
    starts = tuple(
        np.linspace(0, length, count, endpoint=False).astype(int) for length, count in zip(lengths, counts, strict=True)
    )
    return Partition(starts, np.cumsum(counts) - counts, _deal_folds(np.repeat(recorded, counts), folds))


def _share_blocks(recorded: Int[Array, " R"]) -> tuple[Int[Array, " R"], Int[Array, " B"]]:
    """One block for several runs; no block holds pieces of two recorded runs unless it holds whole ones.

    Args:
        recorded: Number of the recorded run that each run is, or is a piece of.

    Returns:
        Block of each run; the recorded run of each block, blocks of several recorded runs counted as one.
    """
    pieces = np.bincount(recorded)
    if len(pieces) > MOST_LONE_RUNS:
        return recorded * MOST_BLOCKS // len(pieces), np.arange(MOST_BLOCKS)
    counts = np.maximum(1, np.round(pieces * MOST_BLOCKS / len(recorded)).astype(int))
    within = np.arange(len(recorded)) - (np.cumsum(pieces) - pieces)[recorded]
    block = (np.cumsum(counts) - counts)[recorded] + within * counts[recorded] // pieces[recorded]
    return block, np.repeat(np.arange(len(pieces)), counts)


def _deal_folds(run_of_block: Int[Array, " B"], folds: int) -> Int[Array, " B"]:
    """Fold of each block: that of its recorded run, or, where runs are few, that of its neighbours in time."""
    runs, total = int(run_of_block[-1]) + 1, len(run_of_block)
    if runs < 5:
        return np.arange(total) * min(folds, total) // total
    # Runs in order, dealt out so that folds are of about equal length and neighbours in kind are apart.
    return np.asarray(run_of_block % min(folds, runs))


def gather(session: SessionContext, baseline: Baseline, layout: Layout, known: Whitening | None = None) -> Evidence:
    """The one pass: noise from the first chunk, if it isn't known, then sums over all runs."""
    partition = build_partition(session)
    blocks = len(partition.folds)
    folds = int(partition.folds.max()) + 1
    scale: Array | None = None
    whitening: Whitening | None = None
    white = [np.zeros((blocks, len(local), len(local))) for local in layout.local]
    plain = [np.zeros((folds, len(local), len(local))) for local in layout.local]
    samples, weights = np.zeros(layout.n), np.zeros((folds, layout.n))
    held: list[Rows] = []
    seen = 0
    for rows in compute_rows(session, baseline, layout, partition):
        if whitening is None:
            held.append(rows)
            seen += len(rows.counts)
            if seen < NOISE_SAMPLES and rows.run < len(session.runs) - 1:
                continue
            scale = _column_scale(layout, held)
            for kept in held:
                _rescale(layout, kept, scale)
            whitening = known or estimate_noise(layout, held)
            batch, held = held, []
        else:
            assert scale is not None
            _rescale(layout, rows, scale)
            batch = [rows]
        spread = _run_spread(layout, baseline, scale)
        for part in batch:
            _add(part, whitening, partition, spread, white, plain, samples, weights)
    assert whitening is not None
    assert scale is not None
    return Evidence(layout, scale, tuple(white), tuple(plain), partition.folds, samples, weights, whitening)


def _add(
    rows: Rows,
    whitening: Whitening,
    partition: Partition,
    spread: Float[Array, "n 2"],
    white: Sequence[Array],
    plain: Sequence[Array],
    samples: Array,
    weights: Array,
) -> None:
    order = whitening.coefficients.shape[1] - 1
    friction = slice(rows.rank + 1, rows.rank + LOSS_FIGURES)
    for j, table in enumerate(rows.tables):
        counts = rows.counts[:, j]
        filtered = _whiten(table, whitening.coefficients[j] / whitening.innovation[j])
        # A whitened row mixes itself with its past: it counts where all of these count.
        whole = np.convolve(~counts, np.ones(order + 1), mode="full")[: len(counts)] == 0
        whole[:order] = False
        filtered[~whole] = 0.0
        filtered -= _of_the_run(filtered[:, friction] * spread[j], filtered)
        for block in np.unique(rows.blocks):
            inside = rows.blocks == block
            x = filtered[inside & whole]
            white[j][block] += x.T @ x
            samples[j] += len(x)
            x = table[inside & counts]
            plain[j][partition.folds[block]] += x.T @ x
            weights[partition.folds[block], j] += len(x)


def _whiten(table: Float[Array, "t p"], coefficients: Float[Array, " k"]) -> Float[Array, "t p"]:
    """What a prediction-error filter leaves of each column, from rest."""
    left = coefficients[0] * table
    for lag, coefficient in enumerate(coefficients[1:], start=1):
        left[lag:] += coefficient * table[:-lag]
    return left


def _run_spread(layout: Layout, baseline: Baseline, scale: Float[Array, " P"]) -> Float[Array, "n 2"]:
    """Standard deviation from run to run of each joint's scaled viscous and Coulomb coefficient."""
    level = np.stack([baseline.loss.viscous, baseline.loss.coulomb], axis=1)
    first = layout.rank + LOSS_FIGURES * np.arange(layout.n)
    return np.asarray(RUN_SPREAD * level * scale[first[:, None] + [1, 2]])


def _of_the_run(friction: Float[Array, "t 2"], table: Float[Array, "t p"]) -> Float[Array, "t p"]:
    """What shrinking the run's own friction takes away: (I − (I + F Fᵀ)^−½) X, with F in prior standard deviations."""
    values, vectors = np.linalg.eigh(friction.T @ friction)
    kept = values > 1e-12 * max(values[-1], 1e-300)
    if values[-1] <= 0.0:
        return np.zeros_like(table)
    basis = friction @ vectors[:, kept] / np.sqrt(values[kept])
    share = 1.0 - 1.0 / np.sqrt(1.0 + values[kept])
    return np.asarray((basis * share) @ (basis.T @ table))


def _column_scale(layout: Layout, held: Sequence[Rows]) -> Float[Array, " P"]:
    """Root mean square of each column where it counts; the torque is not scaled."""
    squares, counts = np.zeros(layout.size + 1), np.zeros(layout.size + 1)
    for rows in held:
        for j, local in enumerate(layout.local):
            x = rows.tables[j][rows.counts[:, j]]
            squares[local] += (x**2).sum(axis=0)
            counts[local] += len(x)
    scale = np.sqrt(squares / np.maximum(counts, 1.0))
    scale[-1] = 1.0
    return np.where(scale > 1e-12, scale, 1.0)


def _rescale(layout: Layout, rows: Rows, scale: Array) -> None:
    for table, local in zip(rows.tables, layout.local, strict=True):
        table /= scale[local]


def estimate_noise(layout: Layout, held: Sequence[Rows]) -> Whitening:
    """AR noise of each joint from what all its candidates together leave.

    Never from what the baseline leaves: that would take the effect for noise and whiten it away.
    """
    fits = [_noise_of_joint(j, held) for j in range(layout.n)]
    return Whitening(*(np.array([fit[k] for fit in fits]) for k in range(3)))


def _noise_of_joint(j: int, held: Sequence[Rows]) -> tuple[Array, float, float]:
    x = np.concatenate([rows.tables[j][rows.counts[:, j]] for rows in held])
    fallback = np.zeros(AR_ORDER + 1)
    fallback[0] = 1.0
    if len(x) < 20 * AR_ORDER:
        return fallback, 1.0, 1.0
    gram = x.T @ x
    ridge = NOISE_RIDGE * np.diag(np.diag(gram)[:-1]) + 1e-9 * np.eye(len(gram) - 1)
    estimate = np.linalg.solve(gram[:-1, :-1] + ridge, gram[:-1, -1])
    # Every coefficient takes a share of the noise with it.
    freedom = float(np.trace(np.linalg.solve(gram[:-1, :-1] + ridge, gram[:-1, :-1])))
    inflate = len(x) / max(len(x) - freedom, 0.2 * len(x))
    products, counts = np.zeros(AR_ORDER + 1), np.zeros(AR_ORDER + 1)
    for rows in held:
        table, mask = rows.tables[j], rows.counts[:, j].astype(float)
        left = (table[:, -1] - table[:, :-1] @ estimate) * mask
        for lag in range(AR_ORDER + 1):
            products[lag] += left[lag:] @ left[: len(left) - lag]
            counts[lag] += mask[lag:] @ mask[: len(left) - lag]
    covariance = inflate * products / np.maximum(counts, 1.0)
    covariance[0] *= 1.0 + 1e-6
    a = solve_toeplitz(covariance[:-1], covariance[1:])
    innovation = max(covariance[0] - a @ covariance[1:], 1e-3 * covariance[0], 1e-18)
    return np.concatenate([[1.0], -a]), float(np.sqrt(innovation)), float(np.sqrt(covariance[0]))
