"""Payload rows in the shape of the paper's table 2: errors by payload and rung."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.model.evaluation import SessionScore
from ident.show.palette import rung_colours, rung_name
from ident.show.report.numbers import pair, table_places
from ident.show.report.page import Section
from ident.show.report.source import ReportInput, pool_name


@dataclass(frozen=True, eq=False)
class PayloadSection(Section):
    """Energy and torque error of the main model, one row a payload, one column a rung."""

    source: ReportInput
    anchor: ClassVar[str] = "payload"
    title: ClassVar[str] = "With payload"
    template: ClassVar[str] = "payload.html"

    @property
    def loaded(self) -> list[SessionScore]:
        """Sessions with a known payload, the lightest first."""
        loaded = [score for score in self.source.evaluation.sessions if score.payload_kg > 0]
        return sorted(loaded, key=lambda score: score.payload_kg)

    @property
    def is_present(self) -> bool:
        return bool(self.loaded)

    def context(self) -> dict[str, Any]:
        free = self.source.evaluation.pooled
        scores = [*([free] if free.payload_kg == 0 else []), *self.loaded]
        rungs, colours = scores[0].rungs, rung_colours(scores[0].rungs)
        return {
            "rungs": [(rung_name(rung), colours[rung]) for rung in rungs],
            "tables": [
                _table("Energy error of a run, all joints [J]", scores, "energy_mean", "energy_std"),
                _table("Torque error, RMS over all joints [N m]", scores, "rmse_mean", "rmse_std"),
            ],
        }


def _table(caption: str, scores: list[SessionScore], mean: str, std: str) -> dict[str, Any]:
    centre = np.array([getattr(score, mean)[:, -1] for score in scores])
    spread = np.array([getattr(score, std)[:, -1] for score in scores])
    rows = [
        {
            "name": f"{1000 * score.payload_kg:.0f} g" if score.payload_kg else "none",
            "session": pool_name(score),
            "runs": len(score.runs),
            "cells": [
                pair(a, b if len(score.runs) > 1 else None, table_places(centre[k]))
                for a, b in zip(centre[k], spread[k], strict=True)
            ],
        }
        for k, score in enumerate(scores)
    ]
    return {"caption": f"{caption}, mean ± standard deviation over the runs", "rows": rows}
