"""The table of what a URDF says of each joint and what was found, on a terminal."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console

from ident.show.console import columns, text_width
from ident.show.report.numbers import LOSSES, describe_marks, table_of, units_in
from ident.show.report.words import DASH

# What an interval of a diagnosis is.
GIVEN_URDF = "± 95 % if the URDF's other numbers are right"


def print_numbers(console: Console, record: Mapping[str, Any], interval: str = GIVEN_URDF) -> None:
    """The table of what the URDF says of each joint and what was found.

    Args:
        console, record: Where, and the result.
        interval: What its intervals are.
    """
    rows = table_of(record)
    if rows:
        width = text_width(console)
        lines = _number_lines(record, rows, interval)
        if max(map(len, lines)) > width:
            lines = _number_lines(record, rows, interval, width)
        console.print("\n".join(lines), soft_wrap=True, highlight=False)


def _number_lines(
    record: Mapping[str, Any],
    rows: Sequence[Mapping[str, Any]],
    interval: str,
    longest: float = math.inf,
) -> list[str]:
    """Of each joint damping, dry friction and rotor: what the URDF says → what was found.

    Where lines may only be so long, the intervals with the URDF's tolerance are left out.
    """
    tolerant = math.isinf(longest)
    table = [["", *(f"{name} [{units_in(record, key)}]" for key, (name, _) in LOSSES.items())]]
    wider = False
    for row in rows:
        cells = [row["joint"]]
        for key in LOSSES:
            number = row["cells"].get(key)
            if number is None or number.figure["value"] is None:
                cells.append(DASH)
                continue
            more = f" ({number.tolerant})" if tolerant and number.tolerant else ""
            wider = wider or bool(more)
            cells.append(f"{number.nominal} → {number.value}{more}")
        table.append(cells)
    title = ["", f"Your URDF → your arm, {interval}"]
    title += ["(in brackets: if they are as far off as URDFs are)"] * wider
    title += ["(of your arm: without what the named effects add)"] * bool(record.get("findings"))
    title += [f"({meaning})" for meaning in describe_marks(record)]
    return [*title, *columns(table, "l" * len(table[0]), longest)]
