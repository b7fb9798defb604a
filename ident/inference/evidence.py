"""Log evidence of a linear Gaussian model, from sums alone, and the variances at which it is
greatest.

With G = XᵀX and g = Xᵀy of whitened rows, and coefficients θ ~ N(0, S),

    log p(y | S) − log p(y | 0) = ½ gᵀ (G + S⁻¹)⁻¹ g − ½ log |I + S^½ G S^½|.

The one place where evidence is defined: effects, discrepancies and tolerances are all columns with
a variance. Variances that are shared by a block of columns are where it is greatest; its derivative
by the logarithm of a block's variance s is

    ½ (wᵀw / s − m + tr C / s),   w, C the block's mean and covariance, m its number of columns.

Source: MacKay 1992 (Bayesian interpolation, evidence); Searle, Casella and McCulloch 1992 (variance
components).

Coefficients that can't be negative are solved with that bound; their prior is half a normal, which
is worth log 2 each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_solve, eigh, qr
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs
from scipy.optimize import minimize
from scipy.special import logsumexp

from ident.arrays import Array, Bool, Float
from ident.regression.factors import solve_signed

# Logarithms of variances of whitened coefficients that are looked at: beyond them a block is off,
# or free [nats].
LEAST_LOG_VARIANCE = -18.0
MOST_LOG_VARIANCE = 16.0
# Below this share of the largest eigenvalue, in units of the diagonal, double precision tells
# nothing.
ROUNDING = 1e-13
LOG_TWO = float(np.log(2.0))
# Nodes of a mass over what recordings leave of it, and how many deviations they reach beyond the
# mean; the least is so small a share of the largest that priors of masses end above it.
MASS_NODES = 96
MASS_REACH = 5.0
LEAST_NODE = 1e-4


def factorise(matrix: Float[Array, "k k"]) -> Float[Array, "k k"]:
    """Lower factor L, L Lᵀ the matrix, of one that is positive but for rounding.

    Where columns are nearly the same, as in a single short run, what is left of one beside the
    others is lost in rounding and may come out below zero: it is raised to what rounding leaves. So
    is a column whose own square did, in units of the largest.
    """
    factor, failed = dpotrf(matrix, lower=1, clean=1)
    if not failed:
        return np.asarray(factor)
    squares = np.diag(matrix)
    size = np.sqrt(np.where(squares > 0.0, squares, ROUNDING * squares.max()))
    values, vectors = eigh(matrix / np.outer(size, size), check_finite=False)
    root = vectors * np.sqrt(np.maximum(values, ROUNDING * values[-1]))
    factors = qr((size[:, None] * root).T, mode="r", check_finite=False)
    upper = np.asarray(factors[0])[: len(matrix)]
    return upper.T * np.where(np.diag(upper) < 0.0, -1.0, 1.0)


def _with_prior(gram: Float[Array, "k k"], deviation: Float[Array, " k"]) -> Float[Array, "k k"]:
    """I + S^½ G S^½: the precision of coefficients in units of their prior deviations."""
    inner = deviation[:, None] * gram * deviation
    inner[np.diag_indices(len(inner))] += 1.0
    return inner


@dataclass(frozen=True, eq=False)
class Solved:
    """Coefficients with their evidence."""

    nats: float  # log evidence against all coefficients at zero [nats]
    mean: Float[Array, " k"]  # posterior mean of the coefficients
    variance: Float[Array, " k"]  # posterior variance of each


def log_evidence(
    gram: Float[Array, "k k"], target: Float[Array, " k"], deviation: Float[Array, " k"]
) -> Solved:
    """Log evidence, means and variances of coefficients θ ~ N(0, diag deviation²).

    Args:
        gram: Sums of products of the columns, positive semidefinite.
        target: Sums of the columns times the torque.
        deviation: Prior standard deviation of each coefficient; zero fixes it at zero.
    """
    factor = factorise(_with_prior(gram, deviation))
    scaled = deviation * target
    mean = dpotrs(factor, scaled, lower=1)[0]
    inverse = dpotri(factor, lower=1)[0]
    nats = 0.5 * float(scaled @ mean) - float(np.log(np.diag(factor)).sum())
    return Solved(nats, deviation * mean, deviation**2 * np.diag(inverse))


@dataclass(frozen=True, eq=False)
class BlockVariances:
    """Variances of blocks of coefficients where their evidence is greatest."""

    nats: float  # log evidence against all variances at zero [nats]
    variances: Float[Array, " b"]  # of each block's coefficients; zero where the block is off


def optimise(
    gram: Float[Array, "k k"],
    target: Float[Array, " k"],
    sizes: Sequence[int],
    start: Float[Array, " b"],
) -> BlockVariances:
    """Variances of blocks of coefficients by marginal likelihood, by its analytic gradient over log
    variances.

    Args:
        gram, target: Sums of the blocks' columns, and of these times the torque.
        sizes: Number of columns of each block.
        start: Variances to begin with, above zero.
    """
    block = np.repeat(np.arange(len(sizes)), sizes)
    bounds = [(LEAST_LOG_VARIANCE, MOST_LOG_VARIANCE)] * len(sizes)

    def minus_evidence(logs: Float[Array, " b"]) -> tuple[float, Float[Array, " b"]]:
        variances = np.exp(logs)
        solved = log_evidence(gram, target, np.sqrt(variances)[block])
        power = solved.mean**2 + solved.variance
        gradient = 0.5 * (np.bincount(block, power, len(sizes)) / variances - np.asarray(sizes))
        return -solved.nats, -gradient

    first = np.clip(np.log(np.maximum(start, 1e-300)), LEAST_LOG_VARIANCE, MOST_LOG_VARIANCE)
    best = minimize(minus_evidence, first, jac=True, method="L-BFGS-B", bounds=bounds)
    variances = np.where(best.x > LEAST_LOG_VARIANCE + 1e-6, np.exp(best.x), 0.0)
    nats = log_evidence(gram, target, np.sqrt(variances)[block]).nats
    return (
        BlockVariances(nats, variances) if nats > 0.0 else BlockVariances(0.0, np.zeros(len(sizes)))
    )


@dataclass(frozen=True, eq=False)
class FreeGains:
    """What candidates add to a set with all coefficients free.

    Attributes:
        nats: Log evidence of each, without its name's odds; −∞ where rounding leaves none [nats].
        sizes: Their coefficients in the columns' scale.
    """

    nats: Float[Array, " m"]
    sizes: Float[Array, "m w"]


def free_gains(
    sums: Float[Array, "m w w"], target: Float[Array, "m w"], deviation: Float[Array, "m w"]
) -> FreeGains:
    """What candidates of equally many columns add to a set with all coefficients free.

    Args:
        sums, target: Sums of each one's columns and these times the torque, after the set.
        deviation: Standard deviation of each coefficient beforehand.
    """
    inner = deviation[:, :, None] * sums * deviation[:, None, :]
    inner = 0.5 * (inner + inner.transpose(0, 2, 1)) + np.eye(target.shape[1])
    # With one added to every eigenvalue none is below one, but for rounding.
    sound = np.linalg.eigvalsh(inner)[:, 0] > 0.5
    inner[~sound] = np.eye(target.shape[1])
    factor = np.linalg.cholesky(inner)
    scaled = deviation * target
    along = np.linalg.solve(inner, scaled[:, :, None])[:, :, 0]
    log_root = np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
    nats = 0.5 * np.sum(scaled * along, axis=1) - log_root
    nats[~sound] = -np.inf
    return FreeGains(nats, deviation * along)


def solve_set(
    sums: Float[Array, "k k"],
    target: Float[Array, " k"],
    deviation: Float[Array, " k"],
    signed: Float[Array, " k"],
) -> tuple[float, Float[Array, " k"]]:
    """Log evidence of coefficients against none [nats], and their estimates.

    Args:
        sums, target: Sums of the columns, and of these times the torque.
        deviation: Standard deviation of each beforehand.
        signed: Which of them can't be negative.

    Returns:
        Log evidence, and the coefficients in the columns' scale; none of the signed ones is
        negative.
    """
    inner = _with_prior(sums, deviation)
    factor = factorise(inner)
    scaled = deviation * target
    free = cho_solve((factor, True), scaled, check_finite=False)
    if (free[signed] < 0.0).any():
        free = solve_signed(inner, scaled, signed)
    gain = float(scaled @ free - 0.5 * free @ inner @ free)
    nats = gain - float(np.log(np.diag(factor)).sum()) + LOG_TWO * int(signed.sum())
    return nats, deviation * free


@dataclass(frozen=True, eq=False)
class MassLeft:
    """What recordings leave of a coefficient that is a mass, the others at their best beside it.

    Attributes:
        estimate: At the solution, where it is not below zero.
        deviation: Its standard deviation.
        slope: Derivative of the log evidence there; below 0 where the bound alone keeps it at zero.
        step: Change of all coefficients of the set as it grows by one.
    """

    estimate: float
    deviation: float
    slope: float
    step: Float[Array, " k"]

    def log_mean(self, log_ratio: Callable[[Float[Array, " s"]], Float[np.ndarray, " s"]]) -> float:
        """Log of the integral over all masses above zero of their normal likelihood, one at the
        solution with area one, times a ratio [nats].

        Args:
            log_ratio: Logarithm of the ratio by how much the mass is above its estimate.
        """
        mean = self.estimate + self.slope * self.deviation**2
        most = self.estimate + MASS_REACH * self.deviation
        least = max(mean - MASS_REACH * self.deviation, LEAST_NODE * most)
        logs = np.linspace(np.log(least), np.log(most), MASS_NODES)
        mass = np.exp(logs)
        above = mass - self.estimate
        likely = self.slope * above - 0.5 * (above / self.deviation) ** 2
        terms = likely + log_ratio(above) + logs
        weight = np.full(MASS_NODES, logs[1] - logs[0])
        weight[[0, -1]] *= 0.5
        area = np.log(self.deviation * np.sqrt(2.0 * np.pi))
        return float(logsumexp(terms, b=weight) - area)


def mass_left(
    sums: Float[Array, "k k"],
    target: Float[Array, " k"],
    deviation: Float[Array, " k"],
    signed: Bool[Array, " k"],
    estimate: Float[Array, " k"],
    place: int,
) -> MassLeft:
    """What recordings leave of one of a set's coefficients, which is a mass.

    Args:
        sums, target, deviation, signed: As in `solve_set`.
        estimate: What that found.
        place: Where the mass stands among the coefficients. Others that their bound keeps at zero
            stay there.
    """
    inner = _with_prior(sums, deviation)
    scaled = estimate / deviation
    slope = deviation * target - inner @ scaled
    free = ~(signed & (estimate <= 0.0))
    free[place] = True
    inside = np.flatnonzero(free)
    unit = (inside == place).astype(float)
    factor = factorise(inner[np.ix_(inside, inside)])
    column = cho_solve((factor, True), unit, check_finite=False)
    # At most one beforehand; rounding may leave nothing of it.
    variance = max(float(column @ unit), ROUNDING)
    step = np.zeros(len(estimate))
    step[inside] = deviation[inside] * column / (variance * deviation[place])
    return MassLeft(
        estimate=float(estimate[place]),
        deviation=float(deviation[place]) * float(np.sqrt(variance)),
        slope=min(float(slope[place]) / float(deviation[place]), 0.0),
        step=step,
    )
