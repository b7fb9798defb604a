"""All cases together: the scores of `ident.blind/1`. A score is a row of a table: of which cases, of what in them.

Cases are also taken apart by what their worlds differ in: numbers cut at powers of ten or at terciles, words at
themselves.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import pairwise
from statistics import median
from typing import Any, TypeVar

import numpy as np

from ident.benchmark.scoring import Bin, Outcome, Score, auroc, calibration_curve, calibration_error, mean, share
from ident.results import Result

# Properties by which scores are told, and their names for a person. A number that spans decades is cut at these.
DECADES = ("encoder_noise_rad",)
NUMBERS = {
    "encoder_noise_rad": "encoder noise and rounding [rad]",
    "rate_hz": "log rate [Hz]",
    "run_spread": "friction from run to run",
    "friction_drift": "drift of friction",
    "torque_noise": "torque noise [of rated]",
    "jitter": "jitter [of the interval]",
    "lost": "samples lost",
    "bandwidth_hz": "controller's bandwidth [Hz]",
    "friction_scale": "friction, of the usual",
    "rotor_scale": "rotor inertia, of the usual",
    "runs": "runs",
    "duration_s": "duration [s]",
    "link_error": "error of the URDF's masses",
}
WORDS = {
    "world": "world",
    "robot": "arm",
    "velocity": "velocity channel",
    "encoder_at": "encoder on the",
    "feed_forward": "feed-forward",
    "reference": "reference",
}


@dataclass(frozen=True, eq=False)
class Stratum:
    """Cases whose worlds are alike in one property: between bounds of a number, or in a word (empty for a number)."""

    axis: str
    cases: Sequence[Outcome]
    low: float = 0.0
    high: float = 0.0
    value: str = ""

    @property
    def label(self) -> str:
        """For a person."""
        return f"{self.axis} {self.value}" if self.value else f"{self.axis} {self.low:.3g} to {self.high:.3g}"


def world_axes(world: Mapping[str, Any]) -> dict[str, float | str]:
    """What cases are sorted by."""
    counts = 2.0 ** world["encoder_bits"] * (100.0 if world["encoder_at"] == "motor" else 1.0)
    noise = float(np.hypot(world["encoder_noise_rad"], 2.0 * np.pi / counts / np.sqrt(12.0)))
    own = {"encoder_noise_rad": noise, "world": world["name"], "run_spread": world["friction_spread"]}
    return {name: {**world, **own}[name] for name in (*NUMBERS, *WORDS)}


def stratify(outcomes: Sequence[Outcome]) -> dict[str, list[Stratum]]:
    """Strata of every property in which the worlds differ."""
    placed = [(world_axes(one.world), one) for one in outcomes if one.world]
    differing = [axis for axis in (*NUMBERS, *WORDS) if len({place[axis] for place, _ in placed}) > 1]
    return {axis: _cut(axis, [(place[axis], one) for place, one in placed]) for axis in differing}


def _cut(axis: str, placed: Sequence[tuple[Any, Outcome]]) -> list[Stratum]:
    if axis in WORDS:
        words = sorted({str(value) for value, _ in placed})
        return [Stratum(axis, [one for value, one in placed if value == word], value=word) for word in words]
    values = np.array([float(value) for value, _ in placed])
    edges = np.unique(np.quantile(values, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]))
    if axis in DECADES:
        edges = 10.0 ** np.arange(np.floor(np.log10(values.min())), np.ceil(np.log10(values.max() * (1.0 + 1e-9))) + 1)
    at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    strata = [
        Stratum(axis, [one for (_, one), k in zip(placed, at, strict=True) if k == i], float(low), float(high))
        for i, (low, high) in enumerate(pairwise(edges))
    ]
    return [one for one in strata if one.cases]


T = TypeVar("T")
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


SINGLE, REFUSABLE, SETS, WITHOUT = of("single"), of("excluded", "outside"), of("pair", "triple"), of("healthy", "decoy")
# Scores of any single effects: whatever is chosen before.
NAMES: Rules = {
    "strict": (SINGLE, share, lambda one: one.strict),
    "class_aware": (SINGLE, share, lambda one: one.class_aware),
    "joint": (SINGLE, share, lambda one: one.joint),
    "mean_class_size": (SINGLE, mean, lambda one: one.class_size),
    "extra_names": (SINGLE, mean, lambda one: len(one.named) - 1 if one.named else None),
    "unnamed": (SINGLE, share, lambda one: not one.named),
}
HEADLINE: Rules = {
    **{name: (is_visible, summarise, value) for name, (_, summarise, value) in NAMES.items()},
    "class_aware_small": (
        lambda one: SINGLE(one) and one.rich and one.amplitude < 1.0,
        share,
        lambda one: one.class_aware,
    ),
    "class_holds": (SINGLE, share, lambda one: None if one.class_size is None else one.class_aware),
    "class_size": (SINGLE, mean, lambda one: one.class_size),
    "companion": (is_visible, share, lambda one: one.has_companion),
    "false_alarm": (of("healthy"), share, lambda one: one.has_false_name),
    "false_alarm_decoy": (of("decoy"), share, lambda one: one.has_false_name),
    "told_gap": (of("healthy"), share, lambda one: None if one.urdf_wrong else one.verdict != "no_gap"),
    "refusal": (REFUSABLE, share, lambda one: one.refused),
    "wrongly_named": (REFUSABLE, share, lambda one: one.verdict == "named"),
    "set_f1": (SETS, mean, lambda one: one.set_f1),
    "shrink_vs_oracle": (is_visible, mean, lambda one: one.shrink_share),
    "seconds_per_case": (lambda one: True, mean, lambda one: one.seconds),
}
# Scores of a stratum of worlds.
OF_WORLDS: Rules = {
    **{name: HEADLINE[name] for name in ("strict", "class_aware", "joint", "companion")},
    "false_alarm": (WITHOUT, *HEADLINE["false_alarm"][1:]),
    "told_gap": (WITHOUT, *HEADLINE["told_gap"][1:]),
}
PASSED: Rules = {
    "edit": (lambda one: one.edit is not None, share, lambda one: (one.edit or {})["edited"] <= EDIT_WITHIN)
}


def rules_of(method: str) -> Rules:
    """Scores of a plain method, which has neither probabilities nor verdicts."""

    def names(one: Outcome) -> Sequence[tuple[str, str]]:
        return one.rivals.get(method, ())

    def first(one: Outcome) -> tuple[str, str]:
        return next(iter(names(one)), ("", ""))

    def f1(one: Outcome) -> float:
        return 2.0 * len(set(names(one)) & set(one.truth)) / (len(names(one)) + len(one.truth))

    return {
        "strict": (is_visible, share, lambda one: first(one)[0] == one.truth[0][0]),
        "joint": (is_visible, share, lambda one: one.truth[0][1] in ("", first(one)[1])),
        "false_alarm": (of("healthy"), share, lambda one: bool(names(one))),
        "false_alarm_decoy": (of("decoy"), share, lambda one: bool(names(one))),
        "refusal": (REFUSABLE, share, lambda one: not names(one)),
        "set_f1": (SETS, mean, f1),
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


def judged(cases: Iterable[Outcome]) -> tuple[list[float], list[bool]]:
    """Probabilities of all names that are true or false, and which."""
    said = [name for one in cases for name in one.judged]
    return [p for _, p, _ in said], [right for _, _, right in said]


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
        """The headline. `auroc`: how sure the diagnosis is that the catalogue lacks the cause where it does, against
        where it does not.
        """
        lacking = [one.refusal_score for one in self.outcomes if REFUSABLE(one)]
        holding = [one.refusal_score for one in self.outcomes if SINGLE(one) and one.amplitude >= 1.0]
        return {
            **measure(self.outcomes, HEADLINE),
            "auroc": auroc(*([score for score in some if score is not None] for some in (lacking, holding))),
            "calibration_error": calibration_error(*judged(self.outcomes)),
            "interval_coverage": share(cover.inside for one in self.outcomes for cover in one.coverage),
            **(measure(filter(is_visible, self.outcomes), PASSED) if self.edits else {}),
        }

    @cached_property
    def strata(self) -> dict[str, dict[str, Score]]:
        """Names of single effects by size and motion, and how often none was given."""
        cells = group_by(filter(SINGLE, self.outcomes), lambda one: (not one.rich, one.amplitude))
        return {f"{size:g}x {'poor' if poor else 'rich'}": measure(own, NAMES) for (poor, size), own in cells.items()}

    @cached_property
    def worlds(self) -> dict[str, list[tuple[Stratum, dict[str, Score]]]]:
        """Scores by the properties in which the worlds of the cases differ."""

        def scores(cases: Sequence[Outcome]) -> dict[str, Score]:
            return {**measure(cases, OF_WORLDS), "calibration_error": calibration_error(*judged(cases))}

        return {axis: [(one, scores(one.cases)) for one in some] for axis, some in stratify(self.outcomes).items()}

    @cached_property
    def worst(self) -> tuple[Stratum, dict[str, Score]] | None:
        """The stratum of worlds in which fewest visible effects are named, of those with cases enough."""
        enough = [pair for strata in self.worlds.values() for pair in strata if pair[1]["strict"].count >= LEAST_CASES]
        return min(enough, key=lambda pair: pair[1]["strict"].value or 0.0, default=None)

    @cached_property
    def efficiency(self) -> dict[str, Score]:
        """By size: effects named, over those that an oracle would name; the oracle's share is taken as known."""
        found = {}
        asked = [one for one in self.outcomes if SINGLE(one) and one.oracle is not None]
        for size, cases in group_by(asked, lambda one: one.amplitude).items():
            best, ours = sum(one.oracle or 0.0 for one in cases) / len(cases), share(one.strict for one in cases)
            ends = (ours.value, ours.low, ours.high)
            value, low, high = (end / best if end is not None and best > 0.0 else None for end in ends)
            found[f"{size:g}"] = Score(value, low, high, len(cases))
        return found

    @cached_property
    def edits(self) -> dict[str, dict[str, Any]]:
        """Edit tests by effect, whatever the size and the motion: how many, median ratios, and the share passed."""
        asked = [one for one in self.outcomes if SINGLE(one) and one.edit is not None]
        found = {}
        for effect, own in group_by(asked, lambda one: one.truth[0][0]).items():
            models = ("edited", "tuned", "unedited")
            medians = {model: median(one.edit[model] for one in own if one.edit) for model in models}
            found[effect] = {"cases": len(own), "median": medians, "within": vars(measure(own, PASSED)["edit"])}
        return found

    @cached_property
    def reliability(self) -> dict[str, Score]:
        """Of each effect, how often its name is true where it is given."""
        names = group_by((name for one in self.outcomes for name in one.judged), lambda name: name[0])
        return {effect: share(right for _, _, right in own) for effect, own in names.items()}

    @cached_property
    def confusion(self) -> dict[str, dict[str, int]]:
        """For each true single effect, what was named first; a verdict where nothing was."""
        single = group_by(filter(SINGLE, self.outcomes), lambda one: one.truth[0][0])
        return {e: dict(Counter(o.named[0][0] if o.named else o.verdict for o in own)) for e, own in single.items()}

    @cached_property
    def calibration(self) -> tuple[Bin, ...]:
        """The curve behind the calibration error."""
        return calibration_curve(*judged(self.outcomes))

    @cached_property
    def coverage(self) -> dict[str, Score]:
        """Coverage of the intervals of each parameter, as effect.parameter."""
        covers = [cover for one in self.outcomes for cover in one.coverage]
        groups = group_by(covers, lambda cover: f"{cover.effect}.{cover.parameter}")
        return {name: share(cover.inside for cover in own) for name, own in groups.items()}

    @cached_property
    def baselines(self) -> dict[str, dict[str, Score]]:
        """Scores of the plain methods on the same evidence."""
        methods = sorted({method for one in self.outcomes for method in one.rivals})
        return {method: measure(self.outcomes, rules_of(method)) for method in methods}

    @property
    def confidently_wrong(self) -> list[Outcome]:
        """Cases with a confident name that is not true."""
        return [one for one in self.outcomes if one.confidently_wrong]

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`."""
        worst: dict[str, Any] | None = None
        if self.worst is not None:
            strict = self.worst[1]["strict"]
            worst = {"world": self.worst[0].label, "strict": strict.value, "cases": strict.count}
            worst["interval"] = [strict.low, strict.high]
        return {
            "schema": "ident.blind/1",
            "robot": self.robot,
            "cases": len(self.outcomes),
            "seed": self.seed,
            "failed": sum(one.verdict == "failed" for one in self.outcomes),
            "seals": self.seals,
            "provenance": self.provenance.to_dict(),
            **in_columns(self.scores),
            "scores": {**_values(self.scores), "efficiency": _values(self.efficiency)},
            "strata": {cell: _full(scores) for cell, scores in self.strata.items()},
            "confusion": self.confusion,
            "calibration": [{**vars(one), "right": vars(one.right)} for one in self.calibration],
            "coverage": _full(self.coverage),
            "worlds": {axis: [_stratum(*pair) for pair in strata] for axis, strata in self.worlds.items()},
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


def in_columns(scores: Mapping[str, Score]) -> dict[str, dict[str, Any]]:
    """Values, intervals and counts of scores, each by their names."""
    intervals = {name: [score.low, score.high] for name, score in scores.items()}
    counts = {name: score.count for name, score in scores.items()}
    return {"scores": _values(scores), "intervals": intervals, "counts": counts}


def _stratum(stratum: Stratum, scores: Mapping[str, Score]) -> dict[str, Any]:
    ends = {"value": stratum.value} if stratum.value else {"low": stratum.low, "high": stratum.high}
    columns = in_columns(scores)
    return {**ends, "cases": len(stratum.cases), **columns.pop("scores"), **columns}


def _values(scores: Mapping[str, Score]) -> dict[str, float | None]:
    return {name: score.value for name, score in scores.items()}


def _full(scores: Mapping[str, Score]) -> dict[str, dict[str, float | int | None]]:
    return {name: dict(vars(score)) for name, score in scores.items()}
