"""Fits how often a cause is right although one of its figures is none that an arm has.

What an effect's own bounds rule out is no such effect, whatever else speaks for it: but bounds and
intervals have their errors, so that some of these causes are right all the same. The share of the
probability that stays is fitted so that as many are right as the probabilities then say. It is
judged on arms and worlds that were left out whole.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ident.arrays import Bool, Float
from ident.benchmark.corpus_table import Table
from ident.benchmark.labels import RIGHT, UNKNOWN
from ident.inference.calibration import Odds

FEATURE = "unlike_any_arm"
# Half a candidate that is right and half a one that is wrong are added, both sure beforehand:
# without one of either kind the share would be 0 or 1 (Jeffreys' prior of a share).
ADDED = 0.5


@dataclass(frozen=True)
class UnlikeFit:
    """What is fitted, and how it holds."""

    share: float  # of the probability that stays
    right: int  # candidates of this kind that are right
    wrong: int  # and that are wrong
    held_out_nats: float  # log score gained over all of them, each by a fit without its unit


def fit_unlike(tables: Sequence[Table], odds: Odds) -> UnlikeFit:
    """Fits it to the candidates of some corpora.

    Left out are those that are neither right nor wrong (`labels`). A recording that stands in
    several tables counts once.

    Args:
        tables: Their candidates.
        odds: Of names, without a part of this feature.

    Returns:
        The share with how it holds; one half where no candidate has such a figure.
    """
    probabilities: list[float] = []
    right: list[bool] = []
    units: list[str] = []
    seen: set[str] = set()
    for table in tables:
        labels = table.labels(table.named)
        unlike = table.features.get(FEATURE, np.zeros(len(table.rows)))
        counted = (unlike > 0.0) & (labels != UNKNOWN)
        for k in np.flatnonzero(counted):
            if table.rows[k]["case"] in seen:
                continue
            features = {name: float(column[k]) for name, column in table.features.items()}
            probabilities.append(odds.probability(features))
            right.append(labels[k] == RIGHT)
            units.append(str(table.units[k]))
        seen |= _recorded(table)
    said = np.array(probabilities)
    is_right = np.array(right, dtype=bool)
    of_unit = np.array(units)
    gained = 0.0
    for unit in np.unique(of_unit):
        inside = of_unit == unit
        share = _solve(said[~inside], is_right[~inside])
        gained += _log_score(share * said[inside], is_right[inside])
        gained -= _log_score(said[inside], is_right[inside])
    count = int(is_right.sum())
    return UnlikeFit(_solve(said, is_right), count, len(right) - count, gained)


def _recorded(table: Table) -> set[str]:
    """Cases of a table in which nothing was planted: every corpus of real arms has them alike."""
    sessions = table.sessions.values()
    return {session.case for session in sessions if session.kind in ("control", "measured")}


def _solve(said: Float[np.ndarray, " N"], right: Bool[np.ndarray, " N"]) -> float:
    """The share with which the log score is greatest."""

    def loss(share: float) -> float:
        added = ADDED * float(np.log(share) + np.log1p(-share))
        return -_log_score(share * said, right) - added

    return float(minimize_scalar(loss, bounds=(1e-6, 1.0 - 1e-6), method="bounded").x)


def _log_score(said: Float[np.ndarray, " N"], right: Bool[np.ndarray, " N"]) -> float:
    """Log probability of what is true [nats]."""
    return float(np.log(np.where(right, said, 1.0 - said)).sum())
