"""Sections of the page of a check on what is told as sure: ranks of true figures, and classes that hold the truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.blind_check.class_sets import ASKED
from ident.blind_check.ranks import BINS, RankHistogram
from ident.blind_check.sections import BlindSection
from ident.show.report.figures import make_panel, to_svg
from ident.show.report.numbers import fixed, percent, plural, significant
from ident.show.report.words import effect_name, parameter_name

BAR, BAND = "#0b5394", "#999999"


@dataclass(frozen=True, eq=False)
class RanksSection(BlindSection):
    """Histograms of where the truth lies in what was told, all figures and each of which there are enough."""

    anchor: ClassVar[str] = "ranks"
    title: ClassVar[str] = "Where in its interval is the truth?"
    template: ClassVar[str] = "blind_ranks.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.ranks.count)

    def context(self) -> dict[str, Any]:
        told = {"All figures": self.report.ranks}
        for name, one in self.report.ranks_by_figure.items():
            effect, parameter = name.split(".", 1)
            told[f"{effect_name(effect)}: {parameter_name(parameter)[0]}"] = one
        return {
            "panels": [
                {"title": name, "svg": draw_ranks(name, one), "words": _words(one)} for name, one in told.items()
            ]
        }


def _words(one: RankHistogram) -> str:
    p_value = "" if one.p_value is None else f", p = {significant(one.p_value)}"
    return f"{plural(one.count, 'figure')} of {plural(one.cases, 'case')}{p_value}: {one.words}"


def draw_ranks(name: str, ranks: RankHistogram) -> Any:
    """Figures in each bin, with the band in which a bin of honest intervals lies 95 % of the time."""
    figure, axes = make_panel("place of the truth", "figures", size=(3.5, 1.9))
    axes.axhspan(*ranks.band, color=BAND, alpha=0.3, linewidth=0)
    axes.axhline(ranks.count / BINS, color=BAND, linewidth=0.8, linestyle="--")
    axes.bar((np.arange(BINS) + 0.5) / BINS, ranks.bins, width=0.9 / BINS, color=BAR, alpha=0.85)
    axes.locator_params(axis="y", integer=True)
    axes.set_xlim(0.0, 1.0)
    axes.set_ylim(0.0, 1.1 * max(*ranks.bins, ranks.band[1], 1))
    return to_svg(figure, f"Histogram of the places of the truth. {name}: {', '.join(map(str, ranks.bins))}")


@dataclass(frozen=True, eq=False)
class ClassSetsSection(BlindSection):
    """How often classes hold the truth, at these and at other odds."""

    anchor: ClassVar[str] = "classes"
    title: ClassVar[str] = "Does the class hold the truth?"
    template: ClassVar[str] = "blind_classes.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.class_sets.cases)

    def context(self) -> dict[str, Any]:
        sets, scores = self.report.class_sets, self.report.scores
        return {
            "holds": percent(scores["class_holds"].value),
            "size": fixed(scores["class_size"].value),
            "effects": plural(sets.cases, "single effect"),
            "words": sets.words,
            "rows": [
                {
                    "odds": f"{one.odds:.4g}",
                    "note": f"for {ASKED}" if one.odds == sets.odds else "",
                    "values": [
                        percent(one.holds.value),
                        f"{percent(one.holds.low)} to {percent(one.holds.high)}",
                        fixed(one.size.value),
                    ],
                }
                for one in sets.cuts
            ],
        }
