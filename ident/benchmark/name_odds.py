"""Fits the odds of candidates being right, and says how they hold on units that the fit never saw.

A candidate is right if it says what was put into its session; what is no news on a real arm follows
from the probabilities themselves (`fit_calibration`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus_table import Table
from ident.benchmark.labels import RIGHT, UNKNOWN
from ident.benchmark.leave_out import (
    Problem,
    best_ridge,
    judge_left_out,
    left_out,
    probability_by_unit,
    score_ridges,
    select_features,
)
from ident.benchmark.logistic import Logistic, log_score
from ident.benchmark.outcomes import KNOWN_FROM, NAMED_FROM
from ident.benchmark.scores import auroc, calibration_curve
from ident.errors import InputError
from ident.records import JsonRecord

BINS = 5
# The probabilities of untouched recordings decide what is no news there, and depend on it: so often
# at most in turn.
MOST_ROUNDS = 4
ROWS = "rows"
SESSIONS = "sessions"
GROUPS = "groups"
SCHEMES = (ROWS, SESSIONS, GROUPS)
"""What counts alike in a fit; see `row_weights`."""
FEWEST_ROWS = 10  # right and wrong rows, below which nothing can be fitted


@dataclass(frozen=True, eq=False)
class FittedNames:
    """A calibration, with what it says of units that it has not seen."""

    model: Logistic
    ridge: float
    scores: dict[float, float]  # held-out log score of each ridge that was tried
    # Probability of each row of the table, from a fit without its unit.
    held_out: Float[Array, " N"]
    labels: Array  # of each row of the table


def row_weights(table: Table, counted: Bool[Array, " N"], scheme: str) -> Float[Array, " N"]:
    """How much each row counts, 1 on average over the counted ones; none counts of the others.

    Of `rows` each counts alike: only then is what is said of a name as often right as it says, for
    a session with few candidates would else lend them its weight. Of `sessions` each session counts
    alike, of `groups` each group, and in it each session.

    Raises:
        InputError: An unknown scheme.
    """
    if scheme not in SCHEMES:
        raise InputError("--weights", f"unknown scheme {scheme!r}", f"one of: {', '.join(SCHEMES)}")
    weights = counted.astype(float)
    if scheme != ROWS:
        cases = table.cases
        rows_of_case = Counter(cases[counted])
        groups = table.groups if scheme == GROUPS else np.full(len(cases), "all", dtype=object)
        group_of_case = dict(zip(cases[counted], groups[counted], strict=True))
        cases_of_group = Counter(group_of_case.values())
        for k in np.flatnonzero(counted):
            weights[k] = 1.0 / (cases_of_group[groups[k]] * rows_of_case[cases[k]])
    return weights * counted.sum() / max(weights.sum(), 1e-300)


def fit_calibration(
    table: Table,
    names: Sequence[str],
    signs: Mapping[str, int],
    scheme: str = ROWS,
    select: bool = False,
    nested: bool = False,
) -> FittedNames:
    """Fits and judges a calibration; what is no news on a real arm follows from its probabilities.

    Args:
        table: Of candidates.
        names: Features that may be used.
        signs: +1 or -1 by feature, where its meaning says which way it speaks.
        scheme: What counts alike, see `row_weights`.
        select: Whether to leave features out by which units left out are foretold no better.
        nested: Whether they are chosen anew without each unit before it is judged; takes minutes.

    Raises:
        InputError: Too few rows that are right or wrong, or all of one unit.
    """
    known = table.named
    previous: Array | None = None
    for _ in range(MOST_ROUNDS):
        labels = table.labels(known)
        fitted = _fit_labelled(table, names, signs, labels, scheme)
        if previous is not None and np.array_equal(labels, previous):
            break
        previous = labels
        known = fitted.held_out >= KNOWN_FROM
    if select:
        problem = problem_of(table, names, signs, fitted.labels, scheme)
        chosen = select_features(problem)
        fitted = _fit_problem(chosen, table, fitted.labels)
        if nested:
            fitted = replace(fitted, held_out=_said_by(judge_left_out(problem), table))
    return fitted


def problem_of(
    table: Table, names: Sequence[str], signs: Mapping[str, int], labels: Array, scheme: str
) -> Problem:
    """The rows of a table that are right or wrong.

    Raises:
        InputError: Too few of them, or all of one unit.
    """
    counted = labels != UNKNOWN
    right = labels == RIGHT
    count_right = int(right.sum())
    count_wrong = int((counted & ~right).sum())
    if min(count_right, count_wrong) < FEWEST_ROWS:
        what = f"holds {count_right} right and {count_wrong} wrong candidates"
        raise InputError("the table", what, "diagnose more of the corpus")
    units = table.units[counted]
    if len(np.unique(units)) < 2:
        raise InputError("the table", "is of one arm or world", "leaving one out takes two or more")
    weights = row_weights(table, counted, scheme)[counted]
    features = table.matrix(names)[counted]
    return Problem(features, tuple(names), right[counted], weights, units, signs)


def _fit_labelled(
    table: Table, names: Sequence[str], signs: Mapping[str, int], labels: Array, scheme: str
) -> FittedNames:
    return _fit_problem(problem_of(table, names, signs, labels, scheme), table, labels)


def _fit_problem(problem: Problem, table: Table, labels: Array) -> FittedNames:
    scores = score_ridges(problem)
    ridge = best_ridge(scores)
    starts: dict[str, Logistic] = {}
    left_out(problem, ridge, starts)
    return FittedNames(problem.fit(ridge), ridge, scores, _said_by(starts, table), labels)


def _said_by(models: Mapping[str, Logistic], table: Table) -> Float[Array, " N"]:
    """What the fits say, each of the unit that it has not seen; 0 of a unit without one."""
    names = sorted({name for model in models.values() for name in model.names})
    return probability_by_unit(models, table.units, table.matrix(names), names)


def judged(
    table: Table, probability: Float[Array, " N"], labels: Array, rows: Bool[Array, " N"]
) -> JsonRecord:
    """How probabilities hold on some rows that are right or wrong."""
    counted = rows & (labels != UNKNOWN)
    right = labels[counted] == RIGHT
    p = probability[counted]
    named = p >= NAMED_FROM
    bins = [
        {"said": round(said, 4), "right": round(hit.value or 0.0, 4), "count": hit.count}
        for _, _, said, hit in calibration_curve(list(p), list(right), BINS)
    ]
    area = auroc(list(p[right]), list(p[~right]))
    return {
        "rows": int(counted.sum()),
        "right_rows": int(right.sum()),
        "log_score": round(log_score(p, right, np.ones(len(p))), 5) if len(p) else None,
        "auc": None if area.value is None else round(area.value, 4),
        "names_right": int((named & right).sum()),
        "names_wrong": int((named & ~right).sum()),
        "bins": bins,
    }


def judge_groups(table: Table, fitted: FittedNames) -> dict[str, JsonRecord]:
    """How well probabilities of units left out do: of all rows, and of each group by its name."""
    groups = table.groups
    everything = np.ones(len(table.rows), dtype=bool)
    scores = {"all": judged(table, fitted.held_out, fitted.labels, everything)}
    for group in np.unique(groups):
        scores[str(group)] = judged(table, fitted.held_out, fitted.labels, groups == group)
    return scores
