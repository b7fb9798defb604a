"""Sections of an evaluation: payloads as in the paper's table 2, models side by side, torque, what
is left of it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.model.evaluation import Evaluation, RunTrace, SessionScore
from ident.show.palette import INK, MEASURED, REST, model_colour, on_page, rung_colours, rung_name
from ident.show.report.evaluation import ReportInput, pool_name
from ident.show.report.figures import WIDE, make_panel, thin, to_svg
from ident.show.report.page import Section
from ident.show.report.words import fixed, sentence

TICK_WIDTH = 16  # [characters]
# Figures of a comparison: caption, and the score's name.
COMPARED = (("energy error of a run [J]", "energy"), ("torque error, RMS [N m]", "rmse"))


def payload_section(source: ReportInput) -> Section | None:
    """Energy and torque error of the main model, one row a payload, the lightest first, one column
    a rung.
    """
    loaded = [score for score in source.evaluation.sessions if score.payload_kg > 0]
    if not loaded:
        return None
    free = source.evaluation.pooled
    scores = [free] if free.payload_kg == 0 else []
    scores += sorted(loaded, key=lambda score: score.payload_kg)
    values = {"scores": scores, "pool_name": pool_name}
    return Section("payload", "With payload", "payload.html", values)


def comparison_section(source: ReportInput) -> Section | None:
    """The last rung of every model on every session without payload, over the joints that all
    models have.

    As the paper's figure 9: bars with their standard deviation.
    """
    evaluations = source.evaluations
    if len(evaluations) == 1 and len(compared_scores(source.evaluation)) == 1:
        return None
    known = [set(evaluation.pooled.joints) for evaluation in evaluations]
    shared = set.intersection(*known)
    joints = tuple(joint for joint in evaluations[0].pooled.joints if joint in shared)
    groups = []
    for evaluation in evaluations:
        scores = compared_scores(evaluation)
        groups.append([restrict(score, joints) for score in scores])
    names = [pool_name(score, 24) for score in groups[0]]
    models = [evaluation.model for evaluation in evaluations]
    tables = []
    for label, name in COMPARED:
        tables.append((label, _totals(groups, f"{name}_mean"), _totals(groups, f"{name}_std")))
    values = {
        "models": [(name, model_colour(k)) for k, name in enumerate(models)],
        "joints": joints,
        "all_joints": all(len(of_model) == len(joints) for of_model in known),
        "sessions": names,
        "several": [len(score.runs) > 1 for score in groups[0]],
        "figures": [draw_bars(label, names, models, mean, std) for label, mean, std in tables],
        "tables": tables,
        "fitted": source.models,
    }
    return Section("comparison", "Side by side", "comparison.html", values)


def _totals(groups: Sequence[Sequence[SessionScore]], name: str) -> Float[Array, "m s"]:
    """A score of the last rung over all joints: of each of m models on each of s sessions."""
    return np.array([_last(scores, name) for scores in groups])


def _last(scores: Sequence[SessionScore], name: str) -> list[float]:
    """A score of the last rung over all joints, by session."""
    return [getattr(score, name)[-1, -1] for score in scores]


def compared_scores(evaluation: Evaluation) -> list[SessionScore]:
    """Sessions without payload and, where there are several, all of them together; all sessions if
    each has one.
    """
    free = [score for score in evaluation.sessions if score.payload_kg == 0]
    free = free or list(evaluation.sessions)
    return [*free, evaluation.pooled] if len(free) > 1 else free


def restrict(score: SessionScore, joints: tuple[str, ...]) -> SessionScore:
    """A score over some joints only, in their order: totals of other joints can't be compared.

    Raises:
        ValueError: The score lacks one of them.
    """
    columns = [score.joints.index(joint) for joint in joints]
    return replace(
        score,
        joints=joints,
        energy_error=score.energy_error[..., columns],
        squares=score.squares[..., columns],
        rest_squares=score.rest_squares[..., columns],
        r2=score.r2[:, columns],
    )


def draw_bars(
    label: str,
    sessions: list[str],
    models: list[str],
    mean: Float[Array, "m s"],
    std: Float[Array, "m s"],
) -> dict[str, Any]:
    """Grouped bars: one group a session, one bar a model, black lines one standard deviation each
    way.

    Args:
        label: Of the vertical axis.
        sessions: Their names, S.
        models: Their names, M.
        mean: Heights, a row a model.
        std: Half the length of the lines.
    """
    ticks = [textwrap.fill(name, TICK_WIDTH) for name in sessions]
    most_breaks = max(tick.count("\n") for tick in ticks)
    figure, axes = make_panel("evaluated on", label, WIDE, bottom=0.42 + 0.13 * most_breaks)
    width = 0.8 / len(models)
    for k in range(len(models)):
        offset = (k - (len(models) - 1) / 2) * width
        x = np.arange(len(sessions)) + offset
        axes.bar(x, mean[k], 0.88 * width, color=model_colour(k))
        axes.errorbar(x, mean[k], std[k], fmt="none", ecolor=MEASURED, elinewidth=0.9, capsize=2)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_xticks(np.arange(len(sessions)), ticks)
    return {"title": sentence(label), "svg": to_svg(figure, f"{label} of {', '.join(models)}")}


def fits_section(source: ReportInput) -> Section:
    """Measured torque against every rung, one panel a joint, for a typical run and for the worst
    one.
    """
    evaluation = source.evaluation
    # Torque RMSE of the last rung over all joints where they move, run by run [N m].
    squares = np.concatenate([score.squares[-1] for score in evaluation.sessions])
    there = np.isfinite(squares)
    total = np.where(there, squares, 0.0).sum(axis=1)
    errors = np.sqrt(total / np.maximum(there.sum(axis=1), 1))
    order = np.argsort(errors)
    typical = int(order[(len(order) - 1) // 2])
    worst = int(order[-1])
    chosen = [("The run", worst)]
    if typical != worst:
        chosen = [("A typical run", typical), ("The worst run", worst)]
    colours = rung_colours(evaluation.pooled.rungs)
    rungs = [(rung_name(rung), colour) for rung, colour in colours.items()]
    runs = []
    for title, k in chosen:
        run = {
            "title": title,
            "name": run_name(evaluation, k),
            "error": fixed(errors[k], 2),
            "panels": draw_fits(evaluation.traces[k]),
        }
        runs.append(run)
    values = {
        "legend": [("measured", on_page(MEASURED)), *rungs, ("at rest: not judged", on_page(REST))],
        "runs": runs,
    }
    return Section("fits", "Torque, measured and modelled", "fits.html", values)


def run_name(evaluation: Evaluation, index: int) -> str:
    """Name of a trace: "SESSION/RUN", or "RUN" where both are the same, and the payload if any.

    Args:
        evaluation: Its sessions' runs in their order are what traces are numbered by.
        index: Number of the trace, from 0.
    """
    names = [(score, run) for score in evaluation.sessions for run in score.runs]
    score, run = names[index]
    payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
    return (run if run == score.name else f"{score.name}/{run}") + payload


def draw_fits(trace: RunTrace) -> list[dict[str, Any]]:
    """Measured torque and every rung over time, one panel a joint.

    Returns:
        Panels of "title" and "svg".
    """
    time = trace.time - trace.time[0]
    colours = rung_colours(tuple(trace.rungs))
    panels = []
    for j, joint in enumerate(trace.motion.joints):
        figure, axes = make_panel("time [s]", "torque [N m]")
        # Where it rests no model of its state can tell the torque.
        standing = ~trace.motion.moving[:, j]
        rests = np.concatenate([[0], standing, [0]]).astype(int)
        edges = np.flatnonzero(np.diff(rests))
        for start, end in edges.reshape(-1, 2):
            if end - start > 1:
                axes.axvspan(float(time[start]), float(time[end - 1]), color=REST, linewidth=0)
        axes.plot(*thin(time, trace.motion.tau_filtered[:, j]), color=MEASURED, linewidth=1.7)
        for rung, torque in trace.filtered.items():
            axes.plot(*thin(time, torque[:, j]), color=colours[rung], linewidth=0.95)
        axes.margins(x=0.01)
        svg = to_svg(figure, f"torque of {joint} over time, measured and modelled")
        panels.append({"title": joint, "svg": svg})
    return panels
