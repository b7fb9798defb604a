"""All cases together: the scores of `ident.blind/1`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from statistics import median
from typing import Any, TypeVar

from ident.blind_check.by_world import Stratum, find_worst, stratify
from ident.blind_check.class_sets import ClassSets, measure_class_sets
from ident.blind_check.ranks import LEAST_FIGURES, RankHistogram, count_ranks
from ident.blind_check.scoring import JUDGED, Outcome
from ident.blind_check.statistics import (
    Bin,
    Score,
    auroc,
    calibration_curve,
    calibration_error,
    mean,
    share,
)
from ident.results import Result

T = TypeVar("T")

SCHEMA = "ident.blind/1"
SETS = ("pair", "triple")
REFUSABLE = ("excluded", "outside")
SINGLES = ("single", "semi_real")
# An edit test is passed where the error is at most this multiple of the oracle's.
EDIT_WITHIN = 1.1


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

    SHOWN_BY = "ident.blind_check.in_words"

    robot: str
    seed: int
    seals: dict[str, str]
    outcomes: tuple[Outcome, ...]
    run: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def scores(self) -> dict[str, Score]:
        """The headline: single effects count where they are visible (1 noise floor or more) in rich motion."""
        visible = self.of(*SINGLES, where=lambda one: one.rich and one.amplitude >= 1.0)
        small = self.of(*SINGLES, where=lambda one: one.rich and one.amplitude < 1.0)
        refusable, sets = self.of(*REFUSABLE), self.of(*SETS)
        said = [pair for one in self.of(*JUDGED) for pair in one.said]
        covered = [cover.inside for one in self.outcomes for cover in one.coverage]
        named = self.of("single", where=lambda one: one.class_size is not None)
        seconds = [one.seconds for one in self.outcomes if one.seconds is not None]
        return {
            **name_scores(visible),
            "class_aware_small": share([one.class_aware for one in small]),
            "class_holds": share([one.class_aware for one in named]),
            "class_size": mean([float(one.class_size) for one in named if one.class_size is not None]),
            "companion": share([one.has_companion for one in visible]),
            "false_alarm": share([one.has_false_name for one in self.of("healthy")]),
            "false_alarm_decoy": share([one.has_false_name for one in self.of("decoy")]),
            "told_gap": share([one.told_gap for one in self.of("healthy") if not one.urdf_wrong]),
            "auroc": auroc(*self.refusal_scores),
            "refusal": share([one.refused for one in refusable]),
            "wrongly_named": share([one.verdict == "named" for one in refusable]),
            "set_f1": mean([one.set_f1 for one in sets if one.set_f1 is not None]),
            "shrink_vs_oracle": mean([one.shrink_share for one in visible if one.shrink_share is not None]),
            "calibration_error": calibration_error(*_unzip(said)),
            "interval_coverage": share(covered),
            "seconds_per_case": mean(seconds),
            **({"edit": _edit_share([one for one in visible if one.edit])} if self.edits else {}),
        }

    def of(self, *kinds: str, where: Callable[[Outcome], bool] = lambda one: True) -> list[Outcome]:
        """Cases of some kinds that fulfil a condition."""
        return [one for one in self.outcomes if one.kind in kinds and where(one)]

    @cached_property
    def strata(self) -> dict[str, dict[str, Score]]:
        """Names of single effects by size and motion, and how often none was given."""
        cells = sorted({(one.amplitude, one.rich) for one in self.of(*SINGLES)}, key=lambda cell: (-cell[1], cell[0]))
        return {
            f"{amplitude:g}x {'rich' if rich else 'poor'}": name_scores(
                self.of(*SINGLES, where=lambda one, a=amplitude, r=rich: (one.amplitude, one.rich) == (a, r))  # type: ignore[misc]
            )
            for amplitude, rich in cells
        }

    @property
    def refusal_scores(self) -> tuple[list[float], list[float]]:
        """How sure the diagnosis is that the catalogue lacks the cause: where it does, and where it does not."""
        lacking = [one.refusal_score for one in self.of(*REFUSABLE)]
        holding = [one.refusal_score for one in self.of(*SINGLES, where=lambda one: one.amplitude >= 1.0)]
        outside, inside = ([score for score in scores if score is not None] for scores in (lacking, holding))
        return outside, inside

    @cached_property
    def worlds(self) -> dict[str, list[Stratum]]:
        """Scores by the properties in which the worlds of the cases differ."""
        return stratify(self.outcomes)

    @cached_property
    def worst(self) -> Stratum | None:
        """The stratum of worlds in which fewest effects are named."""
        return find_worst(self.worlds)

    @cached_property
    def efficiency(self) -> dict[str, Score]:
        """By size: effects named, over those that an oracle would name; the oracle's share is taken as known."""
        asked = self.of("single", where=lambda one: one.oracle is not None)
        found = {}
        for size in sorted({one.amplitude for one in asked}):
            cases = [one for one in asked if one.amplitude == size]
            best = sum(one.oracle or 0.0 for one in cases) / len(cases)
            ours = share([one.strict for one in cases])
            value, low, high = (
                None if end is None or best <= 0.0 else end / best for end in (ours.value, ours.low, ours.high)
            )
            found[f"{size:g}"] = Score(value, low, high, len(cases))
        return found

    @cached_property
    def edits(self) -> dict[str, dict[str, Any]]:
        """Edit tests by effect, whatever the size and the motion: how many, median ratios, and the share passed."""
        asked = self.of("single", where=lambda one: one.edit is not None)
        found = {}
        for effect in sorted({one.truth[0][0] for one in asked}):
            own = [one for one in asked if one.truth[0][0] == effect]
            medians = {
                model: median(one.edit[model] for one in own if one.edit) for model in ("edited", "tuned", "unedited")
            }
            found[effect] = {"cases": len(own), "median": medians, "within": vars(_edit_share(own))}
        return found

    @cached_property
    def reliability(self) -> dict[str, Score]:
        """Of each effect, how often its name is true where it is given."""
        found: dict[str, list[bool]] = {}
        for one in self.of(*JUDGED):
            for (effect, _, _), right, false in zip(one.named, one.right, one.false_names, strict=True):
                if right or false:
                    found.setdefault(effect, []).append(right)
        return {effect: share(found[effect]) for effect in sorted(found)}

    @cached_property
    def confusion(self) -> dict[str, dict[str, int]]:
        """For each true single effect, what was named first; a verdict where nothing was."""
        table: dict[str, dict[str, int]] = {}
        for one in self.of(*SINGLES):
            row = table.setdefault(one.truth[0][0], {})
            told = one.named[0][0] if one.named else one.verdict
            row[told] = row.get(told, 0) + 1
        return {effect: table[effect] for effect in sorted(table)}

    @cached_property
    def calibration(self) -> tuple[Bin, ...]:
        """The curve behind the calibration error."""
        return calibration_curve(*_unzip([pair for one in self.of(*JUDGED) for pair in one.said]))

    @cached_property
    def coverage(self) -> dict[str, Score]:
        """Coverage of the intervals of each figure, as effect.parameter."""
        found: dict[str, list[bool]] = {}
        for one in self.outcomes:
            for cover in one.coverage:
                found.setdefault(f"{cover.effect}.{cover.parameter}", []).append(cover.inside)
        return {name: share(found[name]) for name in sorted(found)}

    @cached_property
    def ranks(self) -> RankHistogram:
        """Places of all true figures in what was told of them."""
        return count_ranks(*_unzip([pair for pairs in self._places.values() for pair in pairs]))

    @cached_property
    def ranks_by_figure(self) -> dict[str, RankHistogram]:
        """The same of each figure of which there are enough, as effect.parameter."""
        enough = {name: pairs for name, pairs in sorted(self._places.items()) if len(pairs) >= LEAST_FIGURES}
        return {name: count_ranks(*_unzip(pairs)) for name, pairs in enough.items()}

    @cached_property
    def _places(self) -> dict[str, list[tuple[float, str]]]:
        found: dict[str, list[tuple[float, str]]] = {}
        for one in self.outcomes:
            for cover in one.coverage:
                if (place := cover.place) is not None:
                    found.setdefault(f"{cover.effect}.{cover.parameter}", []).append((place, one.name))
        return found

    @cached_property
    def class_sets(self) -> ClassSets:
        """The odds that classes need to hold the truth 19 times in 20."""
        return measure_class_sets(self.outcomes)

    @cached_property
    def baselines(self) -> dict[str, dict[str, Score]]:
        """Scores of the plain methods on the same evidence."""
        methods = sorted({method for one in self.outcomes for method in one.rivals})
        return {method: self._baseline(method) for method in methods}

    def _baseline(self, method: str) -> dict[str, Score]:
        visible = self.of(*SINGLES, where=lambda one: one.rich and one.amplitude >= 1.0)
        names = {one.name: one.rivals.get(method, ()) for one in self.outcomes}
        first = [(one.truth[0], _first(one, names[one.name])) for one in visible]
        return {
            "strict": share([told[0] == true[0] for true, told in first]),
            "joint": share([not true[1] or told[1] == true[1] for true, told in first]),
            "false_alarm": share([bool(names[one.name]) for one in self.of("healthy")]),
            "false_alarm_decoy": share([bool(names[one.name]) for one in self.of("decoy")]),
            "refusal": share([not names[one.name] for one in self.of(*REFUSABLE)]),
            "set_f1": mean([_f1_of(names[one.name], one.truth) for one in self.of(*SETS)]),
        }

    @property
    def confidently_wrong(self) -> list[Outcome]:
        """Cases with a confident name that is not true."""
        return [one for one in self.outcomes if one.confidently_wrong]

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`."""
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "cases": len(self.outcomes),
            "seed": self.seed,
            "failed": sum(one.verdict == "failed" for one in self.outcomes),
            "seals": self.seals,
            "provenance": self.provenance.to_dict(),
            "scores": {**_values(self.scores), "efficiency": _values(self.efficiency)},
            "intervals": _intervals(self.scores),
            "counts": {name: score.count for name, score in self.scores.items()},
            "strata": {cell: _full(scores) for cell, scores in self.strata.items()},
            "confusion": self.confusion,
            "calibration": [{**vars(one), "right": vars(one.right)} for one in self.calibration],
            "coverage": _full(self.coverage),
            "ranks": {
                "all": self.ranks.to_dict(),
                "figures": {name: one.to_dict() for name, one in self.ranks_by_figure.items()},
            },
            "class_sets": self.class_sets.to_dict(),
            "worlds": {axis: [one.to_dict() for one in strata] for axis, strata in self.worlds.items()},
            "worst_stratum": _worst(self.worst),
            "efficiency": _full(self.efficiency),
            "reliability": _full(self.reliability),
            **({"edits": self.edits} if self.edits else {}),
            "baselines": {method: _values(scores) for method, scores in self.baselines.items()},
            "confidently_wrong": [one.name for one in self.confidently_wrong],
            "seconds_per_case": self.scores["seconds_per_case"].value,
            "outcomes": [one.to_dict() for one in self.outcomes],
            "run": self.run,
        }


def name_scores(cases: Sequence[Outcome]) -> dict[str, Score]:
    """How well single effects are named."""
    return {
        "strict": share([one.strict for one in cases]),
        "class_aware": share([one.class_aware for one in cases]),
        "joint": share([one.joint for one in cases]),
        "mean_class_size": mean([float(one.class_size) for one in cases if one.class_size is not None]),
        "extra_names": mean([float(len(one.named) - 1) for one in cases if one.named]),
        "unnamed": share([not one.named for one in cases]),
    }


def _edit_share(cases: Sequence[Outcome]) -> Score:
    """Share of edit tests that are passed."""
    return share([one.edit["edited"] <= EDIT_WITHIN for one in cases if one.edit])


def _unzip(pairs: Sequence[tuple[float, T]]) -> tuple[list[float], list[T]]:
    return [p for p, _ in pairs], [other for _, other in pairs]


def _first(one: Outcome, named: Sequence[tuple[str, str]]) -> tuple[str, str]:
    """The first name; of a real arm the true one if it is there, as for the diagnosis."""
    if one.kind == "semi_real" and one.truth[0] in named:
        return one.truth[0]
    return next(iter(named), ("", ""))


def _f1_of(named: Sequence[tuple[str, str]], truth: Sequence[tuple[str, str]]) -> float:
    hits = len(set(named) & set(truth))
    return 2.0 * hits / (len(named) + len(truth))


def _worst(stratum: Stratum | None) -> dict[str, Any] | None:
    if stratum is None:
        return None
    strict = stratum.scores["strict"]
    return {
        "world": stratum.label,
        "strict": strict.value,
        "interval": [strict.low, strict.high],
        "cases": strict.count,
    }


def _values(scores: dict[str, Score]) -> dict[str, float | None]:
    return {name: score.value for name, score in scores.items()}


def _intervals(scores: dict[str, Score]) -> dict[str, list[float | None]]:
    return {name: [score.low, score.high] for name, score in scores.items()}


def _full(scores: dict[str, Score]) -> dict[str, dict[str, float | int | None]]:
    return {name: dict(vars(score)) for name, score in scores.items()}
