"""Sections of an evaluation: payloads as in the paper's table 2, models side by side, torque, what
is left of it.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.fitting.identification import pair_in_words
from ident.model.evaluation import Evaluation, RunTrace, SessionScore
from ident.model.hybrid import HybridModel
from ident.model.loss import NAMES
from ident.show.fit_lines import describe_carried, describe_foretold, foretold_of
from ident.show.palette import INK, MEASURED, REST, model_colour, on_page, rung_colours, rung_name
from ident.show.report.evaluation import ReportInput, pool_name
from ident.show.report.figures import WIDE, binned, envelope, make_panel, thin, to_svg
from ident.show.report.page import Section
from ident.show.report.words import fixed, sentence, significant, with_units
from ident.units import ANGLE, unit_for

TICK_WIDTH = 16  # [characters]
BINS = 14
# Runs from which on no line parts them in a picture.
MANY_RUNS = 60
# Figures of a comparison: caption, and the score's name.
COMPARED = (("energy error of a run [J]", "energy"), ("torque error, RMS [N m]", "rmse"))
NEAR_THE_URDF = "Link inertias were fitted near the URDF's"
WRITTEN_BACK = (
    "Base parameters were fitted and written back with as little change to the URDF as that needs; "
    "single link numbers need not be physical, only their sums act: "
)
WORDS = {
    "motor_inertia": "Rotor inertia B_m",
    "viscous": "Viscous friction C_m",
    "coulomb": "Coulomb friction f_c",
    "offset": "Torque offset",
}


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
        x = np.arange(len(sessions)) + (k - (len(models) - 1) / 2) * width
        axes.bar(x, mean[k], 0.88 * width, color=model_colour(k))
        axes.errorbar(x, mean[k], std[k], fmt="none", ecolor=MEASURED, elinewidth=0.9, capsize=2)
    axes.axhline(0.0, color=INK, linewidth=0.6)
    axes.set_xticks(np.arange(len(sessions)), ticks)
    return {"title": sentence(label), "svg": to_svg(figure, f"{label} of {', '.join(models)}")}


def fits_section(source: ReportInput) -> Section:
    """Measured torque against every rung, one panel a joint, for a typical run and for the worst one."""
    evaluation = source.evaluation
    # Torque RMSE of the last rung over all joints where they move, run by run [N m].
    squares = np.concatenate([score.squares[-1] for score in evaluation.sessions])
    there = np.isfinite(squares)
    errors = np.sqrt(np.where(there, squares, 0.0).sum(axis=1) / np.maximum(there.sum(axis=1), 1))
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
        rests = np.concatenate([[0], ~trace.motion.moving[:, j], [0]]).astype(int)
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
    """Residual of one rung where the joint moves, over all runs: its span, and each run's median."""
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


def parameters_section(source: ReportInput) -> Section:
    """Loss parameters with their 95 % intervals: one picture each, joints in rows, models side by side."""
    names = [evaluation.model for evaluation in source.evaluations]
    values = parameters_values(source.models, names, source.main)
    return Section("parameters", "What was fitted", "parameters.html", values)


def parameters_values(
    models: Sequence[HybridModel], names: Sequence[str], main: int, losses: bool = True
) -> dict[str, Any]:
    """What the template of parameters gets.

    Args:
        models, names: Fitted models, and what each is called.
        main: Which of them the page speaks of first.
        losses: Whether losses and the error on unseen parts are to be shown, too.
    """
    model = models[main]
    known = {figure.name for fitted in models for figure in fitted.figures}
    shown = [name for name in NAMES if name in known] if losses else []
    units = {figure.name: figure.unit for figure in reversed(model.figures)}
    links: Iterable[Any] = ()
    if model.inertia != "nominal":
        links = zip(model.nominal.links, *before_and_after(model), strict=True)
    named = [with_units(law.describe(model.joint_names)) for law in model.named]
    return {
        "models": [(name, model_colour(k)) for k, name in enumerate(names)],
        "pictures": [draw_figures(models, name) for name in shown],
        "model": names[main],
        "columns": [(WORDS[name], units.get(name, "")) for name in shown],
        "figures": {(figure.joint, figure.name): figure for figure in model.figures},
        "shown": shown,
        "inertia": describe_inertia(model),
        "links": links,
        "fitted": model,
        "tied": [pair_in_words(*pair["figures"]) for pair in model.provenance.get("tied", [])],
        "named": named,
        "carried": describe_carried(model),
        "foretold": describe_foretold(model) if losses else "",
        "foretold_rows": [joint.cells for joint in foretold_of(model)] if losses else [],
        "left_out": model.provenance.get("named_left_out", []),
        "net": net_rows(model),
    }


def draw_figures(models: Sequence[HybridModel], name: str) -> dict[str, Any]:
    """One loss parameter of all joints and models: a dot and its 95 % interval."""
    joints = list(max(models, key=lambda model: model.arm.n).joint_names)
    figures = [figure for model in models for figure in model.figures if figure.name == name]
    unit = figures[0].unit
    longest = max(len(joint) for joint in joints)
    height = 0.55 + 0.24 * len(joints) + 0.04 * len(joints) * (len(models) - 1)
    figure, axes = make_panel(f"[{unit}]", "", (3.5, height), left=min(1.5, 0.2 + 0.068 * longest))
    for k, model in enumerate(models):
        beside = 0.16 * (k - (len(models) - 1) / 2)
        rows = []
        x = []
        below = []
        above = []
        for parameter in model.figures:
            if parameter.name == name and parameter.joint in joints:
                rows.append(joints.index(parameter.joint) + beside)
                x.append(parameter.value)
                below.append(max(parameter.value - parameter.low, 0.0))
                above.append(max(parameter.high - parameter.value, 0.0))
        colour = model_colour(k)
        reach = np.array([below, above])
        axes.errorbar(x, rows, xerr=reach, fmt="o", markersize=3, color=colour, linewidth=1.1)
    axes.set_yticks(range(len(joints)), joints)
    axes.set_ylim(len(joints) - 0.4, -0.6)
    axes.grid(axis="x", color="#dddddd", linewidth=0.5)
    axes.grid(axis="y", visible=False)
    axes.axvline(0.0, color=INK, linewidth=0.6)
    svg = to_svg(figure, f"{WORDS[name]} of every joint")
    return {"title": f"{WORDS[name]} [{unit}]", "svg": svg}


def describe_inertia(model: HybridModel) -> str:
    """What was done to the link inertias, in a sentence or two."""
    if model.inertia == "nominal":
        text = "Link inertias are the URDF's; nothing was fitted."
    else:
        before, after = before_and_after(model)
        text = WRITTEN_BACK
        if model.inertia == "consistent":
            text = f"{NEAR_THE_URDF}, under the condition that every link could be a real body: "
        masses = f"{fixed(before[:, 0].sum(), 2)} → {fixed(after[:, 0].sum(), 2)} kg"
        text += f"moving mass {masses}."
    condition = model.provenance.get("condition_number")
    if condition is not None:
        text += f" Condition number of the training motions: {significant(condition, 3)}."
    return text


def before_and_after(model: HybridModel) -> tuple[Float[Array, "l 10"], Float[Array, "l 10"]]:
    """Ten inertial numbers of every link: of the URDF, and as fitted."""
    before = model.nominal.inertial_parameters.reshape(-1, 10)
    after = model.arm.inertial_parameters.reshape(-1, 10)
    return before, after


def net_rows(model: HybridModel) -> list[dict[str, Any]]:
    """What the residual net did on runs that it never saw, and how much of it each joint keeps;
    none without a net.

    Returns:
        Rows of "joint" and the fields of its gate (`JointGate.to_dict`); empty without a net.
    """
    gates = model.provenance.get("net_gate", [])
    if len(gates) != len(model.joint_names):
        return []
    return [{"joint": joint, **gate} for joint, gate in zip(model.joint_names, gates, strict=True)]
