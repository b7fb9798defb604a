"""All cases together: the scores of `ident.blind/1`.

A score is a row of a table: of which cases, of what in them.

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

from ident.benchmark.scoring import (
    Outcome,
    Score,
    auroc,
    calibration_curve,
    calibration_error,
    mean,
    share,
)
from ident.results import Result

# Properties of worlds by which scores are given: numbers, and words.
NUMBERS = (
    *(
        "encoder_noise_rad",
        "rate_hz",
        "run_spread",
        "friction_drift",
        "torque_noise",
        "jitter",
        "lost",
    ),
    *("bandwidth_hz", "friction_scale", "rotor_scale", "runs", "duration_s", "link_error"),
)
WORDS = ("world", "robot", "velocity", "encoder_at", "feed_forward", "reference")
# A number that spans decades is cut at these.
DECADES = ("encoder_noise_rad",)
# An edit test is passed where the error is at most this multiple of the oracle's.
EDIT_WITHIN = 1.1
# A stratum of worlds with fewer visible single effects is no stratum.
LEAST_CASES = 8


def world_axes(world: Mapping[str, Any]) -> dict[str, float | str]:
    """What cases are sorted by."""
    counts = 2.0 ** world["encoder_bits"] * (100.0 if world["encoder_at"] == "motor" else 1.0)
    noise = float(np.hypot(world["encoder_noise_rad"], 2.0 * np.pi / counts / np.sqrt(12.0)))
    own = {
        "encoder_noise_rad": noise,
        "world": world["name"],
        "run_spread": world["friction_spread"],
    }
    return {name: {**world, **own}[name] for name in (*NUMBERS, *WORDS)}


def places_on(axis: str, values: Sequence[Any]) -> list[dict[str, Any]]:
    """For each value of a property the stratum that it lies in.

    A word, or the bounds of a number.
    """
    if axis in WORDS:
        return [{"value": str(value)} for value in values]
    x = np.array(values, dtype=float)
    edges = np.unique(np.quantile(x, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]))
    if axis in DECADES:
        edges = 10.0 ** np.arange(
            np.floor(np.log10(x.min())), np.ceil(np.log10(x.max() * (1.0 + 1e-9))) + 1
        )
    at = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    return [{"low": float(edges[k]), "high": float(edges[k + 1])} for k in at]


T = TypeVar("T")
Choice = Callable[[Outcome], bool]
Rules = Mapping[str, tuple[Choice, Callable[[Sequence[Any]], Score], Callable[[Outcome], Any]]]


def of(*kinds: str) -> Choice:
    """Cases of some kinds."""
    return lambda one: one.kind in kinds


def is_visible(one: Outcome) -> bool:
    """Single effects of one noise floor or more, in rich motion: the cases of the headline."""
    return one.kind == "single" and one.rich and one.amplitude >= 1.0


SINGLE = of("single")
REFUSABLE = of("excluded", "outside")
SETS = of("pair", "triple")
WITHOUT = of("healthy", "decoy")
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
    "told_gap": (
        of("healthy"),
        share,
        lambda one: None if one.urdf_wrong else one.verdict != "no_gap",
    ),
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
    "edit": (
        lambda one: one.edit is not None,
        share,
        lambda one: (one.edit or {})["edited"] <= EDIT_WITHIN,
    )
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
    """The scores of a table of rules.

    A case of which a score says nothing (None) is left out of it.
    """
    some = list(cases)
    found = {}
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
    """The outcome of a check."""

    SHOWN_BY = "ident.benchmark.printing"

    robot: str  # name of the robot
    seed: int  # of the check
    seals: dict[str, str]  # SHA-256 of each case's envelope
    outcomes: tuple[Outcome, ...]  # all cases
    run: dict[str, Any] = field(default_factory=dict)  # how it was run: command options, versions

    @cached_property
    def scores(self) -> dict[str, Score]:
        """The headline. `auroc`: how sure the diagnosis is that the catalogue lacks the cause where
        it does, against where it does not.
        """
        lacking = [outcome.refusal_score for outcome in self.outcomes if REFUSABLE(outcome)]
        holding = [
            outcome.refusal_score
            for outcome in self.outcomes
            if SINGLE(outcome) and outcome.amplitude >= 1.0
        ]
        edited = any(SINGLE(outcome) and outcome.edit is not None for outcome in self.outcomes)
        return {
            **measure(self.outcomes, HEADLINE),
            "auroc": auroc(
                *([score for score in some if score is not None] for some in (lacking, holding))
            ),
            "calibration_error": calibration_error(*judged(self.outcomes)),
            "interval_coverage": share(
                cover["inside"] for one in self.outcomes for cover in one.coverage
            ),
            **(measure(filter(is_visible, self.outcomes), PASSED) if edited else {}),
        }

    @cached_property
    def worlds(self) -> dict[str, list[dict[str, Any]]]:
        """By each property in which the worlds of the cases differ, a row a stratum.

        Its word or bounds, its scores.
        """
        found: dict[str, list[dict[str, Any]]] = {}
        placed = [
            (world_axes(outcome.world), outcome) for outcome in self.outcomes if outcome.world
        ]
        for axis in (*NUMBERS, *WORDS):
            values = [place[axis] for place, _ in placed]
            if len(set(values)) < 2:
                continue
            strata = group_by(
                zip(places_on(axis, values), (one for _, one in placed), strict=True),
                lambda pair: (*pair[0].values(),),
            )
            found[axis] = []
            for rows in strata.values():
                cases = [one for _, one in rows]
                scores = {
                    **measure(cases, OF_WORLDS),
                    "calibration_error": calibration_error(*judged(cases)),
                }
                columns = in_columns(scores)
                found[axis].append(
                    {**rows[0][0], "cases": len(cases), **columns.pop("scores"), **columns}
                )
        return found

    @property
    def worst(self) -> dict[str, Any] | None:
        """The stratum of worlds in which fewest visible effects are named, of those with cases
        enough.
        """
        rows = [(axis, row) for axis, strata in self.worlds.items() for row in strata]
        enough = [pair for pair in rows if pair[1]["counts"]["strict"] >= LEAST_CASES]
        if not enough:
            return None
        axis, row = min(enough, key=lambda pair: pair[1]["strict"] or 0.0)
        span = row["value"] if "value" in row else f"{row['low']:.3g} to {row['high']:.3g}"
        about = {
            "strict": row["strict"],
            "cases": row["counts"]["strict"],
            "interval": row["intervals"]["strict"],
        }
        return {"world": f"{axis} {span}", **about}

    @cached_property
    def efficiency(self) -> dict[str, Score]:
        """By size: effects named, over those that an oracle would name; the oracle's share is taken
        as known.
        """
        found = {}
        asked = [
            outcome for outcome in self.outcomes if SINGLE(outcome) and outcome.oracle is not None
        ]
        for size, cases in group_by(asked, lambda one: one.amplitude).items():
            best = sum(case.oracle or 0.0 for case in cases) / len(cases)
            ours = share(case.strict for case in cases)
            ends = (ours.value, ours.low, ours.high)
            value, low, high = (
                end / best if end is not None and best > 0.0 else None for end in ends
            )
            found[f"{size:g}"] = Score(value, low, high, len(cases))
        return found

    @property
    def confidently_wrong(self) -> list[Outcome]:
        """Cases with a confident name that is not true."""
        return [outcome for outcome in self.outcomes if outcome.confidently_wrong]

    def _by_cause(self) -> dict[str, Any]:
        """Of single effects by size and motion, and by the true effect.

        Of names by the effect that they name.
        """
        singles = list(filter(SINGLE, self.outcomes))
        cells = group_by(singles, lambda one: (not one.rich, one.amplitude))
        by_truth = group_by(singles, lambda one: one.truth[0][0])
        names = group_by(
            (name for one in self.outcomes for name in one.judged), lambda name: name[0]
        )
        covers = group_by(
            (cover for one in self.outcomes for cover in one.coverage),
            lambda one: f"{one['effect']}.{one['parameter']}",
        )
        edits = {}
        for effect, cases in by_truth.items():
            own = [case for case in cases if case.edit is not None]
            if own:
                models = ("edited", "tuned", "unedited")
                medians = {
                    model: median(one.edit[model] for one in own if one.edit) for model in models
                }
                edits[effect] = {
                    "cases": len(own),
                    "median": medians,
                    "within": vars(measure(own, PASSED)["edit"]),
                }
        return {
            "strata": {
                f"{size:g}x {'poor' if poor else 'rich'}": _full(measure(own, NAMES))
                for (poor, size), own in cells.items()
            },
            "confusion": {
                effect: dict(Counter(one.named[0][0] if one.named else one.verdict for one in own))
                for effect, own in by_truth.items()
            },
            "coverage": _full(
                {name: share(cover["inside"] for cover in own) for name, own in covers.items()}
            ),
            "reliability": _full(
                {effect: share(right for _, _, right in own) for effect, own in names.items()}
            ),
            **({"edits": edits} if edits else {}),
        }

    def to_dict(self) -> dict[str, Any]:
        """`ident.blind/1`."""
        methods = sorted({method for one in self.outcomes for method in one.rivals})
        columns = in_columns(self.scores)
        columns["scores"]["efficiency"] = in_columns(self.efficiency)["scores"]
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
            "calibration": [
                {"low": low, "high": high, "said": said, "right": vars(right)}
                for low, high, said, right in calibration_curve(*judged(self.outcomes))
            ],
            "worlds": self.worlds,
            "worst_stratum": self.worst,
            "efficiency": _full(self.efficiency),
            "baselines": {
                m: in_columns(measure(self.outcomes, rules_of(m)))["scores"] for m in methods
            },
            "confidently_wrong": [one.name for one in self.confidently_wrong],
            "seconds_per_case": self.scores["seconds_per_case"].value,
            "outcomes": [outcome.to_dict() for outcome in self.outcomes],
            "run": self.run,
        }


def in_columns(scores: Mapping[str, Score]) -> dict[str, dict[str, Any]]:
    """Values, intervals and counts of scores, each by their names."""
    values = {name: score.value for name, score in scores.items()}
    intervals = {name: [score.low, score.high] for name, score in scores.items()}
    return {
        "scores": values,
        "intervals": intervals,
        "counts": {name: one.count for name, one in scores.items()},
    }


def _full(scores: Mapping[str, Score]) -> dict[str, dict[str, float | int | None]]:
    return {name: dict(vars(score)) for name, score in scores.items()}
