"""Pictures of how sure armgap is, drawn from docs/figures.toml beside this file.

python docs/draw_figures.py
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.show.palette import FLEXIBLE, NAMED, ORANGE, SKY, TUNED, UNTUNED

HERE = Path(__file__).parent
RIGHT = NAMED
WRONG = TUNED
PLAIN = FLEXIBLE
SILENT = "#b0b0b0"
LINE = "#555555"
TOOLS = (NAMED, SKY, ORANGE, UNTUNED, "#999999")
WIDTH = 7.2  # [inch]
# Text stays text, and two drawings of the same numbers are the same file.
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "armgap",
    "font.family": "sans-serif",
    "font.size": 9,
}


def make_axes(height: float) -> tuple[Figure, Axes]:
    """An empty picture on white, for pages of any colour [inch]."""
    figure = Figure(figsize=(WIDTH, height), layout="constrained", facecolor="white")
    axes = figure.add_subplot()
    axes.spines[["top", "right"]].set_visible(False)
    return figure, axes


def save(figure: Figure, name: str) -> None:
    """Writes one picture beside this file."""
    with mpl.rc_context(STYLE):
        figure.savefig(HERE / name, metadata={"Date": None, "Title": "armgap"})


def draw_outcomes(data: dict[str, Any]) -> Figure:
    """Of each kind of recording how many answers were right, silent and wrong."""
    names = [row[0] for row in data["outcomes"]]
    counts = np.array([row[1:] for row in data["outcomes"]], dtype=float)
    figure, axes = make_axes(2.4)
    places = np.arange(len(names))[::-1]
    left = np.zeros(len(names))
    shares = 100.0 * counts / counts.sum(axis=1, keepdims=True)
    kinds = (("right, or rightly no name", RIGHT), ("no name", SILENT), ("wrong name", WRONG))
    for k, (words, colour) in enumerate(kinds):
        axes.barh(places, shares[:, k], left=left, color=colour, height=0.6, label=words)
        for place, start, share, count in zip(places, left, shares[:, k], counts[:, k], strict=True):
            if count:
                ink = "black" if colour == SILENT else "white"
                axes.text(start + share / 2, place, f"{count:.0f}", ha="center", va="center", color=ink)
        left += shares[:, k]
    axes.set_yticks(places, names)
    axes.set_xlim(0.0, 100.0)
    axes.set_xlabel("share of the recordings [%]; numbers: recordings")
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    return figure


def draw_calibration(data: dict[str, Any]) -> Figure:
    """How often names were right, over how sure armgap was of them."""
    said, right, count = (np.array(column, dtype=float) for column in zip(*data["calibration"], strict=True))
    figure, axes = make_axes(2.8)
    axes.plot([0, 100], [0, 100], color=LINE, linewidth=0.8, linestyle="--", label="as often as it says")
    spread = 100.0 * np.sqrt(np.maximum(right * (1.0 - right), 0.25 / count) / count)
    axes.errorbar(
        100 * said,
        100 * right,
        2 * spread,
        fmt="o",
        color=PLAIN,
        capsize=3,
        label="measured, ± 2 σ",
    )
    axes.set_xlim(-2.0, 102.0)
    axes.set_ylim(-2.0, 105.0)
    axes.set_xlabel("armgap says: so sure [%]")
    axes.set_ylabel("was right [%]")
    axes.legend(frameon=False, loc="upper left")
    return figure


def draw_fits(data: dict[str, Any]) -> Figure:
    """Each tool's error over that of the worst, recording by recording."""
    errors = np.array([[_number(cell) for cell in row[1:]] for row in data["rows"]])
    shares = 100.0 * errors / errors.max(axis=1, keepdims=True)
    figure, axes = make_axes(3.6)
    places = np.arange(len(errors))[::-1]
    tools = [name.replace("`", "") for name in data["columns"][1:]]
    height = 0.8 / len(tools)
    for k, (tool, colour) in enumerate(zip(tools, TOOLS, strict=True)):
        axes.barh(places + (2 - k) * height, shares[:, k], height, color=colour, label=tool)
    axes.set_yticks(places, [row[0] for row in data["rows"]])
    axes.set_xlabel("error on runs that no fit saw, of the worst tool's [%]: shorter is better")
    figure.legend(loc="outside upper center", ncols=5, frameon=False, fontsize=8)
    return figure


def _number(cell: str) -> float:
    """The first number of a cell."""
    return float(re.findall(r"\d+\.?\d*", cell)[0])


def main(names: Sequence[str] = ()) -> None:
    """Draws all pictures."""
    data = tomllib.loads((HERE / "figures.toml").read_text(encoding="utf-8"))
    with mpl.rc_context(STYLE):
        save(draw_outcomes(data["sure"]), "how_sure.svg")
        save(draw_calibration(data["real_arms"]), "calibration.svg")
        save(draw_fits(data["peers"]), "fits.svg")


if __name__ == "__main__":
    main()
