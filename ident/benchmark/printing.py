"""The check in words and as a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import Console

from ident.benchmark.summary import BlindReport
from ident.errors import plural
from ident.show.palette import FLEXIBLE
from ident.show.results import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def write(console: Console, report: BlindReport) -> None:
    """Prints every score with its 95 % interval, a line each.

    Efficiency by size, the worst worlds.
    """
    record = report.to_dict()
    lines = []
    for name, value in record["scores"].items():
        if isinstance(value, dict):
            sizes = ", ".join(f"{size}x {_rounded(at_size)}" for size, at_size in value.items())
            if sizes:
                lines.append(f"  {name}: {sizes}")
            continue
        low, high = record["intervals"].get(name, (None, None))
        interval = f" [{low:.2f}, {high:.2f}]" if low is not None and high is not None else ""
        lines.append(f"  {name}: {_rounded(value)}{interval}")
    if again := record["run"].get("drawn_again"):
        cases = plural(again, "case")
        lines.append(f"  drawn again, a size out of reach or an arm that diverged: {cases}")
    if record["worst_stratum"] is not None:
        worst = record["worst_stratum"]
        share = f"strict {worst['strict']:.2f} of {worst['cases']}"
        lines.append(f"  worst stratum: {worst['world']}: {share}")
    console.print("\n".join(lines), highlight=False, soft_wrap=True)


def _rounded(value: float | None) -> float | None:
    """A score with the digits that are shown."""
    return value if value is None else round(value, 3)


def draw(report: BlindReport) -> Figure:
    """The scores that are shares."""
    shares = {
        name: score.value for name, score in report.scores.items() if name != "seconds_per_case"
    }
    rows = {f"{len(report.outcomes)} cases": (FLEXIBLE, list(shares.values()))}
    return draw_bars(list(shares), rows, "share", f"withheld effects, seed {report.seed}")
