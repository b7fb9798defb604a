"""Results in words and pictures, for Python and notebooks: the words are those that the commands
print.

Kinds of results are known by name, so that the words of a fit load no diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from importlib import import_module
from io import StringIO
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console

from ident.errors import plural
from ident.results import Result
from ident.show.console import WIDE, PlainConsole, ladder_table, print_issues, say, say_lines
from ident.show.palette import FLEXIBLE, MEASURED, NAMED, NOISE, TUNED, rung_colours, rung_name
from ident.show.report.words import TABLES, pair, significant, with_units
from ident.units import DAMPING, INERTIA, TORQUE

PANEL = (6.0, 3.0)  # [inch]

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ident.checks.report import Inspection
    from ident.fitting.fit import FitResults
    from ident.infer.new_session import NewSession
    from ident.model.evaluation import Evaluation, SessionScore
    from ident.servos.servo_fit import ServoArm


def write(console: Console, result: Result) -> None:
    """Prints a result; one that has no words of its own by its plain values."""
    write_kind = _of_kind(WORDS, result)
    if write_kind is not None:
        write_kind(console, result)
    elif type(result).summary is not Result.summary:
        say_lines(console, result.summary())
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
    """A result for a notebook: its page, where it has one, scrolled to its first screen; else its
    words and picture.
    """
    page = _of_kind(PAGES, result)
    if page is None:
        from ident.show.report.figures import to_svg

        lines = result.summary()
        picture = to_svg(result.plot(), lines.strip().partition("\n")[0] or "result")
        return f'<div class="armgap"><pre>{escape(lines)}</pre>{picture}</div>'
    # A whole page within another, as high as a screen: its style and its links stay its own.
    style = "width:100%;height:36rem;border:0"
    return f'<iframe srcdoc="{escape(page(result))}" style="{style}" title="armgap"></iframe>'


def _of_kind(table: Mapping[str, Callable[..., Any]], result: Result) -> Callable[..., Any] | None:
    kinds = [kind.__name__ for kind in type(result).__mro__]
    return next((table[kind] for kind in kinds if kind in table), None)


def _of_record(place: str) -> Callable[..., Any]:
    """What a function of another module, `module:name`, makes of a result's record; a console may
    stand before it.
    """

    def show(*given: Any) -> Any:
        module, _, name = place.partition(":")
        return getattr(import_module(module), name)(*given[:-1], given[-1].to_dict())

    return show


def print_servos(console: Console, result: ServoArm) -> None:
    """What holds each joint of a position-only arm back."""
    from ident.show.servo_lines import print_servo

    print_servo(console, result)


def draw_diagnosis(record: Mapping[str, Any]) -> Figure:
    """Of each joint what is left by the tuned model, after the names and by a flexible function,
    and what is noise.
    """
    gap = record["gap"]
    after = record["heldout"].get("rms_after_Nm", {})
    of_joints = list(gap.values())
    rows = {
        "left by the tuned model": (TUNED, [joint["rms_Nm"] for joint in of_joints]),
        "left after the named effects": (NAMED, [after.get(joint) for joint in gap]),
        "left by a flexible function": (
            FLEXIBLE,
            [joint.get("ceiling_rms_Nm") for joint in of_joints],
        ),
        "counted as noise": (NOISE, [joint["noise_floor_Nm"] for joint in of_joints]),
    }
    if not record["findings"]:
        del rows["left after the named effects"]
    return draw_bars(list(gap), rows, "torque [N m]", f"{record['robot']}: {record['verdict']}")


def print_evaluation(console: Console, result: Any) -> None:
    """The ladders of one evaluation, or of several."""
    for evaluation in getattr(result, "models", (result,)):
        say(console, describe_evaluation(evaluation), style="bold")
        scores = list(evaluation.sessions)
        if len(scores) > 1:
            scores.append(evaluation.pooled)
        for score in scores:
            console.print(ladder_table(score))


def describe_evaluation(evaluation: Evaluation) -> str:
    """What the whole model errs by, and the URDF as a simulator loads it, over all joints."""
    score = evaluation.pooled
    urdf = score.rungs.index("urdf") if "urdf" in score.rungs else 0
    runs = plural(len(score.runs), "run")
    whole = f"{evaluation.model} is off by {describe_error(score, -1)} on {runs} of {score.name}"
    told = f"{whole}; the {rung_name(score.rungs[urdf])} alone by {describe_error(score, urdf)}."
    return f"{told} {describe_fitted(evaluation)}".rstrip()


def describe_fitted(evaluation: Evaluation) -> str:
    """That a model was fitted to recordings it is tried on; empty where it was not."""
    count = evaluation.fitted_files
    if not count:
        return ""
    was = "was" if count == 1 else "were"
    files = plural(count, "file")
    return f"{files} of these {was} part of its fit: give others to see what it foretells."


def describe_error(score: SessionScore, rung: int) -> str:
    """What a rung errs by, all joints together."""
    torque = significant(score.rmse_mean[rung, -1])
    spread = score.energy_std[rung, -1] if len(score.runs) > 1 else None
    return f"{torque} N m and {pair(score.energy_mean[rung, -1], spread)} J a run"


def draw_evaluation(result: Evaluation) -> Figure:
    """Torque error of each rung at each joint."""
    score = result.pooled
    colours = rung_colours(score.rungs)
    rows = {}
    for k, rung in enumerate(score.rungs):
        rows[rung] = (colours[rung], list(score.rmse_mean[k, :-1]))
    return draw_bars(list(score.joints), rows, "torque RMSE [N m]", result.model)


def print_fit(console: Console, result: FitResults) -> None:
    """What the fit errs by on what it did not see, what was identified, what was left out, and what
    comes next.
    """
    from ident.show.fit_lines import NEXT, describe_foretold, describe_offsets, foretold_lines
    from ident.show.number_lines import print_numbers

    say(console, describe_foretold(result.model), style="bold")
    console.print("\n".join(foretold_lines(result.model)), soft_wrap=True, highlight=False)
    names = result.model.joint_names
    sliding = result.model.arm.sliding_joints
    slides = [name for name, is_slide in zip(names, sliding, strict=True) if is_slide]
    record = {"joints": names, "slides": slides, "identified": result.to_dict()["identified"]}
    print_numbers(console, record, "± 95 %, with the URDF's tolerance where its inertias count")
    console.print()
    for line in [*describe_offsets(result.model), *describe_fit(result)]:
        say(console, with_units(line), hanging="  ")
    say(console, NEXT, hanging="  ")


def describe_fit(result: FitResults) -> list[str]:
    """What was identified beside the losses, chosen and carried, and what was left out, a line
    each.
    """
    from ident.show.fit_lines import describe_choices, describe_data, describe_laws

    return [*describe_data(result), *describe_choices(result), *describe_laws(result.model)]


def draw_fit(result: FitResults) -> Figure:
    """Loss parameters: rotor inertia, viscous and Coulomb friction of each joint."""
    loss = result.model.loss
    rows = {
        f"rotor inertia [{INERTIA}]": (MEASURED, list(loss.motor_inertia)),
        f"viscous [{DAMPING}]": (TUNED, list(loss.viscous)),
        f"Coulomb [{TORQUE}]": (NOISE, list(loss.coulomb)),
    }
    return draw_bars(
        list(result.model.joint_names), rows, "loss parameters", result.model.robot.name
    )


def print_inspection(console: Console, result: Inspection) -> None:
    """Each session's amount, what its effort is, its issues and the verdict."""
    for report in result.reports:
        session = report.session
        runs = plural(len(session.runs), "run")
        size = f"{runs}, {session.samples} samples, {session.duration:.1f} s"
        console.print(f"{session.name}: {size}")
        told = {issue.evidence for issue in report.issues}
        for effort in report.effort:
            evidence = "see below" if effort.evidence in told else effort.evidence
            kind = TABLES["efforts"][effort.kind]
            say(console, f"effort of {effort.joint}: {kind} ({evidence})", hanging="  ")
        print_issues(console, report.to_dict()["telemetry"])
        say(console, report.verdict, style="" if report.is_fit else "red")


def draw_inspection(result: Inspection) -> Figure:
    """Torque of every joint over the first run of each session."""
    figure, axes = panel("time in the run [s]", "torque [N m]", "first runs")
    for report in result.reports:
        for run in report.session.runs[:1]:
            step = max(1, len(run) // 1000)
            time = np.asarray(run.time[::step]) - float(run.time[0])
            for j, joint in enumerate(run.joints):
                axes.plot(
                    time,
                    run.effort[::step, j],
                    linewidth=0.8,
                    label=f"{report.session.name}: {joint}",
                )
    axes.legend(fontsize=6, ncols=2)
    return figure


def print_guesses(console: Console, result: NewSession) -> None:
    """The guesses with their evidence, and what the telemetry check finds under them."""
    for line in result.summary().splitlines():
        say(console, line, hanging="    ")
    print_issues(console, result.to_dict()["telemetry"])


def as_text(write: Callable[[Console], None]) -> str:
    """What is printed, as text without colours."""
    stream = StringIO()
    write(
        PlainConsole(
            file=stream, width=WIDE, color_system=None, markup=False, emoji=False, highlight=False
        )
    )
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines())


def panel(x_label: str, y_label: str, title: str) -> tuple[Figure, Axes]:
    """An empty picture that belongs to no window."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=PANEL, layout="constrained")
    axes = figure.add_subplot()
    axes.set_xlabel(x_label)
    axes.set_ylabel(y_label)
    axes.set_title(title, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def draw_bars(
    names: Sequence[str],
    rows: Mapping[str, tuple[str, Sequence[float | None]]],
    label: str,
    title: str,
) -> Figure:
    """Bars side by side, a group a name; a value that is None has none."""
    figure, axes = panel("", label, title)
    width = 0.8 / max(1, len(rows))
    places = np.arange(len(names))
    for k, (words, (colour, values)) in enumerate(rows.items()):
        heights = [0.0 if value is None else float(value) for value in values]
        axes.bar(
            places + (k - (len(rows) - 1) / 2) * width, heights, width, color=colour, label=words
        )
    axes.set_xticks(places, names, rotation=30 if len(names) > 4 else 0, fontsize=7)
    if rows:
        axes.legend(fontsize=7)
    return figure


# Both kinds of diagnosis, the new one and that from a file, can be exported: by that name they are
# known here.
WORDS: dict[str, Callable[[Console, Any], None]] = {
    "ArmComparison": _of_record("ident.show.terminal:print_comparison"),
    "Exportable": _of_record("ident.show.diagnosis_lines:print_diagnosis"),
    "Evaluation": print_evaluation,
    "Evaluations": print_evaluation,
    "FitResults": print_fit,
    "Inspection": print_inspection,
    "NewSession": print_guesses,
    "ServoArm": print_servos,
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
