"""What a fit says of units that it has not seen; the ridge and the features that are best by that.

A unit is a real arm, a drawn world, or an arm of another simulator. It is left out whole: a
calibration has to carry over to arms and worlds that nobody has seen, not to other recordings of
the same.

Source: Stone 1974 (cross-validation); Varma and Simon 2006 (what is chosen by it is judged by
another one around it).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.benchmark.logistic import Logistic, fit_logistic, log_score

RIDGES = np.geomspace(1.0, 1e-5, 11)
"""Candidates for the ridge, the stiffest first."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is fitted: rows that are right or wrong."""

    features: Float[Array, "N k"]
    names: tuple[str, ...]
    right: Bool[Array, " N"]
    weights: Float[Array, " N"]
    units: Array  # of each row
    signs: Mapping[str, int]  # +1 or -1 by feature, where its meaning says which way it speaks

    def fit(
        self, ridge: float, rows: Bool[Array, " N"] | None = None, start: Logistic | None = None
    ) -> Logistic:
        """The regression on some rows, all if none are given."""
        chosen = np.ones(len(self.right), dtype=bool) if rows is None else rows
        return fit_logistic(
            self.features[chosen],
            self.right[chosen],
            self.weights[chosen],
            self.names,
            ridge,
            self.signs,
            start,
        )

    def without_feature(self, name: str) -> Problem:
        """The problem without one of its features; a name that it lacks takes nothing away."""
        columns = [k for k, other in enumerate(self.names) if other != name]
        names = tuple(self.names[k] for k in columns)
        return replace(self, names=names, features=self.features[:, columns])

    def without_unit(self, unit: str) -> Problem:
        """The rows of all other units."""
        rows = self.units != unit
        return replace(
            self,
            features=self.features[rows],
            right=self.right[rows],
            weights=self.weights[rows],
            units=self.units[rows],
        )

    def score(self, probability: Float[Array, " N"]) -> float:
        """Weighted mean log probability of what is true [nats a row]."""
        return log_score(probability, self.right, self.weights)


def left_out(
    problem: Problem, ridge: float, starts: dict[str, Logistic] | None = None
) -> Float[Array, " N"]:
    """Probability of each row from a fit without its unit.

    Args:
        problem: All rows.
        ridge: Of the fits.
        starts: Fits by unit to begin at; holds those that were made afterwards.
    """
    fits = {} if starts is None else starts
    probability = np.full(len(problem.right), np.nan)
    for unit in np.unique(problem.units):
        inside = problem.units == unit
        model = problem.fit(ridge, ~inside, fits.get(str(unit)))
        fits[str(unit)] = model
        probability[inside] = model.probability(problem.features[inside])
    return probability


def score_ridges(problem: Problem) -> dict[float, float]:
    """Log score on units left out, by the ridge of the regression.

    Args:
        problem: Features, truths and weights of all rows, and the units that are left out whole.

    Returns:
        Weighted mean log probability of what is true [nats a row], by ridge. Each fit starts at the
        one of the ridge before.
    """
    scores: dict[float, float] = {}
    starts: dict[str, Logistic] = {}
    for ridge in RIDGES:
        scores[float(ridge)] = problem.score(left_out(problem, float(ridge), starts))
    return scores


def best_ridge(scores: Mapping[float, float]) -> float:
    """The ridge of the best log score."""
    return max(scores, key=lambda ridge: scores[ridge])


def select_features(problem: Problem) -> Problem:
    """Drops features one by one as long as units left out are foretold about as well.

    Each time the one goes whose loss costs least; it stops where the log score is worse than the
    best by more than a standard error of the difference between units. The ridge is chosen once,
    with all features.

    Source: Breiman and others 1984 (the rule of one standard error).
    """
    ridge = best_ridge(score_ridges(problem))
    best = unit_scores(problem, left_out(problem, ridge))
    while len(problem.names) > 1:
        smaller = [problem.without_feature(name) for name in problem.names]
        scores = [unit_scores(candidate, left_out(candidate, ridge)) for candidate in smaller]
        kth = int(np.argmax([score.sum() for score in scores]))
        loss = best - scores[kth]
        if loss.sum() > np.sqrt(len(loss)) * loss.std():
            break
        problem = smaller[kth]
        if scores[kth].sum() > best.sum():
            best = scores[kth]
    return problem


def unit_scores(problem: Problem, probability: Float[Array, " N"]) -> Float[Array, " u"]:
    """What each unit adds to the log score [nats a row].

    Returns:
        One a unit, in the order of their names; they add up to the log score.
    """
    truth = np.where(problem.right, probability, 1.0 - probability)
    nats = problem.weights * np.log(np.clip(truth, 1e-12, 1.0)) / problem.weights.sum()
    _, numbers = np.unique(problem.units, return_inverse=True)
    return np.bincount(numbers, weights=nats)


def probability_by_unit(
    models: Mapping[str, Logistic],
    units: Array,
    features: Float[Array, "N k"],
    names: Sequence[str],
) -> Float[Array, " N"]:
    """Probability of each row by the fit for its unit; 0 of a unit without one.

    Args:
        models: By unit, each of some of the features.
        units: Of each row.
        features, names: Of all rows, and the features' names.
    """
    probability = np.zeros(len(units))
    for unit, model in models.items():
        rows = units == unit
        columns = [names.index(name) for name in model.names]
        probability[rows] = model.probability(features[rows][:, columns])
    return np.nan_to_num(probability)


def judge_left_out(problem: Problem) -> dict[str, Logistic]:
    """For each unit a fit without it, whose ridge and features are chosen without it as well.

    Returns:
        By the unit's name.
    """
    models: dict[str, Logistic] = {}
    for unit in np.unique(problem.units):
        chosen = select_features(problem.without_unit(str(unit)))
        models[str(unit)] = chosen.fit(best_ridge(score_ridges(chosen)))
    return models
