"""Pictures as inline SVG by matplotlib's objects: small panels that a page lays out by its own
width.
"""

from __future__ import annotations

import io
import itertools
import re
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.text import Text

from ident.arrays import Array, Float
from ident.show.palette import GRID, INK, OF_THE_PAGE

PANEL = (3.5, 1.75)  # [inch]
WIDE = (5.0, 2.4)
# More points than this on a line can't be seen in a panel.
MOST_POINTS = 500
# Text stays text: the page's own font is used, and the page stays small and can be searched.
SVG_SETTINGS: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "armgap",
    "path.simplify": True,
    # which would start LaTeX, in a program that draws its own pictures so
    "text.usetex": False,
}
_counter = itertools.count()


def make_panel(
    x_label: str,
    y_label: str,
    size: tuple[float, float] = PANEL,
    left: float = 0.6,
    bottom: float = 0.42,
) -> tuple[Figure, Axes]:
    """An empty panel with labelled axes and a light grid."""
    width, height = size
    figure = Figure(figsize=size)
    FigureCanvasSVG(figure)
    axes = figure.add_axes(
        (left / width, bottom / height, 1 - (left + 0.1) / width, 1 - (bottom + 0.1) / height)
    )
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_color(INK)
        axes.spines[side].set_linewidth(0.6)
    axes.grid(axis="y", color=GRID, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=8, width=0.6, length=2.5, colors=INK, pad=2)
    axes.locator_params(axis="y", nbins=5)
    axes.set_xlabel(x_label, fontsize=8, color=INK, labelpad=2)
    axes.set_ylabel(y_label, fontsize=8, color=INK, labelpad=3)
    return figure, axes


def to_svg(figure: Figure, description: str) -> Markup:
    """The figure as an inline SVG element that fills its column."""
    buffer = io.StringIO()
    for written in figure.findobj(Text):  # a joint's name is no formula, whatever signs are in it
        written.set_parse_math(False)
        written.set_usetex(False)
    with mpl.rc_context(SVG_SETTINGS):
        figure.savefig(buffer, format="svg", metadata={"Date": None}, transparent=True)
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    text = re.sub(r"(font: [\d.]+px )[^;\"]*", r"\1sans-serif", text)
    text = re.sub(
        r"-?\d+\.\d{3,}", lambda number: f"{float(number[0]):.2f}".rstrip("0").rstrip("."), text
    )
    # Ink and grid are the page's own: they turn with its dark mode.
    for drawn, of_page in OF_THE_PAGE.items():
        text = text.replace(drawn, of_page)
    # Names unlike those of the page's other pictures; those that nobody uses are dropped.
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', text))
    prefix = f"f{next(_counter)}-"

    def renamed(name: re.Match[str]) -> str:
        return f' id="{prefix}{name[1]}"' if name[1] in used else ""

    text = re.sub(r' id="([^"]+)"', renamed, text)
    text = re.sub(r'(url\(|href=")#', rf"\1#{prefix}", text)
    view_box = re.search(r'viewBox="[^"]*"', text)
    assert view_box is not None
    label = escape(description)
    xlink = 'xmlns:xlink="http://www.w3.org/1999/xlink"'
    head = f'<svg role="img" aria-label="{label}" {view_box[0]} {xlink}>'
    body = re.sub(r"\n\s*", "\n", text[text.index(">") + 1 :])
    return Markup(head + body.strip())


def thin(
    x: Float[Array, " T"], y: Float[Array, " T"], most: int = MOST_POINTS
) -> tuple[Array, Array]:
    """Fewer points that look the same: the lowest and the highest of each bin, in their order.

    Args:
        x: Where the points are.
        y: Their values.
        most: Points that may be left; fewer are given back as they are.
    """
    if len(x) <= most:
        return x, y
    bins = np.array_split(np.arange(len(x)), most // 2)
    ends = []
    for rows in bins:
        ends.append(rows[np.argmin(y[rows])])
        ends.append(rows[np.argmax(y[rows])])
    shown = np.unique(ends)
    return x[shown], y[shown]


def envelope(
    x: Float[Array, " T"], y: Float[Array, " T"], bins: int = 240
) -> tuple[Array, Array, Array]:
    """Centre, least and largest value in bins of x; what is not a number is left out, and bins of
    nothing else too.
    """
    end = np.nextafter(x[-1], np.inf)
    edges = np.linspace(x[0], end, min(bins, len(x)) + 1)
    count = len(edges) - 1
    which = np.clip(np.digitize(x, edges) - 1, 0, count - 1)
    low = np.full(count, np.inf)
    high = np.full(count, -np.inf)
    there = np.isfinite(y)
    np.minimum.at(low, which[there], y[there])
    np.maximum.at(high, which[there], y[there])
    empty = ~np.isfinite(low)
    low[empty] = np.nan
    high[empty] = np.nan
    return (edges[:-1] + edges[1:]) / 2, low, high


def binned(
    x: Float[Array, " T"], y: Float[Array, " T"], edges: Sequence[float] | Array, least: int = 5
) -> Array:
    """Centre, 10 % quantile, median and 90 % quantile of y in bins of x, shape (bins, 4); thin bins
    left out.

    Args:
        x: What is binned.
        y: Its values.
        edges: Of the bins, rising.
        least: Samples that a bin needs.
    """
    which = np.digitize(x, edges) - 1
    rows = []
    for k in range(len(edges) - 1):
        inside = which == k
        if inside.sum() >= least:
            centre = np.median(x[inside])
            quantiles = np.quantile(y[inside], (0.1, 0.5, 0.9))
            rows.append([centre, *quantiles])
    return np.array(rows).reshape(-1, 4)
