"""Fits how probably a cause without a name is left at a joint, from what is left there beside the
names.

A joint has such a cause if something was put there, large enough to be seen, that no name says. It
has none where a simulated arm has nothing wrong at the joint, or what is wrong there has its name.
Of a real arm nobody knows what else is wrong with it, so none of its joints is known to have no
cause; those with one alone would say that whatever is real has one. So real arms judge the odds,
and are not fitted to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus import Entry, Truth
from ident.benchmark.corpus_table import REAL
from ident.benchmark.labels import Name, matching
from ident.benchmark.logistic import Logistic, fit_logistic, log_score
from ident.inference.joints_left import BESIDE, COMPARED, beside_others
from ident.records import JsonTable

# What is left at a joint alone, and how far it stands out among the arm's joints: how many rows or
# names an arm has tells arms apart, not gaps.
FEATURES = (
    "log_smooth_nats",
    "log_smooth_nats_a_row",
    "smooth_share",
    "log_dispersion",
    "log_left_over_noise",
    "repeated_share",
    "repeated_in_errors",
    *(f"{name}{BESIDE}" for name in COMPARED),
)
RIDGES = np.geomspace(1e-3, 1.0, 7)
SEEN_FROM = 1.0  # visible size, in floors of the noise, from which a cause can be asked for


@dataclass(frozen=True, eq=False)
class JointRows:
    """Joints of the corpus, each with or without a cause that has no name."""

    features: Float[Array, "N k"]
    open: Bool[Array, " N"]  # whether there is such a cause
    units: Array

    @classmethod
    def of(
        cls,
        results: Mapping[str, JsonTable],
        entries: Mapping[str, Entry],
    ) -> JointRows:
        """The rows of all results.

        What is left at a joint was measured beside the names that the session was given then, so
        whether a cause is without a name is asked of these.

        Args:
            results, entries: Results and index entries by case.
        """
        features = []
        gaps = []
        units = []
        for case, result in results.items():
            entry = entries.get(case)
            if entry is None or entry.group in REAL or not result.get("joints"):
                continue
            named = [candidate for candidate in result["candidates"] if candidate["named"]]
            names = [Name.of_candidate(candidate) for candidate in named]
            rows = _labelled(result["joints"], entry, names)
            for values, is_open in rows:
                features.append([values[name] for name in FEATURES])
                gaps.append(is_open)
                units.append(unit_of(entry))
        return cls(np.array(features), np.array(gaps), np.array(units))


def unit_of(entry: Entry) -> str:
    """What is left out whole: a real arm, a drawn world, an arm of another simulator."""
    return f"{entry.group}:{entry.world if entry.group == 'worlds' else entry.arm}"


def _labelled(
    joints: Sequence[JsonTable], entry: Entry, named: Sequence[Name]
) -> list[tuple[Mapping[str, float], bool]]:
    """Features of the joints of a session of which it is known whether a cause without a name is
    left.
    """
    rows: list[tuple[Mapping[str, float], bool]] = []
    compared = beside_others([row["features"] for row in joints])
    for row, features in zip(joints, compared, strict=True):
        here = [truth for truth in entry.truth if _may_stand(truth, row["joint"])]
        missed = [truth for truth in here if not _is_said(truth, named)]
        if any(_size_at(truth, row["joint"]) >= SEEN_FROM for truth in missed):
            rows.append((features, True))
        elif not missed and not _anywhere(entry):
            rows.append((features, False))
    return rows


def _may_stand(truth: Truth, joint: str) -> bool:
    """Whether a true cause may be named at a joint."""
    return joint in (truth.may_stand_at or truth.joints)


def _is_said(truth: Truth, names: Sequence[Name]) -> bool:
    """Whether any of some names is that of a true cause."""
    return any(matching(name, [truth]) is not None for name in names)


def _size_at(truth: Truth, joint: str) -> float:
    """What a cause shows at a joint; the size that was asked for where that is not known, and of
    one that was not asked for a visible one.
    """
    if truth.visible:
        return truth.visible.get(joint, 0.0)
    return truth.asked if truth.asked is not None else SEEN_FROM


def _anywhere(entry: Entry) -> bool:
    """Whether something is wrong of which nobody knows the joint."""
    return any(not (truth.may_stand_at or truth.joints) for truth in entry.truth)


def joined(corpora: Sequence[JointRows]) -> JointRows:
    """The rows of several corpora; what is left out whole is left out of all of them."""
    return JointRows(
        np.concatenate([rows.features for rows in corpora]),
        np.concatenate([rows.open for rows in corpora]),
        np.concatenate([rows.units for rows in corpora]),
    )


@dataclass(frozen=True, eq=False)
class GapFit:
    """The fitted odds, judged on units that were left out."""

    model: Logistic
    ridge: float
    told: float  # share of joints with a cause without a name that are told one
    false: float  # share of the other joints that are told one
    counts: tuple[int, int]


def fit_gaps(rows: JointRows) -> GapFit:
    """Fits the odds; every feature speaks for a cause.

    All joints weigh alike, for a probability is told of each joint.
    """
    signs = dict.fromkeys(FEATURES, 1)
    weights = np.ones(len(rows.open))
    best: tuple[float, float, Float[Array, " N"]] | None = None
    for ridge in RIDGES:
        probability = np.zeros(len(rows.open))
        for unit in np.unique(rows.units):
            inside = rows.units == unit
            model = fit_logistic(
                rows.features[~inside],
                rows.open[~inside],
                weights[~inside],
                FEATURES,
                float(ridge),
                signs,
            )
            probability[inside] = model.probability(rows.features[inside])
        score = log_score(probability, rows.open, weights)
        if best is None or score > best[0]:
            best = score, float(ridge), probability
    assert best is not None
    _, ridge, probability = best
    model = fit_logistic(rows.features, rows.open, weights, FEATURES, ridge, signs)
    told = probability >= 0.5
    return GapFit(
        model,
        ridge,
        float(told[rows.open].mean()),
        float(told[~rows.open].mean()),
        (int(rows.open.sum()), int((~rows.open).sum())),
    )
