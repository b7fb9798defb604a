"""The confusion picture: how often one effect was taken for another in the check on withheld effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ident.show.report.numbers import fixed
from ident.show.report.page import Section
from ident.show.report.where import shade
from ident.show.report.words import effect_name


@dataclass(frozen=True, eq=False)
class ConfusionSection(Section):
    """Rows: the true effect; columns: the one named. The diagonal is right."""

    counts: Mapping[str, Mapping[str, float]]
    anchor: ClassVar[str] = "confusion"
    title: ClassVar[str] = "How often such a name is right"
    template: ClassVar[str] = "confusion.html"

    @property
    def is_present(self) -> bool:
        return bool(self.counts)

    def context(self) -> dict[str, Any]:
        true = list(self.counts)
        named = [*true, *sorted({name for row in self.counts.values() for name in row} - set(true))]
        named = [name for name in named if any(row.get(name) for row in self.counts.values())]
        total = sum(sum(row.values()) for row in self.counts.values())
        right = sum(row.get(effect, 0) for effect, row in self.counts.items())
        return {
            "named": [effect_name(name) for name in named],
            "rows": [self._row(effect, named) for effect in true],
            "summary": f"{fixed(right, 0)} of {fixed(total, 0)} cases were named rightly.",
        }

    def _row(self, effect: str, named: list[str]) -> dict[str, Any]:
        row = self.counts[effect]
        total = sum(row.values())
        cells = [
            {
                "count": f"{row[name]:g}" if row.get(name) else "",
                "colour": shade(row.get(name, 0) / total if total else 0.0),
                "right": name == effect,
            }
            for name in named
        ]
        return {"effect": effect_name(effect), "cells": cells}
