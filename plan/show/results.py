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

from ident.arrays import Array
from ident.show.console import say_lines, styled
from plan.problem.scene_keys import as_given

# Each result is known by its name: none of them needs what the others are made of.
if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from plan.experiment.result import Excitation
    from plan.problem.cycle_result import CycleResult
    from plan.problem.result import PlanResult
    from plan.solving.compare import Comparison

SAMPLES = 300
# Odds beyond these are told as such.
MOST_ODDS = 1e6
# The family of motions that answers no question of its own, in words.
SERIES = "all joints by a Fourier series about a pose"
UNITS = {"energy": "J", "time": "s"}
LINES = Path(__file__).with_name("lines.jinja")


Curve = tuple[Array, Array, str]
"""Times [s], values, and what they are of."""


def write(console: Console, result: PlanResult | CycleResult | Comparison | Excitation) -> None:
    """Prints a result in plain lines and tables, as the command does."""
    WRITERS[type(result).__name__](console, result)


def _say(console: Console, kind: str, result: object, *more: object, **given: object) -> None:
    """Prints what the template's macro of a kind of result makes of it."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(line_statement_prefix="%", undefined=StrictUndefined)
    template = environment.from_string(LINES.read_text(encoding="utf-8"), given)
    lines = getattr(template.module, kind)(result, *more).splitlines()
    say_lines(console, "\n".join(line for line in lines if line.strip()))


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
        words = []
        for point in points:
            positions = zip(point, slides, strict=True)
            words.append(", ".join(as_given(q, bool(is_slide), 2) for q, is_slide in positions))
        if not slides.any():
            words = [word.replace(" deg,", ",") for word in words]
        vias = list(zip(stamps, words, strict=True))
    _say(console, "plan", result, vias=vias)
    if len(result.starts) > 1:
        table = Table(title="initial trajectories", title_justify="left")
        for name in ("start", f"cost reached [{UNITS[result.objective]}]", "reason"):
            table.add_column(name)
        for start in result.starts:
            cost = start.get("cost")
            failed = "not made feasible" if "violation" in start and cost is None else ""
            reached = "" if cost is None else f"{cost:.3f}"
            table.add_row(start["label"], reached, start["reason"] or failed)
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
        known: dict[str, object] = {}
        for name, value in row.items():
            known[name] = float("nan") if value is None else value
        clearance = row["clearance_m"]
        above = row["above_best"]
        known["clearance_mm"] = float("nan") if clearance is None else 1000 * clearance
        known["above_percent"] = float("nan") if above is None else 100 * above
        cells = [text.format(**known).replace("nan", "–") for text in columns.values()]
        table.add_row(*cells)
    console.print(table)


def _print_motion(console: Console, excitation: Excitation) -> None:
    """The set-up where it must change, the motion, what it tells, and what random motion would."""
    from ident.effects.effect_info import describe_motion
    from ident.errors import plural
    from plan.experiment.result import odds_of

    odds = []
    for distance in excitation.smallest:
        ratio = odds_of(distance)
        odds.append("over 10⁶ : 1" if ratio > MOST_ODDS else f"{ratio:.3g} : 1")
    family = excitation.run_set.family
    motion = SERIES if family == "fourier" else describe_motion(family, excitation.joint)
    _say(console, "motion", excitation, motion, plural(len(excitation.runs), "run"), odds)


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

    kind = type(result).__name__
    if kind == "Comparison":
        from plan.show.pictures import draw_comparison

        return draw_comparison(result)
    if kind == "CycleResult":
        title = f"{result.status}: {len(result.legs)} motions"
        figure, axes = panel("time [s]", "angle [deg]", title)
        begin = 0.0
        for leg in result.legs:
            if leg.plan.splines is not None:
                total = float(leg.plan.splines.total[0])
                times = np.linspace(0.0, total, SAMPLES)
                axes.plot(begin + times, np.degrees(leg.plan.splines.at(times)[0]))
                begin += total
        return figure
    if kind == "PlanResult":
        figure, axes = panel("time [s]", "angle [deg]", f"{result.status} by {result.method}")
        curves = _plan_curves(result)
    else:
        title = f"{result.status}: {', '.join(result.effects) or result.aim}"
        figure, axes = panel("time [s]", "position", title)
        curves = _motion_curves(result)
    for times, values, name in curves:
        axes.plot(times, values, label=name)
    if curves:
        axes.legend(fontsize=7)
    return figure


def _plan_curves(result: PlanResult) -> list[Curve]:
    """Angles [deg] of a plan's joints, of those that slide positions [cm]; none without a plan."""
    if result.splines is None or result.certificate is None:
        return []
    slides = result.certificate.scene.arm.sliding_joints
    times = np.linspace(0.0, float(result.splines.total[0]), SAMPLES)
    paths = result.splines.at(times)[0] * np.where(slides, 100.0, np.degrees(1.0))
    curves = []
    for number, is_slide in enumerate(slides, start=1):
        name = f"joint {number} [cm]" if is_slide else f"joint {number}"
        curves.append((times, paths[:, number - 1], name))
    return curves


def _motion_curves(result: Excitation) -> list[Curve]:
    """Positions of the joints in a motion's first run."""
    from ident.trajectories.reference import TICK_S

    curves: list[Curve] = []
    for motion in result.runs[:1]:
        step = max(1, len(motion.q) // SAMPLES)
        times = TICK_S * np.arange(len(motion.q))[::step]
        for path, joint in zip(motion.q[::step].T, result.noise, strict=True):
            curves.append((times, path, joint))
    return curves
