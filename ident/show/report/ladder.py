"""The ladder in the shape of the paper's table 1: energy and torque error per joint and in total, rung by rung."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.errors import plural
from ident.model.evaluation import SessionScore
from ident.show.palette import rung_colours, rung_name
from ident.show.report.numbers import MINUS, fixed, glue, pair, percent, table_places
from ident.show.report.page import Section
from ident.show.report.source import ReportInput, pool_name


@dataclass(frozen=True, eq=False)
class LadderSection(Section):
    """The main model on all runs without payload, then each session and each other model, folded."""

    source: ReportInput
    anchor: ClassVar[str] = "ladder"
    title: ClassVar[str] = "The ladder, joint by joint"
    template: ClassVar[str] = "ladder.html"

    def context(self) -> dict[str, Any]:
        evaluation = self.source.evaluation
        sessions = [score for score in evaluation.sessions if len(evaluation.sessions) > 1]
        others = [one for k, one in enumerate(self.source.evaluations) if k != self.source.main]
        return {
            "main": ladder_tables(evaluation.pooled),
            "model": evaluation.model,
            "reductions": reductions(evaluation.pooled),
            "sessions": [ladder_tables(score) for score in sessions],
            "others": [{"model": one.model, **ladder_tables(one.pooled)} for one in others],
        }


def ladder_tables(score: SessionScore) -> dict[str, Any]:
    """Energy error, torque RMSE and R² as tables of text."""
    joints = list(score.joints)
    payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
    return {
        "name": pool_name(score),
        "runs": plural(len(score.runs), "run") + payload,
        "tables": [
            _table(score, "Energy error of a run [J]", joints, "total", score.energy_mean, score.energy_std),
            _table(score, "Torque error, RMS [N m]", joints, "all joints", score.rmse_mean, score.rmse_std),
            _r2_table(score),
        ],
    }


def _table(
    score: SessionScore,
    caption: str,
    joints: list[str],
    last: str,
    mean: Float[Array, "R n+1"],
    std: Float[Array, "R n+1"],
) -> dict[str, Any]:
    colours = rung_colours(score.rungs)
    spread: list[Any] = list(std) if len(score.runs) > 1 else [[None] * len(row) for row in mean]
    rows = [
        {
            "name": rung_name(rung),
            "colour": colours[rung],
            "cells": [pair(a, b, table_places(mean[k])) for a, b in zip(mean[k], spread[k], strict=True)],
        }
        for k, rung in enumerate(score.rungs)
    ]
    return {
        "caption": f"{caption}, mean ± standard deviation over the runs",
        "columns": [*joints, last],
        "total": True,
        "rows": rows,
    }


def _r2_table(score: SessionScore) -> dict[str, Any]:
    colours = rung_colours(score.rungs)
    rows = [
        {"name": rung_name(rung), "colour": colours[rung], "cells": [fixed(v, 3) for v in score.r2[k]]}
        for k, rung in enumerate(score.rungs)
    ]
    return {
        "caption": "Share of the torque's variance explained, R², where the joint moves",
        "columns": list(score.joints),
        "total": False,
        "rows": rows,
    }


def reductions(score: SessionScore) -> list[str]:
    """How much of the energy and torque error each rung takes away from the one below it."""
    energy, torque = np.abs(score.energy_mean[:, -1]), score.rmse_mean[:, -1]
    lines = []
    for k in range(1, len(score.rungs)):
        told = [_change(word, of[k - 1], of[k]) for word, of in (("energy error", energy), ("torque error", torque))]
        lines.append(glue(f"{rung_name(score.rungs[k])}: {', '.join(told)}"))
    return lines


def _change(word: str, before: float, after: float) -> str:
    if not before > 0:
        return f"{word} as before"
    share = 1.0 - after / before
    if abs(share) < 0.0005:
        return f"{word} unchanged"
    return f"{word} {MINUS if share >= 0 else '+'}{percent(abs(share))}"
