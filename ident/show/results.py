"""Results in words and pictures, for Python and notebooks: the words are those that the commands print.

Kinds of results are known by name, so that the words of a fit load no diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from ident.errors import plural
from ident.results import Result
from ident.show.console import LadderTable, print_effort, print_issues
from ident.show.palette import MEASURED, rung_colours
from ident.show.panels import as_text, draw_bars, panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.checks.report import Inspection
    from ident.diagnosis.change.result import ArmComparison
    from ident.diagnosis.result import Diagnosis
    from ident.model.evaluation import Evaluation
    from ident.model.hybrid import FitResults

NOISE, LEFT, EXPLAINABLE = "#999999", MEASURED, "#d55e00"


def summary(result: Result) -> str:
    """A result in plain lines; where it has no words of its own, its figures."""
    words = _of_kind(WORDS, result)
    if words is not None:
        return words(result)
    record = result.to_dict()
    plain = {name: value for name, value in record.items() if not isinstance(value, dict | list)}
    return "\n".join(f"{name}: {value}" for name, value in plain.items())


def draw(result: Result) -> Figure:
    """A result as a picture."""
    picture = _of_kind(PICTURES, result)
    if picture is None:
        raise TypeError(f"{type(result).__name__} has no picture")
    return picture(result)


def _of_kind(table: Mapping[str, Callable[[Any], Any]], result: Result) -> Callable[[Any], Any] | None:
    return next((table[kind.__name__] for kind in type(result).__mro__ if kind.__name__ in table), None)


def _tell_diagnosis(result: Diagnosis) -> str:
    from ident.show.terminal import print_diagnosis

    return as_text(lambda console: print_diagnosis(console, result))


def _draw_diagnosis(result: Diagnosis) -> Figure:
    """Of each joint what is left, what is noise, and what could still be explained."""
    gap = result.gap
    rows = {
        "left by the tuned model": (LEFT, [one.rms for one in gap.values()]),
        "could be explained": (EXPLAINABLE, [one.ceiling_rms for one in gap.values()]),
        "noise": (NOISE, [one.noise_floor for one in gap.values()]),
    }
    return draw_bars(list(gap), rows, "torque [N m]", f"{result.robot}: {result.verdict}")


def _tell_evaluation(result: Evaluation) -> str:
    def write(console: Console) -> None:
        console.print(result.model)
        for one in (*result.sessions, result.pooled) if len(result.sessions) > 1 else result.sessions:
            console.print(LadderTable(one))

    return as_text(write)


def _draw_evaluation(result: Evaluation) -> Figure:
    """Torque error of each rung at each joint."""
    score = result.pooled
    colours = rung_colours(score.rungs)
    rows = {rung: (colours[rung], list(score.rmse_mean[k, :-1])) for k, rung in enumerate(score.rungs)}
    return draw_bars(list(score.joints), rows, "torque RMSE [N m]", result.model)


def _tell_fit(result: FitResults) -> str:
    from ident.model.identification import describe
    from ident.model.net_shrinkage import describe_gate

    lines = [result.loss.summary(), *describe(result.identified)]
    lines += [f"left out of what the diagnosis names: {one}" for one in result.model.provenance["named_left_out"]]
    if result.model.net is not None and result.model.net.gate:
        lines.append(describe_gate(result.model.net.gate, result.model.joint_names))
    return "\n".join(lines)


def _draw_fit(result: FitResults) -> Figure:
    """Loss figures: rotor inertia, viscous and Coulomb friction of each joint."""
    loss = result.model.loss
    rows = {
        "rotor inertia [kg m²]": (LEFT, list(loss.motor_inertia)),
        "viscous [N m s/rad]": (EXPLAINABLE, list(loss.viscous)),
        "Coulomb [N m]": (NOISE, list(loss.coulomb)),
    }
    return draw_bars(list(result.model.joint_names), rows, "loss figures", result.model.robot.name)


def _tell_inspection(result: Inspection) -> str:
    def write(console: Console) -> None:
        for report in result.reports:
            session = report.session
            size = f"{plural(len(session.runs), 'run')}, {session.samples} samples, {session.duration:.1f} s"
            console.print(f"{session.name}: {size}")
            print_effort(console, report.effort)
            print_issues(console, report.issues)
            console.print(report.verdict)

    return as_text(write)


def _draw_inspection(result: Inspection) -> Figure:
    """Torque of every joint over the first run of each session."""
    figure, axes = panel("time in the run [s]", "torque [N m]", "first runs")
    for report in result.reports:
        for run in report.session.runs[:1]:
            step = max(1, len(run) // 1000)
            time = np.asarray(run.time[::step]) - float(run.time[0])
            for j, joint in enumerate(run.joints):
                axes.plot(time, run.effort[::step, j], linewidth=0.8, label=f"{report.session.name}: {joint}")
    axes.legend(fontsize=6, ncols=2)
    return figure


def _tell_comparison(result: ArmComparison) -> str:
    from ident.show.changes import print_comparison

    return as_text(lambda console: print_comparison(console, result))


def _draw_comparison(result: ArmComparison) -> Figure:
    from ident.show.changes import draw_comparison

    return draw_comparison(result)


WORDS: dict[str, Callable[[Any], str]] = {
    "ArmComparison": _tell_comparison,
    "Diagnosis": _tell_diagnosis,
    "Evaluation": _tell_evaluation,
    "FitResults": _tell_fit,
    "Inspection": _tell_inspection,
}
PICTURES: dict[str, Callable[[Any], Figure]] = {
    "ArmComparison": _draw_comparison,
    "Diagnosis": _draw_diagnosis,
    "Evaluation": _draw_evaluation,
    "FitResults": _draw_fit,
    "Inspection": _draw_inspection,
}
