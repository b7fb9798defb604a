"""All cases together: the scores of `ident.blind/1`.

Cases are also taken apart by what their worlds differ in: numbers cut at powers of ten or at
terciles, words at themselves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median
from typing import Any, TypeVar

import numpy as np

from ident.benchmark.score_rules import (
    edit_rules,
    headline_rules,
    is_refusable,
    is_single,
    is_visible,
    measure,
    method_rules,
    name_rules,
    world_rules,
)
from ident.benchmark.scores import Score, auroc, calibration_curve, calibration_error, share
from ident.benchmark.scoring import Outcome
from ident.records import JsonRecord, JsonTable
from ident.results import Result

# Properties of worlds by which scores are given: numbers, and words.
NUMBERS = (
    "encoder_noise_rad",
    "rate_hz",
    "run_spread",
    "friction_drift",
    "torque_noise",
    "jitter",
    "lost",
    "bandwidth_hz",
    "friction_scale",
    "rotor_scale",
    "runs",
    "duration_s",
    "link_error",
)
WORDS = ("world", "robot", "velocity", "encoder_at", "feed_forward", "reference")
# A number that spans decades is cut at these.
DECADES = ("encoder_noise_rad",)
# Others are cut where each part has as many cases.
TERCILES = (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0)
# A stratum of worlds with fewer visible single effects is no stratum.
LEAST_CASES = 8
# The models of an edit test.
MODELS = ("edited", "tuned", "unedited")

Entry = TypeVar("Entry")
Row = JsonRecord


def world_axes(world: JsonTable) -> dict[str, float | str]:
    """What cases are sorted by.

    An encoder's noise and the width of its steps count together.
    """
    counts = 2.0 ** world["encoder_bits"] * (100.0 if world["encoder_at"] == "motor" else 1.0)
    rounding = 2.0 * np.pi / counts / np.sqrt(12.0)
    stated = {
        **world,
        "encoder_noise_rad": float(np.hypot(world["encoder_noise_rad"], rounding)),
        "world": world["name"],
        "run_spread": world["friction_spread"],
    }
    return {name: stated[name] for name in (*NUMBERS, *WORDS)}


def places_on(axis: str, values: Sequence[Any]) -> list[Row]:
    """For each value of a property the stratum that it lies in.

    A word, or the bounds of a number.
    """
    if axis in WORDS:
        return [{"value": str(value)} for value in values]
    numbers = np.array(values, dtype=float)
    if axis in DECADES:
        first = np.floor(np.log10(numbers.min()))
        last = np.ceil(np.log10(numbers.max() * (1.0 + 1e-9)))
        edges = 10.0 ** np.arange(first, last + 1)
    else:
        edges = np.unique(np.quantile(numbers, TERCILES))
    strata = np.searchsorted(edges, numbers, side="right") - 1
    strata = np.clip(strata, 0, len(edges) - 2)
    return [{"low": float(edges[k]), "high": float(edges[k + 1])} for k in strata]


def group_by(rows: Iterable[Entry], key: Callable[[Entry], Any]) -> dict[Any, list[Entry]]:
    """Rows that have a key in common, keys in order."""
    groups: dict[Any, list[Entry]] = {}
    for row in rows:
        groups.setdefault(key(row), []).append(row)
    return dict(sorted(groups.items()))


def judged(cases: Iterable[Outcome]) -> tuple[list[float], list[bool]]:
    """Probabilities of all names that are true or false, and which."""
    names = [name for case in cases for name in case.judged]
    probabilities = [probability for _, probability, _ in names]
    right = [is_right for _, _, is_right in names]
    return probabilities, right


@dataclass(frozen=True, eq=False)
class BlindReport(Result):
    """The outcome of a check."""

    SHOWN_BY = "ident.benchmark.printing"

    robot: str  # name of the robot
    seed: int  # of the check
    seals: dict[str, str]  # SHA-256 of each case's envelope
    outcomes: tuple[Outcome, ...]  # all cases
    run: JsonRecord = field(default_factory=dict)  # how it was run: command options, versions

    @cached_property
    def scores(self) -> dict[str, Score]:
        """The headline. `auroc`: how sure the diagnosis is that the catalogue lacks the cause where
        it does, against where it does not.
        """
        scores = measure(self.outcomes, headline_rules())
        scores["auroc"] = self._auroc()
        scores["calibration_error"] = calibration_error(*judged(self.outcomes))
        scores["interval_coverage"] = share(cover["inside"] for cover in self._coverage())
        if any(is_single(case) and case.edit is not None for case in self.outcomes):
            scores |= measure(filter(is_visible, self.outcomes), edit_rules())
        return scores

    def _auroc(self) -> Score:
        """Of cases whose cause the catalogue lacks against visible single effects."""
        lacking = []
        holding = []
        for case in self.outcomes:
            if case.refusal_score is None:
                continue
            if is_refusable(case):
                lacking.append(case.refusal_score)
            elif is_single(case) and case.amplitude >= 1.0:
                holding.append(case.refusal_score)
        return auroc(lacking, holding)

    def _coverage(self) -> list[Row]:
        """Every true parameter with its interval, of all cases."""
        return [cover for case in self.outcomes for cover in case.coverage]

    @cached_property
    def worlds(self) -> dict[str, list[Row]]:
        """By each property in which the worlds of the cases differ, a row a stratum.

        Its word or bounds, its scores.
        """
        drawn = [case for case in self.outcomes if case.world]
        places = [world_axes(case.world) for case in drawn]
        tables = {}
        for axis in (*NUMBERS, *WORDS):
            values = [place[axis] for place in places]
            if len(set(values)) > 1:
                pairs = zip(places_on(axis, values), drawn, strict=True)
                strata = group_by(pairs, lambda pair: (*pair[0].values(),))
                tables[axis] = [self._stratum(pairs) for pairs in strata.values()]
        return tables

    def _stratum(self, pairs: Sequence[tuple[Row, Outcome]]) -> Row:
        """The row of a stratum.

        Args:
            pairs: Its cases, each with the stratum's word or bounds.
        """
        cases = [case for _, case in pairs]
        scores = measure(cases, world_rules())
        scores["calibration_error"] = calibration_error(*judged(cases))
        columns = in_columns(scores)
        return {**pairs[0][0], "cases": len(cases), **columns.pop("scores"), **columns}

    @property
    def worst(self) -> Row | None:
        """The stratum of worlds in which fewest visible effects are named, of those with cases
        enough.
        """
        rows = [(axis, row) for axis, strata in self.worlds.items() for row in strata]
        enough = [pair for pair in rows if pair[1]["counts"]["strict"] >= LEAST_CASES]
        if not enough:
            return None
        axis, row = min(enough, key=lambda pair: pair[1]["strict"] or 0.0)
        span = row["value"] if "value" in row else f"{row['low']:.3g} to {row['high']:.3g}"
        return {
            "world": f"{axis} {span}",
            "strict": row["strict"],
            "cases": row["counts"]["strict"],
            "interval": row["intervals"]["strict"],
        }

    @cached_property
    def efficiency(self) -> dict[str, Score]:
        """By size: effects named, over those that an oracle would name; the oracle's share is taken
        as known.
        """
        asked = [case for case in self.outcomes if is_single(case) and case.oracle is not None]
        scores = {}
        for size, cases in group_by(asked, lambda case: case.amplitude).items():
            best = sum(case.oracle or 0.0 for case in cases) / len(cases)
            ours = share(case.strict for case in cases)
            value = _over(ours.value, best)
            low = _over(ours.low, best)
            high = _over(ours.high, best)
            scores[f"{size:g}"] = Score(value, low, high, len(cases))
        return scores

    @property
    def confidently_wrong(self) -> list[Outcome]:
        """Cases with a confident name that is not true."""
        return [outcome for outcome in self.outcomes if outcome.confidently_wrong]

    def _by_cause(self) -> JsonRecord:
        """Of single effects by size and motion, and by the true effect.

        Of names by the effect that they name.
        """
        singles = list(filter(is_single, self.outcomes))
        by_truth = group_by(singles, lambda case: case.truth[0][0])
        strata = {}
        cells = group_by(singles, lambda case: (not case.rich, case.amplitude))
        for (poor, size), cases in cells.items():
            name = f"{size:g}x {'poor' if poor else 'rich'}"
            strata[name] = _full(measure(cases, name_rules(is_single)))
        confusion = {}
        for effect, cases in by_truth.items():
            answers = [case.named[0][0] if case.named else case.verdict for case in cases]
            confusion[effect] = dict(Counter(answers))
        coverage = {}
        covers = group_by(self._coverage(), lambda row: f"{row['effect']}.{row['parameter']}")
        for parameter, rows in covers.items():
            coverage[parameter] = share(row["inside"] for row in rows)
        reliability = {}
        names = [name for case in self.outcomes for name in case.judged]
        for effect, of_effect in group_by(names, lambda name: name[0]).items():
            reliability[effect] = share(right for _, _, right in of_effect)
        tables: JsonRecord = {
            "strata": strata,
            "confusion": confusion,
            "coverage": _full(coverage),
            "reliability": _full(reliability),
        }
        edits = _edits(by_truth)
        if edits:
            tables["edits"] = edits
        return tables

    def to_dict(self) -> JsonRecord:
        """`ident.blind/1`."""
        methods = sorted({method for case in self.outcomes for method in case.rivals})
        columns = in_columns(self.scores)
        columns["scores"]["efficiency"] = in_columns(self.efficiency)["scores"]
        calibration = []
        for low, high, said, right in calibration_curve(*judged(self.outcomes)):
            calibration.append({"low": low, "high": high, "said": said, "right": vars(right)})
        baselines = {}
        for method in methods:
            scores = measure(self.outcomes, method_rules(method))
            baselines[method] = in_columns(scores)["scores"]
        return {
            "schema": "ident.blind/1",
            "robot": self.robot,
            "cases": len(self.outcomes),
            "seed": self.seed,
            "failed": sum(outcome.verdict == "failed" for outcome in self.outcomes),
            "seals": self.seals,
            "provenance": self.provenance.to_dict(),
            **columns,
            **self._by_cause(),
            "calibration": calibration,
            "worlds": self.worlds,
            "worst_stratum": self.worst,
            "efficiency": _full(self.efficiency),
            "baselines": baselines,
            "confidently_wrong": [case.name for case in self.confidently_wrong],
            "seconds_per_case": self.scores["seconds_per_case"].value,
            "outcomes": [outcome.to_dict() for outcome in self.outcomes],
            "run": self.run,
        }


def _edits(by_truth: Mapping[str, Sequence[Outcome]]) -> dict[str, Row]:
    """Of each true effect the median errors of the models of its edit tests.

    Args:
        by_truth: Cases of single effects, by the effect.
    """
    edits = {}
    for effect, cases in by_truth.items():
        tested = [case for case in cases if case.edit is not None]
        if not tested:
            continue
        medians = {}
        for model in MODELS:
            medians[model] = median(case.edit[model] for case in tested if case.edit)
        edits[effect] = {
            "cases": len(tested),
            "median": medians,
            "within": vars(measure(tested, edit_rules())["edit"]),
        }
    return edits


def _over(share_named: float | None, best: float) -> float | None:
    """A share over the oracle's; None where either is none."""
    if share_named is None or best <= 0.0:
        return None
    return share_named / best


def in_columns(scores: Mapping[str, Score]) -> dict[str, JsonRecord]:
    """Values, intervals and counts of scores, each by their names."""
    return {
        "scores": {name: score.value for name, score in scores.items()},
        "intervals": {name: [score.low, score.high] for name, score in scores.items()},
        "counts": {name: score.count for name, score in scores.items()},
    }


def _full(scores: Mapping[str, Score]) -> dict[str, dict[str, float | int | None]]:
    return {name: dict(vars(score)) for name, score in scores.items()}
