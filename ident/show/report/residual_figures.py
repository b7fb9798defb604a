"""What an evaluation's models leave of the torque: medians over an axis, and over time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.model.evaluation import RunTrace
from ident.show.palette import INK, MEASURED, rung_colours, rung_name
from ident.show.report.evaluation import ReportInput
from ident.show.report.figures import binned, envelope, make_panel, to_svg
from ident.show.report.page import Section
from ident.units import ANGLE, unit_for

BINS = 14
# Runs from which on no line parts them in a picture.
MANY_RUNS = 60


def residuals_section(source: ReportInput) -> Section:
    """Medians of measured less modelled torque: what a rung leaves has a shape, and the shape names
    its cause.
    """
    traces = source.evaluation.traces
    robot = source.model.robot
    sliding = dict(zip(robot.joint_names, robot.sliding_joints, strict=True))
    joints = traces[0].motion.joints
    units = [unit_for(ANGLE, bool(sliding.get(joint, False))) for joint in joints]
    rungs = tuple(traces[0].rungs)
    # Those that hold friction: beside the others nothing of theirs could be seen.
    close = rungs[rungs.index("loss") :] if "loss" in rungs else rungs
    colours = rung_colours(rungs)
    values = {
        "legend": [(rung_name(rung), colours[rung]) for rung in rungs],
        "last": rung_name(rungs[-1]),
        "close": ", ".join(rung_name(rung) for rung in close),
        "speed": draw_against("speed", traces, units, rungs),
        "speed_close": draw_against("speed", traces, units, close) if close != rungs else [],
        "position": draw_against("position", traces, units, close),
        "time": draw_over_time(traces, rungs[-1]),
    }
    return Section("residuals", "What is left, and where", "residuals.html", values)


def draw_against(
    axis: str, traces: Sequence[RunTrace], units: Sequence[str], rungs: tuple[str, ...]
) -> list[dict[str, Any]]:
    """Residual of each joint over an axis: median of every rung's in bins of like counts, for the
    last 80 % of them.

    Over `speed` the shape of friction, no bin across zero; over `position` gravity, springs and
    wrong masses.

    Args:
        axis: `speed` or `position`.
        traces: The runs.
        units: Of each joint's position.
        rungs: Which are drawn; the last with its span.
    """
    over_speed = axis == "speed"
    states = []
    for trace in traces:
        motion = trace.motion
        states.append((motion.dq if over_speed else motion.q)[motion.coarse])
    values = np.concatenate(states)
    moving = np.concatenate([trace.motion.moving for trace in traces])
    colours = rung_colours(tuple(traces[0].rungs))
    panels = []
    for j, joint in enumerate(traces[0].motion.joints):
        x = np.where(moving[:, j], values[:, j], np.nan)
        if over_speed:
            unit = f"{units[j]}/s"
            sides = [_edges(x[x < 0]), _edges(x[x > 0])]
        else:
            unit = units[j]
            sides = [_edges(x[np.isfinite(x)], 2 * BINS)]
        figure, axes = make_panel(f"{axis} [{unit}]", "residual [N m]")
        axes.axhline(0.0, color=INK, linewidth=0.5)
        for rung in rungs:
            colour = colours[rung]
            y = np.concatenate([_residual(trace, rung)[:, j] for trace in traces])
            for edges in sides:
                middle, low, median, high = binned(x, y, edges)[:, :4].T
                if rung == rungs[-1]:
                    axes.fill_between(middle, low, high, color=colour, alpha=0.2, linewidth=0)
                axes.plot(middle, median, color=colour, linewidth=1.2)
        panels.append({"title": joint, "svg": to_svg(figure, f"{joint}: residual against {axis}")})
    return panels


def draw_over_time(traces: Sequence[RunTrace], rung: str) -> list[dict[str, Any]]:
    """Residual of a rung where the joint moves, over all runs: its span, and each run's median."""
    residuals = [_residual(trace, rung) for trace in traces]
    lengths = [trace.time[-1] - trace.time[0] for trace in traces]
    starts = np.concatenate([[0.0], np.cumsum(lengths)])
    times = []
    for trace, start in zip(traces, starts[:-1], strict=True):
        times.append(trace.time - trace.time[0] + start)
    time = np.concatenate(times)
    stacked = np.concatenate(residuals)
    moving = np.concatenate([trace.motion.moving for trace in traces])
    colour = rung_colours(tuple(traces[0].rungs))[rung]
    panels = []
    for j, joint in enumerate(traces[0].motion.joints):
        figure, axes = make_panel("time, runs end to end [s]", "residual [N m]")
        if len(starts) < MANY_RUNS:
            for start in starts[1:-1]:
                axes.axvline(start, color="#e3e3e3", linewidth=0.5)
        span = envelope(time, np.where(moving[:, j], stacked[:, j], np.nan))
        axes.fill_between(*span, color=colour, alpha=0.45, linewidth=0.3)
        medians = []
        for trace, residual in zip(traces, residuals, strict=True):
            in_motion = residual[trace.motion.moving[:, j], j]
            medians.append(float(np.median(in_motion)) if len(in_motion) else np.nan)
        axes.hlines(medians, starts[:-1], starts[1:], color=MEASURED, linewidth=1.4)
        axes.axhline(0.0, color=INK, linewidth=0.5)
        axes.margins(x=0.01)
        panels.append({"title": joint, "svg": to_svg(figure, f"{joint}: residual over time")})
    return panels


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
