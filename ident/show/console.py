"""What the commands print: tables, progress and plain lines."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.console import Console, ConsoleOptions
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from ident.console import styled
from ident.errors import plural, visible
from ident.progress import listening
from ident.show.palette import rung_name

if TYPE_CHECKING:  # a help text needs none of them
    from ident.model.evaluation import SessionScore
    from ident.recordings.recording import TelemetryIssue

# As wide as a table would like to be [columns].
WIDEST = 10_000
# In a log lines are so far apart [s]; from so long on, time is given in minutes [s].
BETWEEN_LINES, LONG = 5.0, 120.0
COLOURS = {"fatal": "red", "warning": "yellow", "note": "dim"}


@dataclass(frozen=True, eq=False)
class LadderTable:
    """Energy and torque error of every rung: as the paper's table 1 where a line holds it, else a joint a line."""

    score: SessionScore

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Table]:
        wide = self._wide()
        fits = Measurement.get(console, options.update(width=WIDEST), wide).maximum <= options.max_width
        yield wide if fits else self._tall()

    def _begin(self, *columns: str) -> Table:
        score = self.score
        payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
        table = Table(title=f"{score.name}: {plural(len(score.runs), 'run')}{payload}", title_justify="left")
        for column, justify in zip(columns, ("left", "left", *["right"] * len(columns)), strict=False):
            table.add_column(column, justify=justify)  # type: ignore[arg-type]
        return table

    def _rows(self) -> Iterator[tuple[str, list[str], list[str]]]:
        """Each rung with its energy errors and torque errors, joint by joint and in all."""
        score = self.score
        for rung, mean, std, rmse in zip(
            score.rungs, score.energy_mean, score.energy_std, score.rmse_mean, strict=True
        ):
            pairs = [f"{a:.2f} ± {b:.2f}" for a, b in zip(mean, std, strict=True)]
            yield rung_name(rung), pairs, [f"{value:.2f}" for value in rmse]

    def _wide(self) -> Table:
        table = self._begin("model", "", *self.score.joints, "total")
        for rung, energy, torque in self._rows():
            table.add_row(rung, "energy error [J]", *energy)
            table.add_row("", "torque RMSE [N m]", *torque, end_section=True)
        return table

    def _tall(self) -> Table:
        table = self._begin("model", "joint", "energy error [J]", "torque RMSE [N m]")
        for rung, energy, torque in self._rows():
            for joint, *cells in zip([*self.score.joints, "total"], energy, torque, strict=True):
                table.add_row(rung, joint, *cells, end_section=joint == "total")
                rung = ""
        return table


def print_issues(console: Console, issues: Sequence[TelemetryIssue]) -> None:
    """Telemetry issues, the worst first, a line each and the remedy below."""
    for issue in sorted(issues, key=lambda found: list(COLOURS).index(found.severity)):
        kind = (issue.severity, COLOURS[issue.severity])
        head = styled(kind, " ", (issue.issue, "bold"), f": {visible(issue.evidence)}")
        console.print(head, soft_wrap=True)
        if issue.severity != "note":
            console.print(f"    remedy: {visible(issue.remedy)}", soft_wrap=True)


def print_serious(console: Console, issues: Sequence[Mapping[str, Any]]) -> None:
    """Records of telemetry issues, those aside that are notes, a line each."""
    for one in issues:
        if one["severity"] != "note":
            words = f"{one['severity']}: {one['issue']}: {one['evidence']}; {one['remedy']}"
            console.print(words, soft_wrap=True)


@contextmanager
def progress_line(console: Console, job: str, clock: Callable[[], float] = time.monotonic) -> Iterator[None]:
    """Shows how far a job has come: one line, rewritten, on a terminal; elsewhere now and then a line."""
    shown, last = clock(), ""

    def log(stage: str, share: float, left: float | None) -> None:
        nonlocal shown, last
        if clock() - shown >= BETWEEN_LINES and (words := progress_words(job, stage, share, left)) != last:
            shown, last = clock(), words
            console.print(words, soft_wrap=True)

    if not console.is_terminal:
        with listening(log, clock):
            yield
        return
    from rich.live import Live  # slow to load

    with Live(console=console, transient=True, auto_refresh=False) as live:

        def rewrite(stage: str, share: float, left: float | None) -> None:
            words = Text(progress_words(job, stage, share, left), no_wrap=True, overflow="ellipsis")
            live.update(words, refresh=True)

        with listening(rewrite, clock):
            yield


def progress_words(job: str, stage: str, share: float, left: float | None) -> str:
    """Such as: `diagnose: 40 %, searching, 12 s left`."""
    ends = "" if left is None else f", {left:.0f} s left" if left < LONG else f", {left / 60.0:.0f} min left"
    return f"{job}: {100.0 * share:.0f} %{', ' if stage else ''}{stage}{ends}"
