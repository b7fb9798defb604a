"""What is left: the torque error of every rung against speed, position and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.model.evaluation import RunTrace
from ident.show.palette import rung_colours, rung_name
from ident.show.report.figures import binned, envelope, make_panel, to_svg
from ident.show.report.page import Section
from ident.show.report.source import ReportInput

BINS = 14


@dataclass(frozen=True, eq=False)
class ResidualSection(Section):
    """Medians of measured less modelled torque: what a rung leaves has a shape, and the shape names its cause."""

    source: ReportInput
    anchor: ClassVar[str] = "residuals"
    title: ClassVar[str] = "What is left, and where"
    template: ClassVar[str] = "residuals.html"

    def context(self) -> dict[str, Any]:
        traces = self.source.evaluation.traces
        sliding = dict(zip(self.source.model.robot.joint_names, self.source.model.robot.sliding_joints, strict=True))
        units = ["m" if sliding.get(joint, False) else "rad" for joint in traces[0].motion.joints]
        rungs = tuple(traces[0].rungs)
        colours = rung_colours(rungs)
        return {
            "legend": [(rung_name(rung), colours[rung]) for rung in rungs],
            "last": rung_name(rungs[-1]),
            "close": ", ".join(rung_name(rung) for rung in close_up(rungs)),
            "speed": draw_against_speed(traces, units, rungs),
            "speed_close": draw_against_speed(traces, units, close_up(rungs)) if close_up(rungs) != rungs else [],
            "position": draw_against_position(traces, units, close_up(rungs)),
            "time": draw_over_time(traces, rungs[-1]),
        }


def close_up(rungs: tuple[str, ...]) -> tuple[str, ...]:
    """The rungs that hold friction: beside the others nothing of theirs could be seen."""
    return rungs[rungs.index("loss") :] if "loss" in rungs else rungs


def draw_against_speed(
    traces: Sequence[RunTrace], units: Sequence[str], rungs: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Residual against joint speed: the shape of friction. Bins of like counts, none across zero."""
    speed = np.concatenate([trace.motion.dq[trace.motion.coarse] for trace in traces])
    moving = np.concatenate([trace.motion.moving for trace in traces])
    panels = []
    for j, joint in enumerate(traces[0].motion.joints):
        x = np.where(moving[:, j], speed[:, j], np.nan)
        edges = [_edges(x[x < 0]), _edges(x[x > 0])]
        panels.append(_draw(traces, rungs, j, x, edges, f"speed [{units[j]}/s]", f"{joint}: residual against speed"))
    return panels


def draw_against_position(
    traces: Sequence[RunTrace], units: Sequence[str], rungs: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Residual against joint position: gravity, springs, wrong masses."""
    position = np.concatenate([trace.motion.q[trace.motion.coarse] for trace in traces])
    moving = np.concatenate([trace.motion.moving for trace in traces])
    panels = []
    for j, joint in enumerate(traces[0].motion.joints):
        x = np.where(moving[:, j], position[:, j], np.nan)
        edges = [_edges(x[np.isfinite(x)], 2 * BINS)]
        panels.append(
            _draw(traces, rungs, j, x, edges, f"position [{units[j]}]", f"{joint}: residual against position")
        )
    return panels


def draw_over_time(traces: Sequence[RunTrace], rung: str) -> list[dict[str, Any]]:
    """Residual of one rung where the joint moves, over all runs: its span, and each run's median."""
    residuals = [_residual(trace, rung) for trace in traces]
    lengths = [trace.time[-1] - trace.time[0] for trace in traces]
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    time = np.concatenate([trace.time - trace.time[0] + start for trace, start in zip(traces, starts, strict=False)])
    stacked = np.concatenate(residuals)
    moving = np.concatenate([trace.motion.moving for trace in traces])
    colour = rung_colours(tuple(traces[0].rungs))[rung]
    panels = []
    for j, joint in enumerate(traces[0].motion.joints):
        figure, axes = make_panel("time, runs end to end [s]", "residual [N m]")
        for start in starts[1:-1] if len(starts) < 60 else []:
            axes.axvline(start, color="#e3e3e3", linewidth=0.5)
        span = envelope(time, np.where(moving[:, j], stacked[:, j], np.nan))
        axes.fill_between(*span, color=colour, alpha=0.45, linewidth=0.3)
        axes.hlines(_medians(traces, residuals, j), starts[:-1], starts[1:], color="#111111", linewidth=1.4)
        axes.axhline(0.0, color="#333333", linewidth=0.5)
        axes.margins(x=0.01)
        panels.append({"title": joint, "svg": to_svg(figure, f"{joint}: residual over time")})
    return panels


def _draw(
    traces: Sequence[RunTrace],
    rungs: tuple[str, ...],
    j: int,
    x: Float[Array, " t"],
    groups: Sequence[Array],
    label: str,
    description: str,
) -> dict[str, Any]:
    """Median of every rung's residual in bins, and for the last rung the band of 80 % of the samples."""
    colours = rung_colours(tuple(traces[0].rungs))
    figure, axes = make_panel(label, "residual [N m]")
    axes.axhline(0.0, color="#333333", linewidth=0.5)
    for rung in rungs:
        y = np.concatenate([_residual(trace, rung)[:, j] for trace in traces])
        for edges in groups:
            rows = binned(x, y, edges)
            if rung == rungs[-1]:
                axes.fill_between(rows[:, 0], rows[:, 1], rows[:, 3], color=colours[rung], alpha=0.2, linewidth=0)
            axes.plot(rows[:, 0], rows[:, 2], color=colours[rung], linewidth=1.2)
    return {"title": traces[0].motion.joints[j], "svg": to_svg(figure, description)}


def _medians(traces: Sequence[RunTrace], residuals: Sequence[Array], j: int) -> list[float]:
    """Median residual of each run where the joint moves; not a number where it never does."""
    own = [residual[trace.motion.moving[:, j], j] for trace, residual in zip(traces, residuals, strict=True)]
    return [float(np.median(values)) if len(values) else np.nan for values in own]


def _residual(trace: RunTrace, rung: str) -> Float[Array, "t n"]:
    """Measured less modelled torque after the common filter [N m]."""
    return trace.motion.tau_filtered - trace.filtered[rung]


def _edges(values: Float[Array, " k"], bins: int = BINS) -> Float[Array, " b"]:
    """Edges of bins of like counts; none where there is too little."""
    if len(values) < 10 * bins:
        bins = max(1, len(values) // 10)
    if len(values) < 10:
        return np.zeros(0)
    edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, bins + 1)))
    edges[-1] = np.nextafter(edges[-1], np.inf)
    return edges
