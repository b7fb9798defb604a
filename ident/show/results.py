"""Results in words and pictures, for Python and notebooks: the words are those that the commands print.

Kinds of results are known by name, so that the words of a fit load no diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from ident.console import styled
from ident.errors import plural, visible
from ident.results import Result
from ident.show.console import ladder_table, print_issues
from ident.show.palette import FLEXIBLE, MEASURED, NAMED, NOISE, TUNED, rung_colours
from ident.show.panels import draw_bars, framed, panel, words_and_picture

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ident.checks.report import Inspection
    from ident.infer.new_session import NewSession
    from ident.model.evaluation import Evaluation
    from ident.model.hybrid import FitResults


def write(console: Console, result: Result) -> None:
    """Prints a result; one that has no words of its own by its plain values."""
    own = _of_kind(WORDS, result)
    if own is not None:
        own(console, result)
    elif type(result).summary is not Result.summary:
        console.print(visible(result.summary(), lines=True), highlight=False, soft_wrap=True)
    else:
        for name, value in result.to_dict().items():
            if not isinstance(value, dict | list):
                console.print(f"{name}: {value}", soft_wrap=True)


def draw(result: Result) -> Figure:
    """A result as a picture."""
    picture = _of_kind(PICTURES, result)
    if picture is None:
        raise TypeError(f"{type(result).__name__} has no picture")
    return picture(result)


def as_html(result: Result) -> str:
    """A result for a notebook: its page, where it has one, scrolled to its first screen; else its words and picture."""
    page = _of_kind(PAGES, result)
    return words_and_picture(result.summary(), result.plot()) if page is None else framed(page(result))


def _of_kind(table: Mapping[str, Callable[..., Any]], result: Result) -> Callable[..., Any] | None:
    return next((table[kind.__name__] for kind in type(result).__mro__ if kind.__name__ in table), None)


def _of_record(place: str) -> Callable[..., Any]:
    """What a function of another module, `module:name`, makes of a result's record; a console may stand before it."""

    def show(*given: Any) -> Any:
        module, _, name = place.partition(":")
        return getattr(import_module(module), name)(*given[:-1], given[-1].to_dict())

    return show


def draw_diagnosis(record: Mapping[str, Any]) -> Figure:
    """Of each joint what is left by the tuned model, after the names and by a flexible function, and what is noise."""
    gap, heldout = record["gap"], record["heldout"]
    after, flexible = heldout.get("rms_after_Nm", {}), heldout.get("without_names_rms_Nm", {})
    rows = {
        "left by the tuned model": (TUNED, [one["rms_Nm"] for one in gap.values()]),
        "left after the named effects": (NAMED, [after.get(joint) for joint in gap]),
        "left by a flexible function, without names": (FLEXIBLE, [flexible.get(joint) for joint in gap]),
        "noise: nothing can go below": (NOISE, [one["noise_floor_Nm"] for one in gap.values()]),
    }
    if not record["findings"]:
        del rows["left after the named effects"]
    return draw_bars(list(gap), rows, "torque [N m]", f"{record['robot']}: {record['verdict']}")


def print_evaluation(console: Console, result: Any) -> None:
    """The ladders of one evaluation, or of several."""
    for evaluation in getattr(result, "models", (result,)):
        console.print(styled((evaluation.model, "bold")))
        several = len(evaluation.sessions) > 1
        for one in (*evaluation.sessions, evaluation.pooled) if several else evaluation.sessions:
            console.print(ladder_table(one))


def draw_evaluation(result: Evaluation) -> Figure:
    """Torque error of each rung at each joint."""
    score = result.pooled
    colours = rung_colours(score.rungs)
    rows = {rung: (colours[rung], list(score.rmse_mean[k, :-1])) for k, rung in enumerate(score.rungs)}
    return draw_bars(list(score.joints), rows, "torque RMSE [N m]", result.model)


def print_fit(console: Console, result: FitResults) -> None:
    """What was identified, and what was left out of it."""
    from ident.model.identification import describe
    from ident.model.net_shrinkage import describe_gate

    lines = [result.loss.summary(), *describe(result.identified)]
    lines += [f"left out of what the diagnosis names: {one}" for one in result.model.provenance["named_left_out"]]
    if result.model.net is not None and result.model.net.gate:
        lines.append(describe_gate(result.model.net.gate, result.model.joint_names))
    console.print("\n".join(lines), soft_wrap=True)


def draw_fit(result: FitResults) -> Figure:
    """Loss parameters: rotor inertia, viscous and Coulomb friction of each joint."""
    loss = result.model.loss
    rows = {
        "rotor inertia [kg m²]": (MEASURED, list(loss.motor_inertia)),
        "viscous [N m s/rad]": (TUNED, list(loss.viscous)),
        "Coulomb [N m]": (NOISE, list(loss.coulomb)),
    }
    return draw_bars(list(result.model.joint_names), rows, "loss parameters", result.model.robot.name)


def print_inspection(console: Console, result: Inspection) -> None:
    """Each session's amount, what its effort is, its issues and the verdict."""
    for report in result.reports:
        session = report.session
        size = f"{plural(len(session.runs), 'run')}, {session.samples} samples, {session.duration:.1f} s"
        console.print(f"{session.name}: {size}")
        for one in report.effort:
            console.print(visible(f"effort of {one.joint}: {one.kind} ({one.evidence})"), soft_wrap=True)
        print_issues(console, report.to_dict()["telemetry"])
        console.print(report.verdict if report.is_fit else styled((report.verdict, "red")))


def draw_inspection(result: Inspection) -> Figure:
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


def print_guesses(console: Console, result: NewSession) -> None:
    """The guesses with their evidence, and what the telemetry check finds under them."""
    console.print(visible(result.summary(), lines=True), highlight=False, soft_wrap=True)
    print_issues(console, result.to_dict()["telemetry"])


# Both kinds of diagnosis, the new one and that from a file, can be exported: by that name they are known here.
WORDS: dict[str, Callable[[Console, Any], None]] = {
    "ArmComparison": _of_record("ident.show.terminal:print_comparison"),
    "Exportable": _of_record("ident.show.terminal:print_diagnosis"),
    "Evaluation": print_evaluation,
    "Evaluations": print_evaluation,
    "FitResults": print_fit,
    "Inspection": print_inspection,
    "NewSession": print_guesses,
}
PICTURES: dict[str, Callable[[Any], Figure]] = {
    "ArmComparison": _of_record("ident.show.terminal:draw_comparison"),
    "Exportable": _of_record("ident.show.results:draw_diagnosis"),
    "Evaluation": draw_evaluation,
    "FitResults": draw_fit,
    "Inspection": draw_inspection,
}
PAGES: dict[str, Callable[[Any], str]] = {
    "ArmComparison": _of_record("ident.show.report.diagnosis_pages:render_comparison_report"),
    "Exportable": _of_record("ident.show.report.diagnosis_pages:render_diagnosis_report"),
}
