"""What the commands print: tables, progress and plain lines."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from ident.console import styled
from ident.errors import visible
from ident.show.palette import rung_name

if TYPE_CHECKING:  # a help text needs none of them
    import numpy as np

    from ident.model.evaluation import SessionScore
    from ident.recordings.recording import TelemetryIssue
    from ident.telemetry.report import JointEffort

COLOURS = {"fatal": "red", "warning": "yellow", "note": "dim"}


def ladder_table(score: SessionScore) -> Table:
    """Energy error and torque RMSE of every rung, in the shape of the paper's table 1."""
    payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
    table = Table(title=f"{score.name}: {len(score.runs)} runs{payload}", title_justify="left")
    table.add_column("model")
    table.add_column("")
    for joint in [*score.joints, "total"]:
        table.add_column(joint, justify="right")
    rows = zip(score.rungs, score.energy_mean, score.energy_std, score.rmse_mean, strict=True)
    for rung, mean, std, rmse in rows:
        table.add_row(rung_name(rung), "energy error [J]", *_pairs(mean, std))
        table.add_row("", "torque RMSE [N m]", *[f"{value:.2f}" for value in rmse], end_section=True)
    return table


def _pairs(mean: Sequence[float] | np.ndarray, std: Sequence[float] | np.ndarray) -> list[str]:
    return [f"{a:.2f} ± {b:.2f}" for a, b in zip(mean, std, strict=True)]


def print_issues(console: Console, issues: Sequence[TelemetryIssue]) -> None:
    """Telemetry issues, the worst first, a line each and the remedy below."""
    for issue in sorted(issues, key=lambda found: list(COLOURS).index(found.severity)):
        colour = COLOURS[issue.severity]
        head = styled((issue.severity, colour), " ", (issue.issue, "bold"), f": {visible(issue.evidence)}")
        console.print(head, soft_wrap=True)
        if issue.severity != "note":
            console.print(f"    remedy: {visible(issue.remedy)}", soft_wrap=True)


def print_effort(console: Console, effort: Sequence[JointEffort]) -> None:
    """What each joint's effort is, a line each."""
    for one in effort:
        console.print(visible(f"effort of {one.joint}: {one.kind} ({one.evidence})"), soft_wrap=True)


@contextmanager
def progress_bar(console: Console, label: str, figure: str = "error") -> Iterator[Callable[[int, int, float], None]]:
    """Lends a callback (done, total, figure): a bar on a terminal, a plain line at every tenth elsewhere."""

    def tail(value: float) -> str:
        return f", {figure} {value:.4f}" if figure else ""

    if not console.is_terminal:
        said = [-1]

        def line(done: int, total: int, error: float) -> None:
            if 10 * done // total > said[0]:
                said[0] = 10 * done // total
                console.print(f"{label}: {done} of {total}{tail(error)}")

        yield line
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn  # slow to load

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeRemainingColumn(), console=console, transient=True) as progress:
        task = progress.add_task(label, total=None)

        def bar(done: int, total: int, error: float) -> None:
            progress.update(task, completed=done, total=total, description=f"{label}{tail(error)}")

        yield bar
