"""All cases together: the scores of `ident.blind/1`. A score is a row of a table: of which cases, of what in them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median
from typing import Any, TypeVar

from ident.benchmark.scoring import Outcome
from ident.benchmark.statistics import Bin, Score, auroc, calibration_curve, calibration_error, mean, share
from ident.benchmark.worlds import Stratum, stratify
from ident.results import Result

T = TypeVar("T")
SCHEMA = "ident.blind/1"
# An edit test is passed where the error is at most this multiple of the oracle's.
EDIT_WITHIN = 1.1
# A stratum of worlds with fewer visible single effects is no stratum.
LEAST_CASES = 8
Choice = Callable[[Outcome], bool]
Rules = Mapping[str, tuple[Choice, Callable[[Sequence[Any]], Score], Callable[[Outcome], Any]]]


def of(*kinds: str) -> Choice:
    """Cases of some kinds."""
    return lambda one: one.kind in kinds


def is_visible(one: Outcome) -> bool:
    """Single effects of one noise floor or more, in rich motion: the cases of the headline."""
    return one.kind == "single" and one.rich and one.amplitude >= 1.0


def is_small(one: Outcome) -> bool:
    return one.kind == "single" and one.rich and one.amplitude < 1.0


def is_named(one: Outcome) -> bool:
    return one.kind == "single" and one.class_size is not None


REFUSABLE, SETS = of("excluded", "outside"), of("pair", "triple")
# Scores of any single effects: whatever is chosen before.
NAMES: Rules = {
    "strict": (of("single"), share, lambda one: one.strict),
    "class_aware": (of("single"), share, lambda one: one.class_aware),
    "joint": (of("single"), share, lambda one: one.joint),
    "mean_class_size": (of("single"), mean, lambda one: one.class_size),
    "extra_names": (of("single"), mean, lambda one: len(one.named) - 1 if one.named else None),
    "unnamed": (of("single"), share, lambda one: not one.named),
}
HEADLINE: Rules = {
    **{name: (is_visible, summarise, value) for name, (_, summarise, value) in NAMES.items()},
    "class_aware_small": (is_small, share, lambda one: one.class_aware),
    "class_holds": (is_named, share, lambda one: one.class_aware),
    "class_size": (is_named, mean, lambda one: one.class_size),
    "companion": (is_visible, share, lambda one: one.has_companion),
    "false_alarm": (of("healthy"), share, lambda one: one.has_false_name),
    "false_alarm_decoy": (of("decoy"), share, lambda one: one.has_false_name),
    "told_gap": (of("healthy"), share, lambda one: None if one.urdf_wrong else one.told_gap),
    "refusal": (REFUSABLE, share, lambda one: one.refused),
    "wrongly_named": (REFUSABLE, share, lambda one: one.verdict == "named"),
    "set_f1": (SETS, mean, lambda one: one.set_f1),
    "shrink_vs_oracle": (is_visible, mean, lambda one: one.shrink_share),
    "seconds_per_case": (lambda one: True, mean, lambda one: one.seconds),
}
# Scores of a stratum of worlds.
OF_WORLDS: Rules = {
    **{name: HEADLINE[name] for name in ("strict", "class_aware", "joint", "companion")},
    "false_alarm": (of("healthy", "decoy"), share, lambda one: one.has_false_name),
    "told_gap": (of("healthy", "decoy"), share, lambda one: None if one.urdf_wrong else one.told_gap),
}
PASSED: Rules = {
    "edit": (lambda one: one.edit is not None, share, lambda one: (one.edit or {})["edited"] <= EDIT_WITHIN)
}


def measure(cases: Iterable[Outcome], rules: Rules) -> dict[str, Score]:
    """The scores of a table of rules; a case of which a score says nothing (None) is left out of it."""
    some, found = list(cases), {}
    for name, (chosen, summarise, value) in rules.items():
        values = [value(one) for one in some if chosen(one)]
        found[name] = summarise([one for one in values if one is not None])
    return found


def group_by(rows: Iterable[T], key: Callable[[T], Any]) -> dict[Any, list[T]]:
    """Rows that have a key in common, keys in order."""
    found: dict[Any, list[T]] = {}
    for row in rows:
        found.setdefault(key(row), []).append(row)
    return dict(sorted(found.items()))


@dataclass(frozen=True, eq=False)
class BlindReport(Result):
    """The outcome of a check.

    Attributes:
        robot: Name of the robot.
        seed: Of the check.
        seals: SHA-256 of each case's envelope.
        outcomes: All cases.
        run: How it was run: command options, versions.
    """

    SHOWN_BY = "ident.benchmark.pages"

    robot: str
    seed: int
    seals: dict[str, str]
    outcomes: tuple[Outcome, ...]
    run: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def scores(self) -> dict[str, Score]:
        """The headline."""
        edits = measure(filter(is_visible, self.outcomes), PASSED) if self.edits else {}
        return {
            **measure(self.outcomes, HEADLINE),
            "auroc": auroc(*self.refusal_scores),
            "calibration_error": calibration_error(*said_of(self.outcomes)),
            "interval_coverage": share([cover.inside for one in self.outcomes for cover in one.coverage]),
            **edits,
        }

    @cached_property
    def strata(self) -> dict[str, dict[str, Score]]:
        """Names of single effects by size and motion, and how often none was given."""
        cells = group_by(filter(of("single"), self.outcomes), lambda one: (not one.rich, one.amplitude))
        return {f"{size:g}x {'poor' if poor else 'rich'}": measure(own, NAMES) for (poor, size), own in cells.items()}

    @property
    def refusal_scores(self) -> tuple[list[float], list[float]]:
        """How sure the diagnosis is that the catalogue lacks the cause: where it does, and where it does not."""
        lacking = [one.refusal_score for one in self.outcomes if REFUSABLE(one)]
        holding = [one.refusal_score for one in self.outcomes if one.kind == "single" and one.amplitude >= 1.0]
        outside, inside = ([score for score in scores if score is not None] for scores in (lacking, holding))
        return outside, inside

    @cached_property
    def worlds(self) -> dict[str, list[tuple[Stratum, dict[str, Score]]]]:
        """Scores by the properties in which the worlds of the cases differ."""
        return {
            axis: [(one, measure_stratum(one)) for one in strata] for axis, strata in stratify(self.outcomes).items()
        }

    @cached_property
    def worst(self) -> tuple[Stratum, dict[str, Score]] | None:
        """The stratum of worlds in which fewest visible effects are named, of those with cases enough."""
        told = [pair for strata in self.worlds.values() for pair in strata if pair[1]["strict"].count >= LEAST_CASES]
        return min(told, key=lambda pair: pair[1]["strict"].value or 0.0, default=None)

    @cached_property
    def efficiency(self) -> dict[str, Score]:
        """By size: effects named, over those that an oracle would name; the oracle's share is taken as known."""
        found = {}
        asked = [one for one in self.outcomes if one.kind == "single" and one.oracle is not None]
        for size, cases in group_by(asked, lambda one: one.amplitude).items():
            best, ours = sum(one.oracle or 0.0 for one in cases) / len(cases), share([one.strict for one in cases])
            value, low, high = (
                None if end is None or best <= 0.0 else end / best for end in (ours.value, ours.low, ours.high)
            )
            found[f"{size:g}"] = Score(value, low, high, len(cases))
        return found

    @cached_property
    def edits(self) -> dict[str, dict[str, Any]]:
        """Edit tests by effect, whatever the size and the motion: how many, median ratios, and the share passed."""
        asked = [one for one in self.outcomes if one.kind == "single" and one.edit is not None]
        found = {}
        for effect, own in group_by(asked, lambda one: one.truth[0][0]).items():
            models = ("edited", "tuned", "unedited")
            medians = {model: median(one.edit[model] for one in own if one.edit) for model in models}
            found[effect] = {"cases": len(own), "median": medians, "within": vars(measure(own, PASSED)["edit"])}
        return found

    @cached_property
    def reliability(self) -> dict[str, Score]:
        """Of each effect, how often its name is true where it is given."""
        told = [
            (effect, right)
            for one in self.outcomes
            for (effect, _, _), right, false in zip(one.named, one.right, one.false_names, strict=True)
            if right or false
        ]
        return {effect: share([right for _, right in own]) for effect, own in group_by(told, lambda t: t[0]).items()}

    @cached_property
    def confusion(self) -> dict[str, dict[str, int]]:
        """For each true single effect, what was named first; a verdict where nothing was."""
        single = group_by(filter(of("single"), self.outcomes), lambda one: one.truth[0][0])
        return {e: dict(Counter(o.named[0][0] if o.named else o.verdict for o in own)) for e, own in single.items()}

    @cached_property
    def calibration(self) -> tuple[Bin, ...]:
        """The curve behind the calibration error."""
        return calibration_curve(*said_of(self.outcomes))

    @cached_property
    def coverage(self) -> dict[str, Score]:
        """Coverage of the intervals of each parameter, as effect.parameter."""
        covers = [cover for one in self.outcomes for cover in one.coverage]
        groups = group_by(covers, lambda cover: f"{cover.effect}.{cover.parameter}")
        return {name: share([cover.inside for cover in own]) for name, own in groups.items()}

    @cached_property
    def baselines(self) -> dict[str, dict[str, Score]]:
        """Scores of the plain methods on the same evidence."""
        return {
            method: measure(self.outcomes, rules_of(method))
            for method in sorted({method for one in self.outcomes for method in one.rivals})
        }

    @property
    def confidently_wrong(self) -> list[Outcome]:
        """Cases with a confident name that is not true."""
        return [one for one in self.outcomes if one.confidently_wrong]

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`."""
        worlds = {axis: [_stratum(*pair) for pair in strata] for axis, strata in self.worlds.items()}
        worst: dict[str, Any] | None = None
        if self.worst is not None:
            strict = self.worst[1]["strict"]
            worst = {"world": self.worst[0].label, "strict": strict.value, "cases": strict.count}
            worst["interval"] = [strict.low, strict.high]
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "cases": len(self.outcomes),
            "seed": self.seed,
            "failed": sum(one.verdict == "failed" for one in self.outcomes),
            "seals": self.seals,
            "provenance": self.provenance.to_dict(),
            "scores": {**_values(self.scores), "efficiency": _values(self.efficiency)},
            "intervals": {name: [score.low, score.high] for name, score in self.scores.items()},
            "counts": {name: score.count for name, score in self.scores.items()},
            "strata": {cell: _full(scores) for cell, scores in self.strata.items()},
            "confusion": self.confusion,
            "calibration": [{**vars(one), "right": vars(one.right)} for one in self.calibration],
            "coverage": _full(self.coverage),
            "worlds": worlds,
            "worst_stratum": worst,
            "efficiency": _full(self.efficiency),
            "reliability": _full(self.reliability),
            **({"edits": self.edits} if self.edits else {}),
            "baselines": {method: _values(scores) for method, scores in self.baselines.items()},
            "confidently_wrong": [one.name for one in self.confidently_wrong],
            "seconds_per_case": self.scores["seconds_per_case"].value,
            "outcomes": [one.to_dict() for one in self.outcomes],
            "run": self.run,
        }


def rules_of(method: str) -> Rules:
    """Scores of a plain method, which has neither probabilities nor verdicts."""

    def names(one: Outcome) -> Sequence[tuple[str, str]]:
        return one.rivals.get(method, ())

    def first(one: Outcome) -> tuple[str, str]:
        return next(iter(names(one)), ("", ""))

    def f1(one: Outcome) -> float:
        hits = len(set(names(one)) & set(one.truth))
        return 2.0 * hits / (len(names(one)) + len(one.truth))

    return {
        "strict": (is_visible, share, lambda one: first(one)[0] == one.truth[0][0]),
        "joint": (is_visible, share, lambda one: one.truth[0][1] in ("", first(one)[1])),
        "false_alarm": (of("healthy"), share, lambda one: bool(names(one))),
        "false_alarm_decoy": (of("decoy"), share, lambda one: bool(names(one))),
        "refusal": (REFUSABLE, share, lambda one: not names(one)),
        "set_f1": (SETS, mean, f1),
    }


def measure_stratum(stratum: Stratum) -> dict[str, Score]:
    """The scores of a stratum of worlds, and whether its probabilities are meant."""
    meant = calibration_error(*said_of(stratum.cases))
    return {**measure(stratum.cases, OF_WORLDS), "calibration_error": meant}


def said_of(cases: Iterable[Outcome]) -> tuple[list[float], list[bool]]:
    """Probabilities of all names that are true or false, and which."""
    said = [pair for one in cases for pair in one.said]
    return [p for p, _ in said], [right for _, right in said]


def _stratum(stratum: Stratum, scores: Mapping[str, Score]) -> dict[str, Any]:
    ends = {"value": stratum.value} if stratum.value else {"low": stratum.low, "high": stratum.high}
    counts = {name: score.count for name, score in scores.items()}
    intervals = {name: [score.low, score.high] for name, score in scores.items()}
    return {**ends, "cases": len(stratum.cases), **_values(scores), "counts": counts, "intervals": intervals}


def _values(scores: Mapping[str, Score]) -> dict[str, float | None]:
    return {name: score.value for name, score in scores.items()}


def _full(scores: Mapping[str, Score]) -> dict[str, dict[str, float | int | None]]:
    return {name: dict(vars(score)) for name, score in scores.items()}
