"""Torque fits: measured torque against every rung, for a typical run and for the worst one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.model.evaluation import Evaluation, RunTrace
from ident.show.palette import MEASURED, rung_colours, rung_name
from ident.show.report.figures import make_panel, thin, to_svg
from ident.show.report.numbers import fixed
from ident.show.report.page import Section
from ident.show.report.source import ReportInput

REST = "#e4e4df"


@dataclass(frozen=True, eq=False)
class FitSection(Section):
    """One panel a joint, for two runs."""

    source: ReportInput
    anchor: ClassVar[str] = "fits"
    title: ClassVar[str] = "Torque, measured and modelled"
    template: ClassVar[str] = "fits.html"

    def context(self) -> dict[str, Any]:
        evaluation = self.source.evaluation
        errors = run_errors(evaluation)
        order = np.argsort(errors)
        typical, worst = int(order[(len(order) - 1) // 2]), int(order[-1])
        chosen = [("A typical run", typical), ("The worst run", worst)]
        if typical == worst:
            chosen = [("The run", worst)]
        colours = rung_colours(evaluation.pooled.rungs)
        return {
            "legend": [
                ("measured", MEASURED),
                *((rung_name(rung), colour) for rung, colour in colours.items()),
                ("at rest: not judged", REST),
            ],
            "runs": [
                {
                    "title": title,
                    "name": run_name(evaluation, k),
                    "error": fixed(errors[k], 2),
                    "panels": draw_fits(evaluation.traces[k]),
                }
                for title, k in chosen
            ],
        }


def run_errors(evaluation: Evaluation) -> Float[Array, " K"]:
    """Torque RMSE of the last rung over all joints where they move, run by run [N m]."""
    squares = np.concatenate([score.squares[-1] for score in evaluation.sessions])
    there = np.isfinite(squares)
    return np.sqrt(np.where(there, squares, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1))


def run_name(evaluation: Evaluation, index: int) -> str:
    """Session and run of a trace."""
    names = [(score, run) for score in evaluation.sessions for run in score.runs]
    score, run = names[index]
    payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
    return (run if run == score.name else f"{score.name}/{run}") + payload


def rest_spans(time: Float[Array, " t"], moving: Bool[Array, " t"]) -> list[tuple[float, float]]:
    """Stretches in which a joint rests, where no model of its state can tell the torque."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], ~moving, [0]]).astype(int)))
    return [(float(time[a]), float(time[b - 1])) for a, b in edges.reshape(-1, 2) if b - a > 1]


def draw_fits(trace: RunTrace) -> list[dict[str, Any]]:
    """Measured torque and every rung over time, one panel a joint."""
    time = trace.time - trace.time[0]
    colours = rung_colours(tuple(trace.rungs))
    panels = []
    for j, joint in enumerate(trace.motion.joints):
        figure, axes = make_panel("time [s]", "torque [N m]")
        for start, end in rest_spans(time, trace.motion.moving[:, j]):
            axes.axvspan(start, end, color=REST, linewidth=0)
        axes.plot(*thin(time, trace.motion.tau_filtered[:, j]), color=MEASURED, linewidth=1.7)
        for rung, torque in trace.filtered.items():
            axes.plot(*thin(time, torque[:, j]), color=colours[rung], linewidth=0.95)
        axes.margins(x=0.01)
        panels.append({"title": joint, "svg": to_svg(figure, f"torque of {joint} over time, measured and modelled")})
    return panels
