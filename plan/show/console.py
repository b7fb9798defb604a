"""What the commands print: tables, progress and plain lines."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import accumulate
from math import degrees
from typing import TYPE_CHECKING

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
    colour = "green" if result.solved else "red"
    spent = f"{result.evaluations} evaluations, {result.seconds:.2f} s"
    console.print(styled((result.status, colour), f" by {result.method}, {spent}"))
    held = ", ".join(f"{name} at {value:g}" for name, value in result.held.items())
    moved = f"{result.robot}: {', '.join(result.joints)}" + (f"; held: {held}" if held else "")
    console.print(moved, soft_wrap=True, highlight=False)
    for one in result.carried:
        mass = f", {one['mass_kg']:g} kg with its centre at {one['com_m']} m there" if "mass_kg" in one else ""
        console.print(f"carried: {one['name']} on {one['link']}{mass}", soft_wrap=True, highlight=False)
    if result.reason:
        console.print(f"reason: {result.reason}", soft_wrap=True)
    _print_starts(console, result)
    certificate, splines = result.certificate, result.splines
    if not result.solved or certificate is None or splines is None:
        return
    energy = ", ".join(f"{name} {value:.2f}" for name, value in certificate.energy.items() if name != "copper")
    console.print(f"energy [J]: {energy}; copper {certificate.energy['copper']:.1f} N² m² s")
    console.print(f"duration: {float(splines.total[0]):.4f} s")
    for name, share in certificate.shares.items():
        if share is None:
            continue
        console.print(f"peak {name}, share of the limit: {', '.join(f'{value:.3f}' for value in share)}")
    for rule in certificate.rules:
        console.print(str(rule), soft_wrap=True, highlight=False)
    _print_trust(console, certificate)
    _print_clearance(console, certificate)
    if result.reference_gap is not None and result.method != "sqp":
        console.print(f"gap to the default method: {100 * result.reference_gap:+.2f} %")
    stamps = list(accumulate(splines.durations[0]))[:-1]
    if len(stamps) <= 10:
        for stamp, via in zip(stamps, splines.points[0, 1:-1], strict=True):
            console.print(f"  via at {stamp:.4f} s: {', '.join(f'{degrees(angle):.2f}' for angle in via)} deg")
    for note in result.notes:
        console.print(f"note: {note}", soft_wrap=True)


def _print_trust(console: Console, certificate: Certificate) -> None:
    """What executing the motion changes, and how far its model may be believed."""
    law = certificate.time_law
    if law.ramp > 0.0:
        slower = f", slowed down by {100 * (law.stretch - 1.0):.2f} %" if law.stretch > 1.0 else ""
        torque = f"{100 * law.shares[0]:.1f} % of the torque limits"
        energy = "".join(f", {value:.2f} J {name}" for name, value in law.energy if name == "absolute")
        console.print(f"executed from rest to rest: {law.duration:.4f} s{slower}, {torque}{energy}")
    if certificate.energy_half_width is not None:
        half = f"± {certificate.energy_half_width:.2g} J"
        console.print(f"energy as executed is known to {half} (95 %, from the intervals of the model's torque)")
    if certificate.reserve is not None:
        known = ", ".join(f"{value:.2f}" for value in certificate.reserve)
        console.print(f"torque set aside for the model's doubt [N m]: {known}", soft_wrap=True)
    for one in certificate.extrapolation or ():
        console.print(f"beyond the model's training: {one!s}", soft_wrap=True)


def _print_clearance(console: Console, certificate: Certificate) -> None:
    """What is proven, for which shapes, and of which pairs nothing is said."""
    clearance = certificate.clearance
    if not clearance.checked:
        console.print("clearance: nothing to hit, so nothing was looked at")
    else:
        place = f"({clearance.pair}, {clearance.time:.3f} s)"
        console.print(
            f"clearance: {1000 * clearance.proven:.1f} mm, proven between samples too {place}", soft_wrap=True
        )
    for line in certificate.limits_of_proof:
        console.print(f"  {line}", soft_wrap=True)


def _print_starts(console: Console, result: PlanResult) -> None:
    if len(result.starts) < 2:
        return
    table = Table(title="initial trajectories", title_justify="left")
    for name in ("start", f"cost reached [{UNITS[result.objective]}]", "reason"):
        table.add_column(name)
    for record in result.starts:
        cost, reason = record.get("cost"), record["reason"]
        if "violation" in record and cost is None:
            reason = reason or "not made feasible"
        table.add_row(record["label"], "" if cost is None else f"{cost:.3f}", reason)
    console.print(table)


def print_comparison(console: Console, comparison: Comparison) -> None:
    """Medians over the seeds, a row a method."""
    unit = UNITS[comparison.objective]
    table = Table(title=f"{comparison.name}: medians over the seeds", title_justify="left")
    columns = (
        "method",
        "solved",
        f"cost [{unit}]",
        "executed",
        "worst",
        f"at {comparison.evaluations} evaluations",
        f"at {comparison.seconds:g} s",
        "evaluations",
        "time [s]",
        "clearance [mm]",
        "above the best [%]",
    )
    for name in columns:
        table.add_column(name, justify="left" if name == "method" else "right")
    for row in comparison.rows():
        clear = "" if row["clearance_m"] is None else f"{1000 * row['clearance_m']:.1f}"
        table.add_row(
            row["method"],
            f"{row['solved']}/{row['runs']}",
            *(_number(row[key]) for key in ("cost", "executed", "worst", "cost_at_evaluations", "cost_at_seconds")),
            str(row["evaluations"]),
            f"{row['seconds']:.2f}",
            clear,
            "" if row["above_best"] is None else f"{100 * row['above_best']:.2f}",
        )
    console.print(table)


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.4g}"
