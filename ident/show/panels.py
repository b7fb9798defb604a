"""The parts of which results make their words and pictures, for Python and notebooks."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from html import escape
from io import StringIO
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console

from ident.console import WIDE, PlainConsole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PANEL = (6.0, 3.0)  # [inch]


def framed(page: str) -> str:
    """A whole page within another, as high as a screen; its style and its links stay its own."""
    return f'<iframe srcdoc="{escape(page)}" style="width:100%;height:36rem;border:0" title="armgap"></iframe>'


def words_and_picture(lines: str, figure: Figure) -> str:
    """Plain lines and a picture as one piece of HTML that stands for itself."""
    from ident.show.report.figures import to_svg

    title = lines.strip().splitlines()[0] if lines.strip() else "result"
    return f'<div class="armgap"><pre>{escape(lines)}</pre>{to_svg(figure, title)}</div>'


def as_text(write: Callable[[Console], None]) -> str:
    """What is printed, as text without colours."""
    stream = StringIO()
    write(PlainConsole(file=stream, width=WIDE, color_system=None, markup=False, emoji=False, highlight=False))
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
    names: Sequence[str], rows: Mapping[str, tuple[str, Sequence[float | None]]], label: str, title: str
) -> Figure:
    """Bars side by side, a group a name; a value that is None has none."""
    figure, axes = panel("", label, title)
    width = 0.8 / max(1, len(rows))
    places = np.arange(len(names))
    for k, (words, (colour, values)) in enumerate(rows.items()):
        heights = [0.0 if value is None else float(value) for value in values]
        axes.bar(places + (k - (len(rows) - 1) / 2) * width, heights, width, color=colour, label=words)
    axes.set_xticks(places, names, rotation=30 if len(names) > 4 else 0, fontsize=7)
    if rows:
        axes.legend(fontsize=7)
    return figure
