"""Scores by what the worlds of a check differ in, and the stratum where they are worst.

A property that spans decades is cut at powers of ten, another number at the terciles of the cases, a word at itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ident.blind_check.scoring import JUDGED, Outcome
from ident.blind_check.statistics import Score, calibration_error, share
from ident.blind_check.world_axes import DECADES, NUMBERS, WORDS

# A stratum with fewer visible single effects is no stratum.
LEAST_CASES = 8


@dataclass(frozen=True)
class Stratum:
    """Cases whose worlds are alike in one property.

    Attributes:
        axis: The property.
        low, high: Bounds of a number.
        value: A word; empty for a number.
        cases: How many.
        scores: `strict`, `class_aware`, `joint` and `companion` of visible single effects in rich motion;
            `false_alarm` and `told_gap` of healthy arms and decoys; `calibration_error`.
    """

    axis: str
    low: float
    high: float
    value: str
    cases: int
    scores: Mapping[str, Score]

    @property
    def label(self) -> str:
        """For a person."""
        return f"{self.axis} {self.value}" if self.value else f"{self.axis} {self.low:.3g} to {self.high:.3g}"

    def to_dict(self) -> dict[str, Any]:
        ends: dict[str, Any] = {"value": self.value} if self.value else {"low": self.low, "high": self.high}
        counts = {name: score.count for name, score in self.scores.items()}
        intervals = {name: [score.low, score.high] for name, score in self.scores.items()}
        values = {name: score.value for name, score in self.scores.items()}
        return {**ends, "cases": self.cases, **values, "counts": counts, "intervals": intervals}


def stratify(outcomes: Sequence[Outcome]) -> dict[str, list[Stratum]]:
    """Strata of every property in which the worlds differ."""
    placed = [one for one in outcomes if one.world]
    found = {}
    for axis in (*NUMBERS, *WORDS):
        values = [one.world[axis] for one in placed if axis in one.world]
        if len(set(values)) > 1:
            found[axis] = _strata(axis, [one for one in placed if axis in one.world])
    return found


def _strata(axis: str, cases: Sequence[Outcome]) -> list[Stratum]:
    if axis in WORDS:
        words = sorted({str(one.world[axis]) for one in cases})
        return [_stratum(axis, cases, lambda value, w=word: value == w, 0.0, 0.0, word) for word in words]  # type: ignore[misc]
    values = np.array([float(one.world[axis]) for one in cases])
    edges = _edges(axis, values)
    last = len(edges) - 2
    strata = []
    for i, (low, high) in enumerate(pairwise(edges)):

        def inside(value: Any, a: float = low, b: float = high, end: bool = i == last) -> bool:
            return bool(a <= value <= b if end else a <= value < b)

        strata.append(_stratum(axis, cases, inside, float(low), float(high), ""))
    return [one for one in strata if one.cases]


def _edges(axis: str, values: np.ndarray) -> np.ndarray:
    if axis in DECADES:
        low, high = np.floor(np.log10(values.min())), np.ceil(np.log10(values.max() * (1.0 + 1e-9)))
        return np.asarray(10.0 ** np.arange(low, high + 1))
    return np.unique(np.quantile(values, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]))


def _stratum(
    axis: str, cases: Sequence[Outcome], inside: Callable[[Any], bool], low: float, high: float, value: str
) -> Stratum:
    own = [one for one in cases if inside(one.world[axis])]
    return Stratum(axis, low, high, value, len(own), world_scores(own))


def world_scores(cases: Sequence[Outcome]) -> dict[str, Score]:
    """The scores of a stratum."""
    visible = [one for one in cases if one.kind == "single" and one.rich and one.amplitude >= 1.0]
    sound = [one for one in cases if one.kind in ("healthy", "decoy")]
    said = [pair for one in cases if one.kind in JUDGED for pair in one.said]
    return {
        "strict": share([one.strict for one in visible]),
        "class_aware": share([one.class_aware for one in visible]),
        "joint": share([one.joint for one in visible]),
        "companion": share([one.has_companion for one in visible]),
        "false_alarm": share([one.has_false_name for one in sound]),
        "told_gap": share([one.told_gap for one in sound if not one.urdf_wrong]),
        "calibration_error": calibration_error([p for p, _ in said], [right for _, right in said]),
    }


def find_worst(worlds: Mapping[str, Sequence[Stratum]]) -> Stratum | None:
    """The stratum with the least share of visible effects named, of those with cases enough."""
    told = [one for strata in worlds.values() for one in strata if one.scores["strict"].count >= LEAST_CASES]
    return min(told, key=lambda one: one.scores["strict"].value or 0.0, default=None)
