"""Fits what a parameter that no arm has takes off a name's log odds.

Few candidates have one, so that a ridge over all features would hide what it says: its part is
fitted alone, beside the odds as they are, so that as many of these candidates are right as the odds
say. It is judged on arms and worlds that were left out whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import expit, log_expit

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus_table import Table
from ident.benchmark.labels import RIGHT, UNKNOWN
from ident.errors import InputError
from ident.inference.calibration import Odds

FEATURE = "unlike_any_arm"
# Half a candidate that is right and half a one that is wrong are added, both of even odds: without
# one of either kind there would be no bound (Jeffreys' prior of a share).
ADDED = 0.5
# Log odds between which the solution lies [nats].
BOUNDS = (-50.0, 50.0)


@dataclass(frozen=True)
class UnlikeFit:
    """What is fitted, and how it holds."""

    nats: float  # added to the log odds
    right: int  # candidates of this kind that are right
    wrong: int  # and that are wrong
    held_out_nats: float  # log score gained over all of them, each by a fit without its unit


def fit_unlike(tables: Sequence[Table], odds: Odds) -> UnlikeFit:
    """Fits it to the candidates of some corpora.

    Args:
        tables: Their candidates.
        odds: Of names, without a part of this feature.

    Raises:
        InputError: No candidate has such a parameter.
    """
    log_odds: list[float] = []
    right: list[bool] = []
    units: list[str] = []
    for table in tables:
        labels = table.labels(table.named)
        counted = (labels != UNKNOWN) & (table.features[FEATURE] > 0.0)
        for k in np.flatnonzero(counted):
            features = {name: float(column[k]) for name, column in table.features.items()}
            log_odds.append(odds.log_odds(features))
            right.append(labels[k] == RIGHT)
            units.append(str(table.units[k]))
    if not right:
        raise InputError("the tables", f"hold no candidate with {FEATURE}", "diagnose more sessions")
    values = np.array(log_odds)
    is_right = np.array(right)
    of_unit = np.array(units)
    gained = 0.0
    for unit in np.unique(of_unit):
        inside = of_unit == unit
        nats = _solve(values[~inside], is_right[~inside])
        gained += _log_score(values[inside] + nats, is_right[inside])
        gained -= _log_score(values[inside], is_right[inside])
    count = int(is_right.sum())
    return UnlikeFit(_solve(values, is_right), count, len(right) - count, gained)


def _solve(log_odds: Float[Array, " N"], right: Bool[Array, " N"]) -> float:
    """Log odds that are to be added so that as many are right as they say."""

    def too_many(nats: float) -> float:
        said = float(expit(log_odds + nats).sum()) + 2.0 * ADDED * float(expit(nats))
        return said - float(right.sum()) - ADDED

    return float(brentq(too_many, *BOUNDS))


def _log_score(log_odds: Float[Array, " N"], right: Bool[Array, " N"]) -> float:
    """Log probability of what is true [nats]."""
    return float(log_expit(np.where(right, log_odds, -log_odds)).sum())
