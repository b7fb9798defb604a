"""Sections of the page of a check."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.blind_check.scoring import Outcome
from ident.blind_check.statistics import Score
from ident.blind_check.summary import BlindReport
from ident.show.report.figures import make_panel, to_svg
from ident.show.report.numbers import DASH, fixed, percent, plural
from ident.show.report.page import Section
from ident.show.report.words import effect_name, parameter_name

SHARES = {
    "strict": "named: the first name is the hidden effect",
    "class_aware": "classed: the hidden effect is in the class of the first name",
    "joint": "the first name is at the right joint",
    "class_aware_small": "classed, at 0.3 of the noise floor",
    "false_alarm": "false alarms: healthy sessions with a name",
    "false_alarm_decoy": "false alarms: decoys with a name",
    "told_gap": "healthy sessions told to have a gap",
    "class_holds": "the class holds the hidden effect, single effects with a name",
    "companion": "visible effects with a false name beside the true one",
    "refusal": "refused, at the right joint, where the catalogue lacks the cause",
    "wrongly_named": "a wrong name called the whole story there",
    "interval_coverage": "true figures inside their 95 % interval",
    "shrink_vs_oracle": "held-out gap closed, of what an oracle closes",
}
MEANS = {
    "mean_class_size": "effects in a class",
    "class_size": "effects in a class, single effects with a name",
    "set_f1": "F1 of the set of names, pairs and triples",
    "calibration_error": "calibration error of the probabilities",
    "auroc": "area under the curve of refusals: lacking causes against held ones",
    "seconds_per_case": "seconds a diagnosis",
}
BASELINES = {"bic_forward": "forward selection by BIC", "lasso": "lasso", "correlation": "largest correlation"}
COMPARED = ("strict", "joint", "false_alarm", "false_alarm_decoy", "refusal")


def score_row(text: str, score: Score, as_share: bool) -> dict[str, str]:
    """A row of a table of scores."""
    tell = percent if as_share else fixed
    span = DASH if score.low is None else f"{tell(score.low)} to {tell(score.high)}"
    return {"text": text, "value": tell(score.value), "interval": span, "count": str(score.count)}


@dataclass(frozen=True, eq=False)
class BlindSection(Section):
    """A section of the page of a check."""

    report: BlindReport


@dataclass(frozen=True, eq=False)
class BlindVerdictSection(BlindSection):
    """The scores at a glance."""

    anchor: ClassVar[str] = "scores"
    title: ClassVar[str] = "Scores"
    template: ClassVar[str] = "blind_scores.html"

    def context(self) -> dict[str, Any]:
        scores = self.report.scores
        visible, healthy = scores["class_aware"], scores["false_alarm"]
        headline = (
            f"{percent(visible.value)} of {plural(visible.count, 'visible effect')} found; "
            f"{percent(healthy.value)} of {plural(healthy.count, 'healthy session')} with a false alarm."
        )
        failed = sum(one.verdict == "failed" for one in self.report.outcomes)
        return {
            "headline": headline,
            "failed": plural(failed, "case") if failed else "",
            "rows": [score_row(text, scores[name], True) for name, text in SHARES.items()]
            + [score_row(text, scores[name], False) for name, text in MEANS.items()],
        }


@dataclass(frozen=True, eq=False)
class StrataSection(BlindSection):
    """Single effects by size and motion."""

    anchor: ClassVar[str] = "sizes"
    title: ClassVar[str] = "Small and large, rich and poor motion"
    template: ClassVar[str] = "blind_strata.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.strata)

    def context(self) -> dict[str, Any]:
        return {
            "rows": [
                {"cell": cell, "count": scores["strict"].count, "values": _stratum(scores)}
                for cell, scores in self.report.strata.items()
            ]
        }


def _stratum(scores: Mapping[str, Score]) -> list[str]:
    shares = [percent(scores[name].value) for name in ("strict", "class_aware", "joint", "unnamed")]
    return [*shares, *(fixed(scores[name].value) for name in ("mean_class_size", "extra_names"))]


@dataclass(frozen=True, eq=False)
class BaselineSection(BlindSection):
    """Plain methods beside the diagnosis."""

    anchor: ClassVar[str] = "baselines"
    title: ClassVar[str] = "Beside plain methods"
    template: ClassVar[str] = "blind_baselines.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.baselines)

    def context(self) -> dict[str, Any]:
        methods = {"this diagnosis": self.report.scores}
        methods |= {BASELINES.get(name, name): scores for name, scores in self.report.baselines.items()}
        return {
            "rows": [
                {
                    "name": name,
                    "values": [*(percent(scores[key].value) for key in COMPARED), fixed(scores["set_f1"].value)],
                }
                for name, scores in methods.items()
            ]
        }


@dataclass(frozen=True, eq=False)
class CalibrationSection(BlindSection):
    """What probabilities said against what was true."""

    anchor: ClassVar[str] = "calibration"
    title: ClassVar[str] = "Is a probability of 0.9 right nine times in ten?"
    template: ClassVar[str] = "blind_calibration.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.calibration)

    def context(self) -> dict[str, Any]:
        return {
            "svg": draw_calibration(self.report),
            "findings": sum(one.right.count for one in self.report.calibration),
        }


def draw_calibration(report: BlindReport) -> Any:
    """Share of right names over their probability, with Wilson's intervals."""
    figure, axes = make_panel("probability told", "share right", size=(3.4, 2.8))
    axes.plot([0, 1], [0, 1], color="#999999", linewidth=0.8, linestyle="--")
    x = np.array([one.said for one in report.calibration])
    y = np.array([one.right.value for one in report.calibration], dtype=float)
    low = np.array([one.right.low for one in report.calibration], dtype=float)
    high = np.array([one.right.high for one in report.calibration], dtype=float)
    axes.errorbar(x, y, yerr=np.maximum([y - low, high - y], 0.0), fmt="o", color="#0b5394", markersize=4, linewidth=1)
    axes.set_xlim(-0.03, 1.03)
    axes.set_ylim(-0.03, 1.03)
    return to_svg(figure, "Calibration curve: share of right names over the probability told")


@dataclass(frozen=True, eq=False)
class CoverageSection(BlindSection):
    """How often each figure's interval holds the truth."""

    anchor: ClassVar[str] = "coverage"
    title: ClassVar[str] = "Are the intervals honest?"
    template: ClassVar[str] = "blind_coverage.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.coverage)

    def context(self) -> dict[str, Any]:
        rows = []
        for name, score in self.report.coverage.items():
            effect, parameter = name.split(".", 1)
            words, unit = parameter_name(parameter)
            told = f"{words} [{unit}]" if unit else words
            rows.append({**score_row(told, score, True), "effect": effect_name(effect)})
        return {"rows": rows}


@dataclass(frozen=True, eq=False)
class WrongSection(BlindSection):
    """Confident names that are not true, each with its own report."""

    folder: str
    anchor: ClassVar[str] = "wrong"
    title: ClassVar[str] = "Wrong, and sure of it"
    template: ClassVar[str] = "blind_wrong.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.confidently_wrong)

    def context(self) -> dict[str, Any]:
        return {"rows": [self._row(one) for one in self.report.confidently_wrong]}

    def _row(self, one: Outcome) -> dict[str, str]:
        told = [f"{effect_name(e)} at {', '.join(j)} ({percent(p)})" for e, j, p in one.named]
        true = [f"{effect_name(e)} at {j}" if j else effect_name(e) for e, j in one.truth]
        size = f"{one.amplitude:g}x, {'rich' if one.rich else 'poor'}" if one.truth else one.kind
        return {
            "name": one.name,
            "link": f"{self.folder}/{one.name}.html",
            "kind": f"{one.kind}, {size}",
            "true": "; ".join(true) or "nothing",
            "told": "; ".join(told),
        }


@dataclass(frozen=True, eq=False)
class SealSection(BlindSection):
    """SHA-256 of the envelopes."""

    anchor: ClassVar[str] = "seals"
    title: ClassVar[str] = "Seals"
    template: ClassVar[str] = "blind_seals.html"

    def context(self) -> dict[str, Any]:
        return {"seals": list(self.report.seals.items())}
