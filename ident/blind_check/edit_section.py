"""Section of the page of a check: causes taken out of the patched model again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ident.blind_check.sections import BlindSection
from ident.blind_check.summary import EDIT_WITHIN
from ident.show.report.numbers import fixed, percent
from ident.show.report.words import effect_name


@dataclass(frozen=True, eq=False)
class EditSection(BlindSection):
    """Edit tests by effect."""

    anchor: ClassVar[str] = "edits"
    title: ClassVar[str] = "Take the cause out again: is the arm left?"
    template: ClassVar[str] = "blind_edits.html"

    @property
    def is_present(self) -> bool:
        return bool(self.report.edits)

    def context(self) -> dict[str, Any]:
        return {
            "within": f"{EDIT_WITHIN:g}",
            "rows": [
                {
                    "effect": effect_name(effect),
                    "cases": one["cases"],
                    "values": [fixed(one["median"][model]) for model in ("edited", "tuned", "unedited")],
                    "passed": percent(one["within"]["value"]),
                }
                for effect, one in self.report.edits.items()
            ],
        }
