"""How an arm's figures spread from day to day, where there are few days.

The variances of one kind at n joints, as shares of their sizes, are taken as draws of a scaled
inverse χ² with ν₀ degrees of freedom about s₀²; a joint's own s², of d = D − 1, is then known as
(ν₀ s₀² + d s²) / (ν₀ + d), with ν₀ + d degrees. ν₀ and s₀ follow from mean and variance of log s²:

    mean = log s₀² + ψ(d/2) − log(d/2) − ψ(ν₀/2) + log(ν₀/2),    variance = ψ'(d/2) + ψ'(ν₀/2).

Source: Smyth 2004 (moderated t: hyperparameters of an inverse χ² by moments of log s²).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, polygamma

from ident.arrays import Array, Float
from ident.monitor.parameters import SCALED

# Figures of a kind of which their spreads tell each other.
FEWEST_ALIKE = 3
# A size below which no share makes sense.
LEAST_SIZE = 1e-12
# Half degrees of freedom that are as good as none, and as good as all.
FEWEST_DEGREES = 1e-3
MOST_DEGREES = 1e9

Figure = tuple[str, str]
"""Joint, and parameter's name."""


def moderated_spreads(
    values: Mapping[Figure, Float[Array, " D"]],
) -> dict[Figure, tuple[float, float]]:
    """Standard deviation of each figure from day to day, by all figures of its kind.

    A kind at fewer than three joints, or with a spread of nothing, is left as it is.

    Args:
        values: The figures of D days.

    Returns:
        Each figure's standard deviation in its unit, and the degrees of freedom of it.
    """
    spreads: dict[Figure, tuple[float, float]] = {}
    for kind in {name for _, name in values}:
        alike = {key: days for key, days in values.items() if key[1] == kind}
        spreads |= _spreads_of_kind(alike, relative=kind in SCALED)
    return spreads


def _spreads_of_kind(
    values: Mapping[Figure, Float[Array, " D"]], relative: bool
) -> dict[Figure, tuple[float, float]]:
    """The same of figures of one kind; relative if a spread is a share of the figure's size."""
    freedom = float(min(len(days) for days in values.values()) - 1)
    deviations = {}
    sizes = {}
    for key, days in values.items():
        deviations[key] = float(days.std(ddof=1)) if len(days) > 1 else 0.0
        sizes[key] = max(float(np.abs(days).mean()) if relative else 1.0, LEAST_SIZE)
    shares = np.array([deviations[key] / sizes[key] for key in values])
    can_moderate = freedom >= 1.0 and len(values) >= FEWEST_ALIKE
    if not can_moderate or not (shares > 0.0).all():
        return {key: (deviation, freedom) for key, deviation in deviations.items()}
    square, more = _prior_of_variances(shares**2, freedom)
    weight = 1.0 if np.isinf(more) else more / (more + freedom)
    # No more degrees than all joints have together: s₀² is known no better.
    degrees = min(freedom + more, len(values) * freedom)
    spreads = {}
    for key, share in zip(values, shares, strict=True):
        pooled = weight * square + (1.0 - weight) * share**2
        spreads[key] = (float(np.sqrt(pooled)) * sizes[key], degrees)
    return spreads


def _prior_of_variances(squares: Float[Array, " n"], freedom: float) -> tuple[float, float]:
    """s₀² and ν₀ of variances with so many degrees of freedom.

    ν₀ is infinite where they differ by chance alone.
    """
    half = freedom / 2.0
    logs = np.log(squares) - digamma(half) + np.log(half)
    rest = float(logs.var(ddof=1)) - float(polygamma(1, half))
    if rest <= 0.0:
        return float(np.exp(logs.mean())), float("inf")
    # ψ' falls from infinity to zero: one root.
    half_more = float(
        brentq(
            lambda degrees: float(polygamma(1, degrees)) - rest,
            FEWEST_DEGREES,
            MOST_DEGREES,
        )
    )
    square = float(np.exp(logs.mean() + digamma(half_more) - np.log(half_more)))
    return square, 2.0 * half_more
