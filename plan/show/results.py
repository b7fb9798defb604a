"""Plans, comparisons and motions to record.

What the commands print, and what Python and notebooks show.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ident.show.console import styled
from plan.problem.scene_keys import as_given

if (
    TYPE_CHECKING
):  # each result is known by its name: none of them needs what the others are made of
    from matplotlib.figure import Figure

    from plan.experiment.result import Excitation
    from plan.problem.cycle_result import CycleResult
    from plan.problem.result import PlanResult
    from plan.solving.compare import Comparison

SAMPLES = 300
# The family of motions that answers no question of its own, in words.
SERIES = "all joints by a Fourier series about a pose"
UNITS = {"energy": "J", "time": "s"}
LINES = Path(__file__).with_name("lines.jinja")


def write(console: Console, result: PlanResult | CycleResult | Comparison | Excitation) -> None:
    """Prints a result in plain lines and tables, as the command does."""
    WRITERS[type(result).__name__](console, result)


def _say(console: Console, kind: str, result: Any, *more: Any, **given: Any) -> None:
    """Prints what the template's macro of a kind of result makes of it."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(line_statement_prefix="%", undefined=StrictUndefined)
    template = environment.from_string(LINES.read_text(encoding="utf-8"), given)
    for line in getattr(template.module, kind)(result, *more).splitlines():
        if line.strip():
            console.print(line, soft_wrap=True, highlight=False)


def _print_plan(console: Console, result: PlanResult) -> None:
    """A plan and its certificate, or why there is none.

    And what became of the initial trajectories.
    """
    status = (result.status, "green" if result.solved else "red")
    spent = f" by {result.method} in {result.seconds:.2f} s, {result.evaluations} evaluations"
    console.print(styled(status, spent), soft_wrap=True)
    vias = []
    if result.splines is not None and result.certificate is not None:
        slides = result.certificate.scene.arm.sliding_joints
        stamps = np.cumsum(result.splines.durations[0])[:-1]
        points = result.splines.points[0, 1:-1]
        words = [
            ", ".join(as_given(x, bool(one), 2) for x, one in zip(q, slides, strict=True))
            for q in points
        ]
        words = words if slides.any() else [word.replace(" deg,", ",") for word in words]
        vias = list(zip(stamps, words, strict=True))
    _say(console, "plan", result, vias=vias)
    if len(result.starts) > 1:
        table = Table(title="initial trajectories", title_justify="left")
        for name in ("start", f"cost reached [{UNITS[result.objective]}]", "reason"):
            table.add_column(name)
        for start in result.starts:
            cost = start.get("cost")
            failed = "not made feasible" if "violation" in start and cost is None else ""
            table.add_row(
                start["label"], "" if cost is None else f"{cost:.3f}", start["reason"] or failed
            )
        console.print(table)


def _print_cycle(console: Console, result: CycleResult) -> None:
    """What a cycle takes, and a row for each of its motions."""
    console.print(styled((result.status, "green" if result.solved else "red"), ""), soft_wrap=True)
    _say(console, "cycle", result)
    table = Table(title="motions", title_justify="left")
    for name in (
        "leg",
        "duration [s]",
        "energy [J]",
        "clearance [mm]",
        "torque [%]",
        "slowed down [%]",
    ):
        table.add_column(name, justify="right")
    for number, leg in enumerate(result.legs, start=1):
        certificate = leg.plan.certificate
        splines = leg.plan.splines
        if certificate is None or splines is None or leg.slowed_torque_share is None:
            table.add_row(str(number), leg.plan.status, "", "", "", "")
            continue
        closest = certificate.closest
        table.add_row(
            str(number),
            f"{float(splines.total[0]):.3f}",
            f"{certificate.energy[leg.plan.metric]:.2f}",
            f"{1000.0 * closest.proven:.1f}" if closest.checks else "",
            f"{100.0 * float(certificate.torque_share.max()):.1f}",
            f"{100.0 * leg.slowed_torque_share:.1f}",
        )
    console.print(table)


def _print_comparison(console: Console, comparison: Comparison) -> None:
    """Medians over the seeds, a row a method."""
    table = Table(title=f"{comparison.name}: medians over the seeds", title_justify="left")
    columns = {
        "method": "{method}",
        "solved": "{solved}/{runs}",
        f"cost [{UNITS[comparison.objective]}]": "{cost:.4g}",
        "executed": "{executed:.4g}",
        "worst": "{worst:.4g}",
        f"at {comparison.evaluations} evaluations": "{cost_at_evaluations:.4g}",
        f"at {comparison.seconds:g} s": "{cost_at_seconds:.4g}",
        "evaluations": "{evaluations}",
        "time [s]": "{seconds:.2f}",
        "clearance [mm]": "{clearance_mm:.1f}",
        "above the best [%]": "{above_percent:.2f}",
    }
    for name in columns:
        table.add_column(name, justify="left" if name == "method" else "right")
    for row in comparison.rows():
        known = {name: float("nan") if value is None else value for name, value in row.items()}
        known |= {
            "clearance_mm": 1000 * known["clearance_m"],
            "above_percent": 100 * known["above_best"],
        }
        table.add_row(*(text.format(**known).replace("nan", "–") for text in columns.values()))
    console.print(table)


def _print_motion(console: Console, found: Excitation) -> None:
    """The set-up where it must change, the motion, what it tells, and what random motion would."""
    from ident.effects.effect_info import describe_motion
    from ident.errors import plural
    from plan.experiment.result import odds_of

    odds = [
        "over 10⁶ : 1" if odds_of(one) > 1e6 else f"{odds_of(one):.3g} : 1"
        for one in found.smallest
    ]
    motion = (
        SERIES
        if found.run_set.family == "fourier"
        else describe_motion(found.run_set.family, found.joint)
    )
    _say(console, "motion", found, motion, plural(len(found.runs), "run"), odds)


WRITERS: dict[str, Callable[[Console, Any], None]] = {
    "PlanResult": _print_plan,
    "CycleResult": _print_cycle,
    "Comparison": _print_comparison,
    "Excitation": _print_motion,
}


def draw(result: Any) -> Figure:
    """A result as a picture.

    A comparison's costs; angles of a plan, or of a motion's first run, over time.
    """
    from ident.show.results import panel
    from ident.trajectories.reference import TICK_S

    kind = type(result).__name__
    curves = list[tuple[Any, Any, str]]()
    if kind == "Comparison":
        from plan.show.pictures import draw_comparison

        return draw_comparison(result)
    if kind == "CycleResult":
        figure, axes = panel(
            "time [s]", "angle [deg]", f"{result.status}: {len(result.legs)} motions"
        )
        begin = 0.0
        for leg in result.legs:
            if leg.plan.splines is not None:
                total = float(leg.plan.splines.total[0])
                times = np.linspace(0.0, total, SAMPLES)
                axes.plot(begin + times, np.degrees(leg.plan.splines.at(times)[0]))
                begin += total
    elif kind == "PlanResult":
        figure, axes = panel("time [s]", "angle [deg]", f"{result.status} by {result.method}")
        if result.splines is not None and result.certificate is not None:  # else it stays empty
            slides = result.certificate.scene.arm.sliding_joints
            times = np.linspace(0.0, float(result.splines.total[0]), SAMPLES)
            paths = (result.splines.at(times)[0] * np.where(slides, 100.0, np.degrees(1.0))).T
            words = [f"joint {j}{' [cm]' * bool(one)}" for j, one in enumerate(slides, start=1)]
            curves = list(zip([times] * len(words), paths, words, strict=True))
    else:
        figure, axes = panel(
            "time [s]", "position", f"{result.status}: {', '.join(result.effects) or result.aim}"
        )
        for motion in result.runs[:1]:
            step = max(1, len(motion.q) // SAMPLES)
            clock = TICK_S * np.arange(len(motion.q))[::step]
            curves = [
                (clock, one, joint)
                for one, joint in zip(motion.q[::step].T, result.noise, strict=True)
            ]
    for x, y, name in curves:
        axes.plot(x, y, label=name)
    if curves:
        axes.legend(fontsize=7)
    return figure
