"""One page with the paper's planning tables beside ours, its figures drawn anew, and what can't be repeated and why."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import numpy as np

from ident.files import atomic_write
from plan.options import PaperOptions
from plan.paper.repeat import Line, Repeat
from plan.show.pictures import draw_before_after, draw_comparison, draw_motion, save_figure

MISSING = """## What can't be repeated, and why

- The joules: the paper's arm, its net and its recordings are not published; the model here is the one that was given.
- Table 3 with signed energy: rigid body and rotors give back what they take, so only losses and net rank the paths, and
  the end conditions and stamps of the paper's splines are not printed. Ours are clamped splines with even stamps.
- The obstacle of Figs. 10 to 13 and the testers' via points: neither is printed. The box here blocks the straight line;
  the testers are drawn: ways of random trees, moved by up to 12°, kept where they are free. Only the shape compares.
- "Act." of Table 4 and the third row of Fig. 13 need the real arm. `plan solve --json PLAN.json` and
  `ident simulate --plan PLAN.json` run a plan on a simulated one.
- "Computing time only 1/24 of the GA" (Fig. 10), and brute force : GA : RL as 10,000 : 100 : 1 (Table 3): their genetic
  algorithm evaluates one child at a time on a graphics card, ours a generation at once; so the ratio is another.
- The gain of 11 % (Table 3) is one of signed energy on the paper's net; ours, on the model given, stands beside it.
- Seconds: the paper's are wall-clock of its computer, ours are processor seconds of this one.
- "Each section compressed until the joint reached its limit": in what order is not printed; here each once, in order.
"""
PICTURES = {
    "figure_10.png": "Fig. 10: cost against evaluations and processor time",
    "figure_11.png": "Fig. 11: torques before and after speed optimisation",
    "figure_13_6.png": "Fig. 13a: before and after, from the learned energy optimum",
    "figure_13_7.png": "Fig. 13b: before and after, from a drawn tester's via points",
}
PAGE, MARK = "paper.md", "<!-- written by armgap -->"
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
    parts = [f"{MARK}\n", "# The paper's plans and ours\n", _effort(repeat.effort)]
    for table, lines in groupby(repeat.lines, key=lambda line: line.table):
        parts += [f"## {table}\n", _table(list(lines))]
    parts += [f"## {words}\n\n![{words}]({name})\n" for name, words in PICTURES.items() if name in drawn]
    page = out / PAGE
    with atomic_write(page) as part:
        part.write_text("\n".join([*parts, MISSING]), encoding="utf-8")
    return page


def _effort(effort: PaperOptions) -> str:
    """What was run, beside what is run where nothing else is asked for."""
    full = PaperOptions()
    pairs = (
        ("epochs of PPO on Table 3's task, 4.2 times as many with the obstacle", effort.epochs, full.epochs),
        ("generations of the genetic algorithm in Fig. 10", effort.generations, full.generations),
        ("trials", effort.trials, full.trials),
        ("values of each variable in the brute force search", effort.levels, full.levels),
    )
    return f"Ours ran {'; '.join(f'{ours} {name} (in full {theirs})' for name, ours, theirs in pairs)}.\n"


def _table(lines: list[Line]) -> str:
    rows = ["| | paper, trial by trial | mean | ours, trial by trial | mean | CPU [s] |", "|---|---|---|---|---|---|"]
    for line in lines:
        cells = [_cells(line.paper), _mean(line.paper), _cells(line.ours), _mean(line.ours)]
        rows.append(f"| {line.name} [{line.unit}] | {' | '.join(cells)} | {line.cpu_seconds:.1f} |")
    told = [line for line in lines if any(line.details)]
    if told:
        rows += ["", "| | paper | ours |", "|---|---|---|"]
        rows += [f"| {line.name} | {line.details[0]} | {line.details[1]} |" for line in told]
    return "\n".join(rows) + "\n"


def _cells(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:.2f}" if np.isfinite(value) else "no plan" for value in values) or "–"


def _mean(values: tuple[float, ...]) -> str:
    kept = [value for value in values if np.isfinite(value)]
    return f"{np.mean(kept):.2f}" if kept else "–"
