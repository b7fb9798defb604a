"""What the commands print, tables, progress and plain lines, and where: names from files give a
terminal no orders.
"""

from __future__ import annotations

import math
import re
import textwrap
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ident.errors import LINE_TO_WRITE, plural, visible
from ident.progress import listening
from ident.show.palette import rung_name

if TYPE_CHECKING:  # a help text needs none of them
    from ident.model.evaluation import SessionScore

# Where output is no terminal there is no edge: lines are this long [columns].
WIDE = 160
# In a log lines are so far apart [s]; from so long on, time is given in minutes [s].
BETWEEN_LINES = 5.0
LONG = 120.0
COLOURS = {"fatal": "red", "warning": "yellow", "note": "dim"}
# Sentences are not longer than this, however wide a terminal is: longer lines are hard to read
# [columns].
TEXT_WIDTH = 80
# What is not broken over lines: commands in backquotes, and a number with its unit.
UNBROKEN = re.compile(
    r"`[^`]*`|(?<=\d) (?=N m|kg|rad|J|s\b|%|Hz|±)|(?<=±) (?=\d)|(?<=N) (?=m\b|s/)|(?<=m) (?=s/rad)"
)
GLUE = "\x00"


class PlainConsole(Console):
    """A console without markup: `[x]`, `:x:` and control characters in a text are part of it. Style
    by `styled`.
    """

    def render_str(self, text: str, **options: Any) -> Text:
        return super().render_str(visible(text, lines=True), **options)


def make_console() -> PlainConsole:
    """Standard output; wide where it is no terminal."""
    console = PlainConsole(markup=False, emoji=False)
    return console if console.is_terminal else PlainConsole(markup=False, emoji=False, width=WIDE)


def styled(*parts: str | tuple[str, str]) -> Text:
    """A text of plain parts and (part, style) pairs."""
    shown = (
        visible(words, lines=True) if isinstance(words, str) else (visible(words[0]), words[1])
        for words in parts
    )
    return Text.assemble(*shown)


def ladder_table(score: SessionScore) -> Table:
    """Energy and torque error of every rung, a joint a line."""
    from ident.show.report.words import fixed, pair  # a help text needs none of them

    payload = f", {1000 * score.payload_kg:.0f} g at the flange" if score.payload_kg else ""
    several = len(score.runs) > 1
    title = f"{score.name}: {plural(len(score.runs), 'run')}{payload}"
    table = Table("model", title=title, title_justify="left")
    table.add_column("joint", overflow="fold")  # names that begin alike stay apart
    for column in ("energy error [J]", "torque RMSE [N m]"):
        table.add_column(column, justify="right")
    for k, name in enumerate(score.rungs):
        rung = rung_name(name)
        for j, joint in enumerate([*score.joints, "total"]):
            spread = score.energy_std[k, j] if several else None
            energy = pair(score.energy_mean[k, j], spread, 2)
            torque = fixed(score.rmse_mean[k, j])
            table.add_row(rung, joint, energy, torque, end_section=joint == "total")
            rung = ""
    return table


def print_issues(
    console: Console, issues: Sequence[Mapping[str, Any]], least: str = "note"
) -> None:
    """Records of telemetry issues, the worst first and none below a severity, a line each and the
    remedy below.
    """
    order = list(COLOURS)
    for issue in sorted(issues, key=lambda record: order.index(record["severity"])):
        kind = issue["severity"]
        if order.index(kind) > order.index(least):
            continue
        name = issue["issue"]
        text = visible(f"{kind} {name}: {issue['evidence']}")
        head = Text(wrap(text, text_width(console), "", "    "))
        head.stylize(COLOURS[kind], 0, len(kind))
        begin = len(kind) + 1
        head.stylize("bold", begin, begin + len(name))
        console.print(head, soft_wrap=True, highlight=False)
        if kind != "note":
            say_remedy(console, f"remedy: {issue['remedy']}", "    ")


@contextmanager
def progress_line(
    console: Console, job: str, clock: Callable[[], float] = time.monotonic
) -> Iterator[None]:
    """Shows how far a job has come: one line, rewritten, on a terminal; elsewhere now and then a
    line.
    """
    shown = clock()
    last = ""

    def log(stage: str, share: float, left: float | None) -> None:
        nonlocal shown, last
        if clock() - shown < BETWEEN_LINES:
            return
        words = progress_words(job, stage, share, left)
        if words != last:
            shown = clock()
            last = words
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
    """How far a job has come: `diagnose: 40 %, searching, 12 s left`.

    Args:
        job: The command's name.
        stage: What it does; may be empty.
        share: Done of it, 0 to 1.
        left: Time that is left [s]; None says nothing of it.
    """
    words = f"{job}: {100.0 * share:.0f} %"
    if stage:
        words += f", {stage}"
    if left is None:
        return words
    if left < LONG:
        return f"{words}, {left:.0f} s left"
    return f"{words}, {left / 60.0:.0f} min left"


def wrap(text: str, width: int, indent: str = "", hanging: str | None = None) -> str:
    """A text over lines of a width, commands and numbers with their units whole.

    Args:
        text: One paragraph.
        width: Columns; a command that is longer stands on a line of its own.
        indent: What stands before the first line.
        hanging: What stands before the others; as `indent` if None.
    """
    glued = UNBROKEN.sub(lambda unbroken: unbroken[0].replace(" ", GLUE), text)
    lines = textwrap.fill(
        glued,
        width,
        initial_indent=indent,
        subsequent_indent=indent if hanging is None else hanging,
        break_long_words=False,
        break_on_hyphens=False,
    )
    return lines.replace(GLUE, " ")


def text_width(console: Console) -> int:
    """Columns of a sentence: the terminal's, `TEXT_WIDTH` at most."""
    return min(console.width, TEXT_WIDTH)


def say(
    console: Console, text: str, indent: str = "", hanging: str | None = None, style: str = ""
) -> None:
    """Prints a paragraph, wrapped."""
    lines = wrap(visible(text), text_width(console), indent, hanging)
    console.print(Text(lines, style=style), soft_wrap=True, highlight=False)


def say_remedy(console: Console, text: str, indent: str = "") -> None:
    """Prints a paragraph; lines of a settings file stand in it by themselves, unbroken, to be
    pasted.
    """
    hanging = f"{indent}  "
    for number, words in enumerate(LINE_TO_WRITE.split(text)):
        if number % 2:
            console.print(f"{hanging}{visible(words)}", soft_wrap=True, highlight=False)
        elif words.strip():
            say(console, words.strip(), indent if number == 0 else hanging, hanging)


def columns(table: Sequence[Sequence[str]], sides: str, longest: float = math.inf) -> list[str]:
    """Lines of a table whose columns are as wide as their longest cell.

    Where a line would be longer than `longest`, what its first column says stands above it.

    Args:
        table: Rows of cells.
        sides: `l` or `r` for the side that each column stands at.
        longest: Columns of the terminal.
    """
    lines = _aligned(table, sides, "  ")
    if max(map(len, lines)) <= longest:
        return lines
    others = _aligned([row[1:] for row in table], sides[1:], "      ")
    parted = []
    for row, line in zip(table, others, strict=True):
        if row[0]:
            parted.append(f"  {row[0]}")
        parted.append(line)
    return parted


def _aligned(table: Sequence[Sequence[str]], sides: str, indent: str) -> list[str]:
    """Lines of a table whose columns are as wide as their longest cell."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    lines = []
    for row in table:
        padded = []
        for cell, width, side in zip(row, widths, sides, strict=True):
            padded.append(cell.rjust(width) if side == "r" else cell.ljust(width))
        lines.append((indent + "   ".join(padded)).rstrip())
    return lines


def say_lines(console: Console, text: str) -> None:
    """Prints lines as they stand; those that are longer than a sentence may be are wrapped."""
    for line in text.splitlines():
        if len(line) <= text_width(console):
            console.print(visible(line), soft_wrap=True, highlight=False)
        else:
            indent = line[: len(line) - len(line.lstrip())]
            say(console, line.strip(), indent, f"{indent}  ")
