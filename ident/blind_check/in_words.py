"""A check in words and as a picture, for the terminal, Python and notebooks."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ident.blind_check.summary import BlindReport
from ident.show.panels import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def summary(report: BlindReport) -> str:
    """Every score with its 95 % interval, a line each; efficiency by size, ranks, classes, the worst worlds."""
    record = report.to_dict()
    lines = []
    for name, value in record["scores"].items():
        if isinstance(value, dict):
            sizes = ", ".join(f"{size}x {one if one is None else round(one, 3)}" for size, one in value.items())
            lines += [f"  {name}: {sizes}"] if sizes else []
            continue
        low, high = record["intervals"].get(name, (None, None))
        interval = f" [{low:.2f}, {high:.2f}]" if low is not None and high is not None else ""
        lines.append(f"  {name}: {value if value is None else round(value, 3)}{interval}")
    if report.ranks.count:
        uneven = [f"{name} ({one.words})" for name, one in report.ranks_by_figure.items() if one.is_odd]
        p_value = "" if report.ranks.p_value is None else f", p = {report.ranks.p_value:.2g}"
        lines.append("; ".join([f"  ranks of {report.ranks.count} figures{p_value}: {report.ranks.words}", *uneven]))
    if report.class_sets.cases:
        lines.append(f"  class sets: {report.class_sets.words}")
    if record["worst_stratum"] is not None:
        worst = record["worst_stratum"]
        lines.append(f"  worst stratum: {worst['world']}: strict {worst['strict']:.2f} of {worst['cases']}")
    return "\n".join(lines)


def draw(report: BlindReport) -> Figure:
    """The scores that are shares."""
    shares = {name: score.value for name, score in report.scores.items() if name != "seconds_per_case"}
    rows = {f"{len(report.outcomes)} cases": ("#0072b2", list(shares.values()))}
    return draw_bars(list(shares), rows, "share", f"withheld effects, seed {report.seed}")
