"""What these recordings can't show, and the next motion to record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ident.show.limits import limit_rows
from ident.show.report.page import Section
from ident.show.report.source import DiagnosisInput
from ident.show.report.words import effect_name, join_words
from ident.show.untestable import silent_groups


@dataclass(frozen=True, eq=False)
class OutlookSection(Section):
    """The next experiment first; then the effects that could not be tested."""

    source: DiagnosisInput
    anchor: ClassVar[str] = "next"
    title: ClassVar[str] = "What to record next"
    template: ClassVar[str] = "outlook.html"

    @property
    def is_present(self) -> bool:
        record = self.source.record
        return any(record.get(key) for key in ("next_experiment", "not_testable", "detectable"))

    def context(self) -> dict[str, Any]:
        record = self.source.record
        following = record.get("next_experiment") or {}
        return {
            "motion": following.get("motion", ""),
            "minutes": f"{following['minutes']:g}" if "minutes" in following else "",
            "separates": join_words([effect_name(effect) for effect in following.get("separates", [])]),
            "tied": any(len(finding["class"]) > 1 for finding in record.get("findings", [])),
            "limits": limit_rows(record),
            "silent": silent_groups(record.get("not_testable", [])),
            "not_testable": [
                {
                    "effect": effect_name(one["effect"]),
                    "joints": ", ".join(one.get("joints", [])) or "all",
                    "reason": one["reason"],
                }
                for one in record.get("not_testable", [])
            ],
        }
