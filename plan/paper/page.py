"""One page with the paper's planning tables beside ours, its figures drawn anew, and what can't be repeated and why."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jinja2 import Environment, StrictUndefined

from ident.files import atomic_write
from plan.options import PaperOptions
from plan.paper.repeat import Repeat
from plan.show.pictures import draw_before_after, draw_comparison, draw_motion, save_figure

TEMPLATE = Path(__file__).with_name("page.md.jinja")
PICTURES = {
    "figure_10.png": "Fig. 10: cost against evaluations and processor time",
    "figure_11.png": "Fig. 11: torques before and after speed optimisation",
    "figure_13_6.png": "Fig. 13a: before and after, from the learned energy optimum",
    "figure_13_7.png": "Fig. 13b: before and after, from a drawn tester's via points",
}
PAGE = "paper.md"
# All that a page's folder may hold.
FILES = (PAGE, *PICTURES)


def write_page(repeat: Repeat, out: Path) -> Path:
    """Writes `paper.md` and its pictures into a folder; returns the page."""
    save_figure(draw_comparison(repeat.search), out / "figure_10.png")
    drawn = {"figure_10.png"}
    for name, (problem, result) in repeat.motions.items():
        if result.splines is not None:
            draw = draw_before_after if name.startswith("figure_13") else draw_motion
            save_figure(draw(problem, result), out / f"{name}.png")
            drawn.add(f"{name}.png")
    settings = Environment(undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True)
    text = settings.from_string(TEMPLATE.read_text(encoding="utf-8")).render(
        effort=repeat.effort,
        full=PaperOptions(),
        tables=repeat.tables,
        pictures={name: words for name, words in PICTURES.items() if name in drawn},
        cells=_cells,
        mean=_mean,
    )
    with atomic_write(out / PAGE) as part:
        part.write_text(text, encoding="utf-8")
    return out / PAGE


def _cells(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.2f}" if np.isfinite(value) else "no plan" for value in values) or "–"


def _mean(values: Sequence[float]) -> str:
    kept = [value for value in values if np.isfinite(value)]
    return f"{np.mean(kept):.2f}" if kept else "–"
