"""Fits how far log evidence between rivals is to be believed.

That is the exponent T of p ∝ exp(−T d), with d the deficit of each.
Where an effect that was put there is the chosen one, or one of its rivals, its share among them is
exp(−T d) over the sum of all; T is where the product of these shares over the corpus is greatest.
It may grow with the number of samples N, as t (N / 1000)^g: on a few seconds the same nats say
less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize, minimize_scalar

from ident.arrays import Array, Float
from ident.benchmark.corpus import Entry, Truth
from ident.inference.calibration import Temper
from ident.records import JsonTable

# Logarithms of T between which it is looked for.
LEAST = -8.0
MOST = 1.0


@dataclass(frozen=True, eq=False)
class Choice:
    """Deficit of the true effect, and those of all that may stand for it [nats]."""

    true: float
    deficits: Float[Array, " r"]
    log_rows: float = 0.0  # logarithm of the number of samples where the effect shows

    def log_share(self, temper: float) -> float:
        """Logarithm of the true effect's share."""
        return -temper * self.true - float(np.logaddexp.reduce(-temper * self.deficits))


def choices(results: Mapping[str, JsonTable], entries: Mapping[str, Entry]) -> list[Choice]:
    """All choices of the corpus in which the true effect takes part."""
    of_corpus = []
    for case, result in results.items():
        if case not in entries:
            continue
        for candidate in result["candidates"]:
            for truth in entries[case].truth:
                choice = _choice_of(candidate, truth)
                if choice is not None:
                    of_corpus.append(choice)
    return of_corpus


def _choice_of(candidate: JsonTable, truth: Truth) -> Choice | None:
    """The choice between a candidate and its rivals; None where the true effect is none of them."""
    members = [(candidate["effect"], 0.0)]
    members += [(rival["effect"], rival["deficit"]) for rival in candidate["rivals"]]
    of_truth = [deficit for effect, deficit in members if effect == truth.effect]
    if not of_truth or not _at_its_place(candidate, truth):
        return None
    deficits = np.array([deficit for _, deficit in members])
    log_rows = float(candidate["features"].get("log_rows", 0.0))
    return Choice(min(of_truth), deficits, log_rows)


def _at_its_place(candidate: JsonTable, truth: Truth) -> bool:
    places = set(truth.may_stand_at or truth.joints)
    return not places or bool(places & set(candidate["joints"]))


def fit_temper(every: list[Choice]) -> float:
    """The exponent of greatest likelihood."""

    def minus_log_likelihood(log_temper: float) -> float:
        return -sum(choice.log_share(float(np.exp(log_temper))) for choice in every)

    best = minimize_scalar(minus_log_likelihood, bounds=(LEAST, MOST), method="bounded")
    return float(np.exp(best.x))


def fit_growing_temper(every: list[Choice]) -> Temper:
    """The exponent and its growth of greatest likelihood."""

    def minus_log_likelihood(numbers: Float[Array, " 2"]) -> float:
        temper = Temper(float(np.exp(numbers[0])), float(numbers[1]))
        return -sum(choice.log_share(temper.at(choice.log_rows)) for choice in every)

    first = np.array([np.log(fit_temper(every)), 0.0])
    best = minimize(minus_log_likelihood, first, method="Nelder-Mead")
    return Temper(float(np.exp(best.x[0])), float(best.x[1]))
