"""The torque's noise, joint by joint: its colour for whitening, its level for what no model can go
below.

Source: Hamilton 1994, section 8.3 (autoregressions).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

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
    """The noise of each joint.

    Attributes:
        coefficients: Prediction-error filter (1, −a₁, …, −a_p) of each joint, shape (n, p + 1).
        innovation: Standard deviation of what can't be predicted from the past [N m].
        level: Standard deviation of the noise itself, encoder noise in the columns not counted
            [N m].
    """

    coefficients: Float[Array, "n p"]
    innovation: Float[Array, " n"]
    level: Float[Array, " n"]

    @property
    def of_mean(self) -> Float[Array, " n"]:
        """Standard deviation of a long mean times the root of its samples: noise at zero frequency
        [N m].
        """
        gain = np.abs(self.coefficients.sum(axis=1))
        return np.asarray(self.innovation / np.maximum(gain, 1e-3))


def whiten(table: Float[Array, "t p"], coefficients: Float[Array, " k"]) -> Float[Array, "t p"]:
    """What a prediction-error filter leaves of each column, as if all before were zero.

    Args:
        table: Columns over time.
        coefficients: The filter (1, −a₁, …, −a_p).
    """
    columns = np.ascontiguousarray(table)
    filtering = np.ascontiguousarray(coefficients)
    return np.asarray(_whiten(columns, filtering))


@compiled(error_model="numpy", nogil=True)
def _whiten(table: Array, coefficients: Array) -> Array:
    """The same, compiled."""
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

    Args:
        coefficients: The filter (1, −a₁, …, −a_p).
        innovation: Standard deviation of what it leaves.

    Returns:
        By order from 0 up, of 1 to p + 1 coefficients.
    """
    filtering = np.array(coefficients, dtype=float)
    variance = innovation**2
    filters = []
    for order in range(len(coefficients) - 1, -1, -1):
        filters.append(filtering[: order + 1] / np.sqrt(variance))
        reflection = float(filtering[order])
        if order and reflection:
            unpredicted = 1.0 - reflection**2
            reversed_filter = np.append(filtering[order::-1], filtering[order + 1 :])
            filtering = filtering - reflection * reversed_filter
            filtering = filtering / unpredicted
            variance /= unpredicted
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
    row = np.arange(len(counts))
    gaps = np.where(counts, -1, row)
    last_gap = np.maximum.accumulate(gaps)
    since = row - last_gap
    for order, filtering in enumerate(filters[:-1]):
        rows = np.flatnonzero(counts & (since == order + 1))
        left[rows] = sum(weight * table[rows - lag] for lag, weight in enumerate(filtering))
    return left


def estimate_noise(
    layout: Layout, held: Sequence[Rows], settings: RegressionSettings = USUAL_REGRESSION
) -> Whitening:
    """AR noise of each joint from what all its candidates together leave.

    Never from what the baseline leaves: that would take the effect for noise and whiten it away.

    Args:
        layout: The columns.
        held: Some runs' tables.
        settings: Order of the noise's autoregression, and what counts as noise.
    """
    coefficients = []
    innovations = []
    levels = []
    for joint in range(layout.n):
        filtering, innovation, level = _noise_of_joint(joint, held, settings)
        coefficients.append(filtering)
        innovations.append(innovation)
        levels.append(level)
    return Whitening(
        coefficients=np.array(coefficients),
        innovation=np.array(innovations),
        level=np.array(levels),
    )


def _noise_of_joint(
    j: int, held: Sequence[Rows], settings: RegressionSettings
) -> tuple[Array, float, float]:
    """A joint's prediction-error filter, innovation and level, as in `Whitening`.

    Args:
        j: The joint.
        held: Rows of the first runs.
        settings: Order of the filter, and limits.
    """
    counted = [rows.counts[:, j] for rows in held]
    tables = [rows.tables[j] for rows in held]
    pairs = zip(tables, counted, strict=True)
    x = np.concatenate([table[counts] for table, counts in pairs])
    order = min(settings.noise_order, len(x) // LEAST_ROWS)
    if not order:
        level = _level_of_differences([table[:, -1] for table in tables])
        return np.eye(1, settings.noise_order + 1)[0], level, level
    weights, inflate = _residual_weights(x, j, held, settings)
    left = [_left_of_run(rows, j, weights) for rows in held]
    quiet = _without_bursts(left, counted, settings)
    of_residual = list(zip(left, quiet, strict=True))
    covariance = inflate * _autocovariance(of_residual, order)
    encoder = []
    for rows, where in zip(held, quiet, strict=True):
        if rows.noise is not None:
            encoder.append((rows.noise[j] @ weights, where))
    of_encoder = _autocovariance(encoder, order)[0] if encoder else 0.0
    variance = covariance[0] - of_encoder
    covariance[0] *= 1.0 + 1e-6
    filtering, innovation = prediction_error(covariance)
    filtering = np.pad(filtering, (0, settings.noise_order - order))
    innovation = max(innovation, 1e-3 * covariance[0], 1e-18)
    variance = max(variance, settings.least_own_noise * covariance[0])
    return filtering, float(np.sqrt(innovation)), float(np.sqrt(variance))


def _level_of_differences(torques: Sequence[Float[Array, " t"]]) -> float:
    """Noise level where next to nothing is in motion [N m]: by second differences of the torque.

    Half of them are less than 0.6745 deviations, and theirs is √6 times the noise's.

    Source: Gasser, Sroka and Jennen-Steinmetz 1986.
    """
    second = np.concatenate([np.diff(torque, 2) for torque in torques])
    if len(second) == 0:
        return 1.0
    median = float(np.median(np.abs(second)))
    level = median / (0.6745 * np.sqrt(6.0))
    return max(level, 1e-9)


def _residual_weights(
    x: Float[Array, "m p"], j: int, held: Sequence[Rows], settings: RegressionSettings
) -> tuple[Float[Array, " p"], float]:
    """What all columns of a joint together leave of a row is its product with these.

    Encoder noise is not taken off here: with hundreds of columns that would leave sums that are not
    positive. What it does to the coefficients is little, and what it adds to the residual is known.

    Args:
        x: The joint's rows that count, the torque last.
        j, held, settings: As `_noise_of_joint` takes them.

    Returns:
        The weights; and by what squares of what is left are to be multiplied, for every coefficient
        takes a share of the noise with it.
    """
    gram = x.T @ x
    of_columns = gram[:-1, :-1]
    power = np.diag(gram)[:-1]
    rank = held[0].rank
    silent = _mostly_noise(j, held, settings.mostly_noise * power)
    losses = slice(rank, rank + LOSS_PARAMETERS)
    ridge = _ridge(gram, len(x), losses, silent)
    shares = np.where(silent, HELD_AT_ZERO, ridge)
    inverse = np.linalg.inv(of_columns + np.diag(power * shares + 1e-9))
    estimate = inverse @ gram[:-1, -1]
    freedom = float(np.trace(inverse @ of_columns))
    rows = len(x)
    inflate = rows / max(rows - freedom, 0.2 * rows)
    return np.concatenate([-estimate, [1.0]]), inflate


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
    power = np.diag(gram)
    heard = np.flatnonzero(~silent & (power[:-1] > 0.0))
    drawn = np.setdiff1d(heard, np.arange(free.start, free.stop))
    places = np.append(drawn, len(gram) - 1)
    of_free = gram[free, free]
    of_free = of_free + NOISE_RIDGE * np.diag(np.diag(of_free) + 1e-9)
    slopes = np.linalg.solve(of_free, gram[free, places])
    explained = gram[places, free] @ slopes
    rest = gram[np.ix_(places, places)] - explained
    scale = 1.0 / np.sqrt(power[drawn])
    scaled = scale[:, None] * rest[:-1, :-1] * scale
    values, vectors = np.linalg.eigh(scaled)
    values = np.maximum(values, 0.0)
    along = (vectors.T @ (scale * rest[:-1, -1])) ** 2
    torque_square = rest[-1, -1]
    left = max(count - (free.stop - free.start), 1)

    def likelihood(v: float) -> float:
        """Restricted log likelihood of a variance."""
        explained_square = np.sum(v * along / (1.0 + v * values))
        square = float(torque_square - explained_square)
        variance = max(square / left, 1e-300)
        log_determinant = np.sum(np.log1p(v * values))
        return -0.5 * float(left * np.log(variance) + log_determinant)

    ridge[drawn] = 1.0 / max(VARIANCES, key=likelihood)
    return ridge


def prediction_error(covariance: Float[Array, " k"]) -> tuple[Float[Array, " k"], float]:
    """The filter (1, −a₁, …, −a_p) that leaves what can't be predicted, and the variance of that.

    Sums over few samples with gaps between them need not be the autocovariance of anything: from
    the lag on at which they are not, they are left alone, and the filter stays stable. Source:
    Durbin 1960 (his recursion).

    Args:
        covariance: Autocovariance at the lags 0 to p; the first is above zero.
    """
    filtering = np.zeros(len(covariance))
    innovation = float(covariance[0])
    filtering[0] = 1.0
    for lag in range(1, len(covariance)):
        backwards = covariance[lag:0:-1]
        reflection = -float(filtering[:lag] @ backwards) / innovation
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
            columns = rows.noise[j][rows.counts[:, j], :-1]
            noise += rows.weight * np.sum(columns**2, axis=0, dtype=float)
    noise[: held[0].rank + LOSS_PARAMETERS] = 0.0
    return np.asarray(noise > most)


def _left_of_run(rows: Rows, j: int, weights: Float[Array, " p"]) -> Float[Array, " t"]:
    """What is left of a run, its own level of friction taken out: how that varies is estimated
    separately.
    """
    table = rows.tables[j]
    left: Array = table @ weights
    where = rows.counts[:, j]
    if not where.any():
        return left
    first = rows.rank + FRICTION.start
    last = rows.rank + FRICTION.stop
    friction = table[:, first:last]
    level, *_ = np.linalg.lstsq(friction[where], left[where], rcond=1e-9)
    return np.asarray(left - friction @ level)


class _Piece(NamedTuple):
    """A stretch of what is left of a run."""

    run: int  # its number
    where: slice
    square: float  # mean square of the samples that count
    samples: int  # how many these are


def _without_bursts(
    left: Sequence[Float[Array, " t"]],
    counts: Sequence[Bool[Array, " t"]],
    settings: RegressionSettings,
) -> list[Bool[Array, " t"]]:
    """Where noise may be learnt: what is left is there, and no burst.

    Noise grows with load by some per cent, not manifold for some seconds: that is something else (a
    resonance, knocks), which would pass for noise, at all times, if the noise were learnt there.
    """
    pieces: list[_Piece] = []
    for run, (values, counted) in enumerate(zip(left, counts, strict=True)):
        for start in range(0, len(values), settings.burst_samples):
            where = slice(start, start + settings.burst_samples)
            samples = values[where][counted[where]]
            if len(samples):
                square = float(np.sum(samples**2)) / len(samples)
                pieces.append(_Piece(run, where, square, len(samples)))
    most = settings.burst_power * _middle_square(pieces)
    quiet = [counted.copy() for counted in counts]
    for piece in pieces:
        if piece.square > most:
            quiet[piece.run][piece.where] = False
    return quiet


def _middle_square(pieces: Sequence[_Piece]) -> float:
    """The mean square below and above which lies half of all samples."""
    squares = np.array([piece.square for piece in pieces])
    samples = np.array([piece.samples for piece in pieces])
    order = np.argsort(squares)
    so_far = np.cumsum(samples[order])
    middle = np.searchsorted(so_far, 0.5 * samples.sum())
    return float(squares[order][middle])


def _autocovariance(
    series: Sequence[tuple[Float[Array, " t"], Bool[Array, " t"]]], order: int
) -> Float[Array, " k"]:
    """Autocovariance up to some lags of series, where they count."""
    products = np.zeros(order + 1)
    counts = np.zeros(order + 1)
    for values, where in series:
        mask = where.astype(float)
        left = values * mask
        length = len(left)
        for lag in range(order + 1):
            earlier = slice(0, length - lag)
            products[lag] += left[lag:] @ left[earlier]
            counts[lag] += mask[lag:] @ mask[earlier]
    return np.asarray(products / np.maximum(counts, 1.0))
