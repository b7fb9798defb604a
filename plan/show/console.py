"""What the commands print: tables, progress and plain lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import accumulate
from math import degrees
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from ident.console import styled

if TYPE_CHECKING:  # a help text needs none of them
    from plan.planners.base import Progress as Callback
    from plan.problem.result import Certificate, PlanResult
    from plan.solving.compare import Comparison

UNITS = {"energy": "J", "time": "s"}


@contextmanager
def progress_bar(console: Console, label: str) -> Iterator[Callback]:
    """Lends a callback (evaluations, allowed, best cost): a bar on a terminal, lines at powers of ten elsewhere."""
    if not console.is_terminal:
        said = [1000]

        def line(done: int, total: int, cost: float) -> None:
            if done >= said[0]:
                said[0] *= 10
                console.print(f"{label}: {done} evaluations, best {cost:.4g}")

        yield line
        return
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.completed}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(label, total=None)

        def bar(done: int, total: int, cost: float) -> None:
            progress.update(task, completed=done, description=f"{label} (best {cost:.4g})")

        yield bar


def print_result(console: Console, result: PlanResult) -> None:
    """A plan and its certificate, or why there is none."""
    say = partial(console.print, soft_wrap=True)
    colour = "green" if result.solved else "red"
    say(
        styled(
            (result.status, colour), f" by {result.method}, {result.evaluations} evaluations, {result.seconds:.2f} s"
        )
    )
    held = ", ".join(f"{name} at {value:g}" for name, value in result.held.items())
    say(f"{result.robot}: {', '.join(result.joints)}" + (f"; held: {held}" if held else ""), highlight=False)
    for one in result.carried:
        mass = f", {one['mass_kg']:g} kg with its centre at {one['com_m']} m there" if "mass_kg" in one else ""
        say(f"carried: {one['name']} on {one['link']}{mass}", highlight=False)
    if result.reason:
        say(f"reason: {result.reason}")
    if len(result.starts) > 1:
        table = Table(title="initial trajectories", title_justify="left")
        for name in ("start", f"cost reached [{UNITS[result.objective]}]", "reason"):
            table.add_column(name)
        for start in result.starts:
            cost = start.get("cost")
            failed = "not made feasible" if "violation" in start and cost is None else ""
            table.add_row(start["label"], "" if cost is None else f"{cost:.3f}", start["reason"] or failed)
        console.print(table)
    certificate, splines = result.certificate, result.splines
    if not result.solved or certificate is None or splines is None:
        return
    energy = ", ".join(f"{name} {value:.2f}" for name, value in certificate.energy.items() if name != "copper")
    say(f"energy [J]: {energy}; copper {certificate.energy['copper']:.1f} N² m² s")
    say(f"duration: {float(splines.total[0]):.4f} s")
    for name, share in certificate.shares.items():
        if share is not None:
            say(f"peak {name}, share of the limit: {', '.join(f'{value:.3f}' for value in share)}")
    for rule in certificate.rules:
        say(str(rule), highlight=False)
    for line in _trust(certificate):
        say(line)
    if result.reference_gap is not None and result.method != "sqp":
        say(f"gap to the default method: {100 * result.reference_gap:+.2f} %")
    stamps = list(accumulate(splines.durations[0]))[:-1]
    if len(stamps) <= 10:
        for stamp, via in zip(stamps, splines.points[0, 1:-1], strict=True):
            say(f"  via at {stamp:.4f} s: {', '.join(f'{degrees(angle):.2f}' for angle in via)} deg")
    for note in result.notes:
        say(f"note: {note}")


def _trust(certificate: Certificate) -> Iterator[str]:
    """What executing the motion changes, how far its model may be believed, and what is proven for which shapes."""
    law, clearance = certificate.time_law, certificate.clearance
    if law.ramp > 0.0:
        slower = f", slowed down by {100 * (law.stretch - 1.0):.2f} %" if law.stretch > 1.0 else ""
        torque = f"{100 * law.shares[0]:.1f} % of the torque limits"
        energy = "".join(f", {value:.2f} J {name}" for name, value in law.energy if name == "absolute")
        yield f"executed from rest to rest: {law.duration:.4f} s{slower}, {torque}{energy}"
    if certificate.energy_half_width is not None:
        half = f"± {certificate.energy_half_width:.2g} J"
        yield f"energy as executed is known to {half} (95 %, from the intervals of the model's torque)"
    if certificate.reserve is not None:
        known = ", ".join(f"{value:.2f}" for value in certificate.reserve)
        yield f"torque set aside for the model's doubt [N m]: {known}"
    yield from (f"beyond the model's training: {one!s}" for one in certificate.extrapolation or ())
    if clearance.checked:
        place = f"({clearance.pair}, {clearance.time:.3f} s)"
        yield f"clearance: {1000 * clearance.proven:.1f} mm, proven between samples too {place}"
    else:
        yield "clearance: nothing to hit, so nothing was looked at"
    yield from (f"  {line}" for line in certificate.scene.limits_of_proof)


def print_comparison(console: Console, comparison: Comparison) -> None:
    """Medians over the seeds, a row a method."""
    table = Table(title=f"{comparison.name}: medians over the seeds", title_justify="left")
    columns: dict[str, Callable[[dict[str, Any]], str]] = {
        "method": lambda row: str(row["method"]),
        "solved": lambda row: f"{row['solved']}/{row['runs']}",
        f"cost [{UNITS[comparison.objective]}]": lambda row: _number(row["cost"]),
        "executed": lambda row: _number(row["executed"]),
        "worst": lambda row: _number(row["worst"]),
        f"at {comparison.evaluations} evaluations": lambda row: _number(row["cost_at_evaluations"]),
        f"at {comparison.seconds:g} s": lambda row: _number(row["cost_at_seconds"]),
        "evaluations": lambda row: str(row["evaluations"]),
        "time [s]": lambda row: f"{row['seconds']:.2f}",
        "clearance [mm]": lambda row: "" if row["clearance_m"] is None else f"{1000 * row['clearance_m']:.1f}",
        "above the best [%]": lambda row: "" if row["above_best"] is None else f"{100 * row['above_best']:.2f}",
    }
    for name in columns:
        table.add_column(name, justify="left" if name == "method" else "right")
    for row in comparison.rows():
        table.add_row(*(cell(row) for cell in columns.values()))
    console.print(table)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
