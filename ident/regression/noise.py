"""The torque's noise, joint by joint: its colour for whitening, its level for what no model can go
below.

Source: Hamilton 1994, section 8.3 (autoregressions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.compiled import compiled
from ident.regression.design import LOSS_PARAMETERS, Layout
from ident.regression.friction_sums import FRICTION
from ident.regression.rows import Rows
from ident.regression.settings import USUAL_REGRESSION, RegressionSettings

# Ridge of the noise regression, as a share of each column's power: it only keeps the solve
# well-posed.
NOISE_RIDGE = 1e-4
# The same of a column that is to have no coefficient.
HELD_AT_ZERO = 1e9
# Rows for each order of the autoregression, and for each column from which on the ridge decides
# nothing.
LEAST_ROWS = 20
MANY_ROWS = 5
# Variances of the columns' coefficients that are tried over fewer rows, in units of the noise's.
VARIANCES = 10.0 ** np.arange(-4.0, 8.1, 0.5)


@dataclass(frozen=True, eq=False)
class Whitening:
    """The noise of each joint."""

    # prediction-error filter (1, −a₁, …, −a_p) of each joint, shape (n, p + 1)
    coefficients: Float[Array, "n p"]
    # standard deviation of what can't be predicted from the past [N m]
    innovation: Float[Array, " n"]
    # standard deviation of the noise itself, encoder noise in the columns not counted [N m]
    level: Float[Array, " n"]

    @property
    def of_mean(self) -> Float[Array, " n"]:
        """Standard deviation of a long mean times the root of its samples: noise at zero frequency
        [N m].
        """
        return np.asarray(self.innovation / np.maximum(np.abs(self.coefficients.sum(axis=1)), 1e-3))


def whiten(table: Float[Array, "t p"], coefficients: Float[Array, " k"]) -> Float[Array, "t p"]:
    """What a prediction-error filter leaves of each column, from rest."""
    return np.asarray(_whiten(np.ascontiguousarray(table), np.ascontiguousarray(coefficients)))


@compiled(error_model="numpy", nogil=True)
def _whiten(table: Array, coefficients: Array) -> Array:
    left = np.empty_like(table)
    for k in range(len(table)):
        for c in range(table.shape[1]):
            left[k, c] = coefficients[0] * table[k, c]
        for lag in range(1, min(k, len(coefficients) - 1) + 1):
            a = coefficients[lag]
            for c in range(table.shape[1]):
                left[k, c] += a * table[k - lag, c]
    return left


def shorter_filters(
    coefficients: Float[Array, " k"], innovation: float
) -> list[Float[Array, " m"]]:
    """Prediction-error filters of all orders up to a filter's own, each divided by what it can't
    predict.

    Durbin's recursion backwards: with the reflection κ = a_m, a_i ← (a_i − κ a_{m−i}) / (1 − κ²),
    σ² ← σ² / (1 − κ²).
    """
    filtering = np.array(coefficients, dtype=float)
    variance = innovation**2
    filters = []
    for order in range(len(coefficients) - 1, -1, -1):
        filters.append(filtering[: order + 1] / np.sqrt(variance))
        reflection = float(filtering[order])
        if order and reflection:
            filtering = (
                filtering - reflection * np.append(filtering[order::-1], filtering[order + 1 :])
            ) / (1.0 - reflection**2)
            variance /= 1.0 - reflection**2
    return filters[::-1]


def whiten_after_gaps(
    table: Float[Array, "t p"], counts: Bool[Array, " t"], filters: Sequence[Float[Array, " m"]]
) -> Float[Array, "t p"]:
    """Whitened rows where they count: after a gap each by as much of its past as counts.

    Args:
        table: The rows.
        counts: Which of them count; what is returned of the others means nothing.
        filters: `shorter_filters`.
    """
    left = whiten(table, filters[-1])
    since = np.arange(len(counts)) - np.maximum.accumulate(
        np.where(counts, -1, np.arange(len(counts)))
    )
    for order, filtering in enumerate(filters[:-1]):
        rows = np.flatnonzero(counts & (since == order + 1))
        left[rows] = sum(weight * table[rows - lag] for lag, weight in enumerate(filtering))
    return left


def estimate_noise(
    layout: Layout, held: Sequence[Rows], settings: RegressionSettings = USUAL_REGRESSION
) -> Whitening:
    """AR noise of each joint from what all its candidates together leave.

    Never from what the baseline leaves: that would take the effect for noise and whiten it away.
    """
    fits = [_noise_of_joint(j, held, settings) for j in range(layout.n)]
    coefficients, innovations, levels = zip(*fits, strict=True)
    return Whitening(np.array(coefficients), np.array(innovations), np.array(levels))


def _noise_of_joint(
    j: int, held: Sequence[Rows], settings: RegressionSettings
) -> tuple[Array, float, float]:
    x = np.concatenate([rows.tables[j][rows.counts[:, j]] for rows in held])
    order = min(settings.noise_order, len(x) // LEAST_ROWS)
    if not order:
        # Next to nothing is in motion: by second differences, of which half are less (Gasser, Sroka
        # and Jennen-Steinmetz 1986).
        second = np.concatenate([np.diff(rows.tables[j][:, -1], 2) for rows in held])
        level = (
            max(float(np.median(np.abs(second))) / (0.6745 * np.sqrt(6.0)), 1e-9)
            if len(second)
            else 1.0
        )
        return np.eye(1, settings.noise_order + 1)[0], level, level
    # Encoder noise is not taken off here: with hundreds of columns that would leave sums that are
    # not positive. What it does to the coefficients is little, and what it adds to the residual is
    # known.
    gram = x.T @ x
    silent = _mostly_noise(j, held, settings.mostly_noise * np.diag(gram)[:-1])
    losses = slice(held[0].rank, held[0].rank + LOSS_PARAMETERS)
    ridge = np.diag(
        np.diag(gram)[:-1] * np.where(silent, HELD_AT_ZERO, _ridge(gram, len(x), losses, silent))
        + 1e-9
    )
    inverse = np.linalg.inv(gram[:-1, :-1] + ridge)
    estimate = inverse @ gram[:-1, -1]
    # Every coefficient takes a share of the noise with it.
    freedom = float(np.trace(inverse @ gram[:-1, :-1]))
    inflate = len(x) / max(len(x) - freedom, 0.2 * len(x))
    weights = np.concatenate([-estimate, [1.0]])
    left = [_left_of_run(rows, j, weights) for rows in held]
    quiet = _without_bursts(left, [rows.counts[:, j] for rows in held], settings)
    covariance = inflate * _autocovariance(list(zip(left, quiet, strict=True)), order)
    encoder = [
        (rows.noise[j] @ weights, where)
        for rows, where in zip(held, quiet, strict=True)
        if rows.noise is not None
    ]
    variance = covariance[0] - (_autocovariance(encoder, order)[0] if encoder else 0.0)
    covariance[0] *= 1.0 + 1e-6
    filtering, innovation = prediction_error(covariance)
    filtering = np.pad(filtering, (0, settings.noise_order - order))
    innovation = max(innovation, 1e-3 * covariance[0], 1e-18)
    level = max(variance, settings.least_own_noise * covariance[0])
    return filtering, float(np.sqrt(innovation)), float(np.sqrt(level))


def _ridge(
    gram: Float[Array, "p p"], count: int, free: slice, silent: Bool[Array, " c"]
) -> Float[Array, " c"]:
    """Ridge of each column, as a share of its power: next to none, or over few rows what their
    likelihood asks for.

    With more columns than rows whatever is left is what the ridge leaves. There the coefficients
    are drawn from one normal law, each column of the same power beforehand, and its variance v σ²
    is that of greatest likelihood:

        −½ (m log σ² + Σ log(1 + v λ_i)),    σ² = (yᵀy − Σ v z_i² / (1 + v λ_i)) / m,

    λ_i, z_i the columns' eigenvalues and what the torque has along them, m the rows less the free
    columns.

    Args:
        gram: Sums of all columns and the torque.
        count: Rows.
        free: Columns whose coefficients are drawn from no law.
        silent: Columns that are to have no coefficient.

    Source: Searle, Casella and McCulloch 1992, section 6.6 (restricted maximum likelihood).
    """
    ridge = np.full(len(gram) - 1, NOISE_RIDGE)
    if count > MANY_ROWS * len(gram):
        return ridge
    drawn = np.setdiff1d(
        np.flatnonzero(~silent & (np.diag(gram)[:-1] > 0.0)), np.arange(free.start, free.stop)
    )
    places = np.append(drawn, len(gram) - 1)
    inner = gram[free, free] + NOISE_RIDGE * np.diag(np.diag(gram[free, free]) + 1e-9)
    rest = gram[np.ix_(places, places)] - gram[places, free] @ np.linalg.solve(
        inner, gram[free, places]
    )
    scale = 1.0 / np.sqrt(np.diag(gram)[drawn])
    values, vectors = np.linalg.eigh(scale[:, None] * rest[:-1, :-1] * scale)
    values = np.maximum(values, 0.0)
    along = (vectors.T @ (scale * rest[:-1, -1])) ** 2
    left = max(count - (free.stop - free.start), 1)

    def likelihood(v: float) -> float:
        variance = max(float(rest[-1, -1] - np.sum(v * along / (1.0 + v * values))) / left, 1e-300)
        return -0.5 * float(left * np.log(variance) + np.sum(np.log1p(v * values)))

    ridge[drawn] = 1.0 / max(VARIANCES, key=likelihood)
    return ridge


def prediction_error(covariance: Float[Array, " k"]) -> tuple[Float[Array, " k"], float]:
    """The filter (1, −a₁, …, −a_p) that leaves what can't be predicted, and the variance of that.

    Sums over few samples with gaps between them need not be the autocovariance of anything: from
    the lag on at which they are not, they are left alone, and the filter stays stable. Source:
    Durbin 1960 (his recursion).
    """
    filtering = np.zeros(len(covariance))
    innovation = float(covariance[0])
    filtering[0] = 1.0
    for lag in range(1, len(covariance)):
        reflection = -float(filtering[:lag] @ covariance[lag:0:-1]) / innovation
        if not abs(reflection) < 1.0:
            break
        filtering[: lag + 1] += reflection * filtering[lag::-1]
        innovation *= 1.0 - reflection**2
    return filtering, innovation


def _mostly_noise(j: int, held: Sequence[Rows], most: Float[Array, " p"]) -> Bool[Array, " p"]:
    """Which candidates' columns have more encoder noise than they may.

    Made of the same positions as the baseline's, they know its encoder noise, and would pass for
    what explains it.
    """
    noise = np.zeros(len(most))
    for rows in held:
        if rows.noise is not None:
            noise += rows.weight * np.sum(
                rows.noise[j][rows.counts[:, j], :-1] ** 2, axis=0, dtype=float
            )
    noise[: held[0].rank + LOSS_PARAMETERS] = 0.0
    return np.asarray(noise > most)


def _left_of_run(rows: Rows, j: int, weights: Float[Array, " p"]) -> Float[Array, " t"]:
    """What is left of a run, its own level of friction taken out: how that varies is estimated
    separately.
    """
    left: Array = rows.tables[j] @ weights
    friction = rows.tables[j][:, rows.rank + FRICTION.start : rows.rank + FRICTION.stop]
    where = rows.counts[:, j]
    if not where.any():
        return left
    return np.asarray(
        left - friction @ np.linalg.lstsq(friction[where], left[where], rcond=1e-9)[0]
    )


def _without_bursts(
    left: Sequence[Float[Array, " t"]],
    counts: Sequence[Bool[Array, " t"]],
    settings: RegressionSettings,
) -> list[Bool[Array, " t"]]:
    """Where noise may be learnt: what is left is there, and no burst.

    Noise grows with load by some per cent, not manifold for some seconds: that is something else (a
    resonance, knocks), which would pass for noise, at all times, if the noise were learnt there.
    """
    pieces: list[tuple[int, slice, float, int]] = []
    for k, (values, where) in enumerate(zip(left, counts, strict=True)):
        for start in range(0, len(values), settings.burst_samples):
            piece = slice(start, start + settings.burst_samples)
            count = int(np.count_nonzero(where[piece]))
            if count:
                pieces.append(
                    (k, piece, float(np.sum(values[piece][where[piece]] ** 2)) / count, count)
                )
    power = np.array([piece[2] for piece in pieces])
    counted = np.array([piece[3] for piece in pieces])
    order = np.argsort(power)
    middle = power[order][np.searchsorted(np.cumsum(counted[order]), 0.5 * counted.sum())]
    quiet = [where.copy() for where in counts]
    for k, piece, mean_square, _ in pieces:
        if mean_square > settings.burst_power * middle:
            quiet[k][piece] = False
    return quiet


def _autocovariance(
    series: Sequence[tuple[Float[Array, " t"], Bool[Array, " t"]]], order: int
) -> Float[Array, " k"]:
    """Autocovariance up to some lags of series, where they count."""
    products = np.zeros(order + 1)
    counts = np.zeros(order + 1)
    for values, where in series:
        mask = where.astype(float)
        left = values * mask
        for lag in range(order + 1):
            products[lag] += left[lag:] @ left[: len(left) - lag]
            counts[lag] += mask[lag:] @ mask[: len(left) - lag]
    return np.asarray(products / np.maximum(counts, 1.0))
