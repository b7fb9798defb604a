"""Logistic regression with a ridge on standardised features, and weights of a known sign.

    log odds = b + sum_k w_k (x_k - c_k) / s_k

minimises the weighted mean of the log loss and ridge / 2 times the sum of squares of w. A weight of
a feature that speaks for a candidate by its meaning is not negative, that of one that speaks
against it not positive.

Source: Hosmer, Lemeshow and Sturdivant 2013 (logistic regression); Hoerl and Kennard 1970 (ridge).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.special import expit

from ident.arrays import Array, Bool, Float

# A feature that varies less than this, beside its size, is constant.
LEAST_SPREAD = 1e-9
MOST_STEPS = 500


@dataclass(frozen=True, eq=False)
class Scaling:
    """Centre and scale of each feature."""

    centre: Float[Array, " k"]
    scale: Float[Array, " k"]

    @classmethod
    def of(cls, features: Float[Array, "N k"], weights: Float[Array, " N"]) -> Scaling:
        """Weighted mean and standard deviation of what is a number."""
        known = np.isfinite(features)
        share = weights[:, None] * known
        total = np.maximum(share.sum(axis=0), 1e-300)
        values = np.where(known, features, 0.0)
        centre = (share * values).sum(axis=0) / total
        variance = (share * (values - centre) ** 2).sum(axis=0) / total
        scale = np.sqrt(variance)
        constant = scale <= LEAST_SPREAD * np.maximum(np.abs(centre), 1.0)
        return cls(centre, np.where(constant, np.inf, scale))

    def applied(self, features: Float[Array, "N k"]) -> Float[Array, "N k"]:
        """Standardised features; what is no number is as the mean, so that it says nothing."""
        standard = (features - self.centre) / self.scale
        return np.where(np.isfinite(standard), standard, 0.0)


@dataclass(frozen=True, eq=False)
class Logistic:
    """A fitted regression."""

    names: tuple[str, ...]
    scaling: Scaling
    weights: Float[Array, " k"]  # of standardised features
    intercept: float

    def log_odds(self, features: Float[Array, "N k"]) -> Float[Array, " N"]:
        """Log odds of each row [nats]."""
        return self.intercept + self.scaling.applied(features) @ self.weights

    def probability(self, features: Float[Array, "N k"]) -> Float[Array, " N"]:
        """Probability that each row is right."""
        return np.asarray(expit(self.log_odds(features)), dtype=float)


def fit_logistic(
    features: Float[Array, "N k"],
    right: Bool[Array, " N"],
    weights: Float[Array, " N"],
    names: Sequence[str],
    ridge: float,
    signs: Mapping[str, int] | None = None,
    start: Logistic | None = None,
) -> Logistic:
    """Fits the regression.

    Args:
        features: A row a candidate; what is no number says nothing.
        right: Whether each is right.
        weights: How much each row counts; only their ratios matter.
        names: Of the features.
        ridge: Penalty on the squares of the weights, beside a mean loss.
        signs: +1 or -1 by feature, where its meaning says which way it speaks.
        start: A fit to start from; its scaling is not taken over.
    """
    scaling = Scaling.of(features, weights)
    standard = scaling.applied(features)
    share = weights / weights.sum()
    sides = np.where(right, 1.0, -1.0)
    first = np.zeros(len(names) + 1)
    if start is None:
        first[-1] = _base_log_odds(right, share)
    else:
        first[:-1] = start.weights
        first[-1] = start.intercept

    def loss(values: Float[Array, " k"]) -> tuple[float, Float[Array, " k"]]:
        coefficients = values[:-1]
        intercept = values[-1]
        margin = sides * (standard @ coefficients + intercept)
        pull = -share * sides * expit(-margin)
        value = float(share @ np.logaddexp(0.0, -margin)) + 0.5 * ridge * float(
            coefficients @ coefficients
        )
        gradient = np.append(standard.T @ pull + ridge * coefficients, pull.sum())
        return value, gradient

    bounds = [_bound((signs or {}).get(name, 0)) for name in names]
    solution = minimize(
        loss,
        first,
        jac=True,
        method="L-BFGS-B",
        bounds=[*bounds, (None, None)],
        options={"maxiter": MOST_STEPS},
    )
    return Logistic(tuple(names), scaling, solution.x[:-1], float(solution.x[-1]))


def _base_log_odds(right: Bool[Array, " N"], share: Float[Array, " N"]) -> float:
    """Log odds of the share that is right."""
    rate = float(np.clip(share @ right, 1e-6, 1.0 - 1e-6))
    return float(np.log(rate / (1.0 - rate)))


def _bound(sign: int) -> tuple[float | None, float | None]:
    if sign > 0:
        return 0.0, None
    if sign < 0:
        return None, 0.0
    return None, None


def log_score(
    probability: Float[Array, " N"], right: Bool[Array, " N"], weights: Float[Array, " N"]
) -> float:
    """Weighted mean log probability of what is true [nats]; 0 is perfect."""
    p = np.clip(np.where(right, probability, 1.0 - probability), 1e-12, 1.0)
    return float(weights @ np.log(p) / weights.sum())
