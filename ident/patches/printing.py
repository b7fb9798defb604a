"""A patch in plain lines for the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ident.console import styled
from ident.patches.expressed import FORMATS

WHEN = {
    "before": "before",
    "tuned": "tuned, no effects",
    "after": "patched",
    "after_with_module": "patched + module",
}

# By state of the file: grey before, then ever nearer to what is written.
COLOURS = ("#999999", "#e69f00", "#0072b2", "#009e73")


def print_patch(console: Console, record: dict[str, Any], out: Path) -> None:
    """What is expressed where, what is not and why, and the gaps before and after."""
    for effect in record["effects"]:
        answers = ", ".join(f"{form} {effect['formats'][form]['expressed']}" for form in FORMATS)
        head = styled(f"{', '.join(effect['joints'])}: ", (effect["effect"], "bold"), f": {answers}")
        console.print(head, soft_wrap=True)
        for form in FORMATS:
            found = effect["formats"][form]
            if found["expressed"] != "yes":
                console.print(f"    {form}: {found['how']}", soft_wrap=True, highlight=False)
    for line in record["told"]:
        console.print(f"  {line}", soft_wrap=True, highlight=False)
    for form, found in record["structure"].items():
        left = found["torque_difference_Nm"]
        said = "its torque is not compared state by state" if left is None else f"within {left:.1g} N m of its laws"
        console.print(f"  {form}: loads, {said}")
    if "heldout" in record:
        console.print(gap_table(record["heldout"]))
        for form, when in record["heldout"]["best"].items():
            console.print(f"  {form}: measures best {WHEN[when]}; written: {WHEN[record['written'][form]]}")
    console.print(f"patch written to {out}")


def gap_figures(heldout: dict[str, Any] | None) -> tuple[list[str], dict[str, tuple[str, list[float | None]]]]:
    """Torque gaps for a picture: the joints, and for each file and state words, colour and values [N m]."""
    if not heldout:
        return [], {}
    colours = iter(COLOURS * len(heldout["gaps"]))
    rows: dict[str, tuple[str, list[float | None]]] = {
        f"{form}, {WHEN[when]}": (next(colours), list(gap["torque_rms_Nm"].values()))
        for form, found in heldout["gaps"].items()
        for when, gap in found.items()
    }
    first = next(iter(next(iter(heldout["gaps"].values())).values()))
    return list(first["torque_rms_Nm"]), rows


def gap_table(heldout: dict[str, Any]) -> Table:
    """Torque gap of each joint, and the rollout gap over all joints."""
    gaps = heldout["gaps"]
    joints = list(next(iter(gaps.values()))["before"]["torque_rms_Nm"])
    table = Table(title=f"held-out gap on {len(heldout['runs'])} runs", title_justify="left")
    table.add_column("file")
    table.add_column("")
    for name in joints:
        table.add_column(f"{name} [N m]", justify="right")
    table.add_column(f"rollout {heldout['window_s']:g} s [mrad]", justify="right")
    for form, found in gaps.items():
        for when, gap in found.items():
            cells = [f"{value:.3f}" for value in gap["torque_rms_Nm"].values()]
            miss = 1e3 * float(np.sqrt(np.mean(np.square(list(gap["position_rms_rad"].values())))))
            table.add_row(form, WHEN[when], *cells, f"{miss:.2f}", end_section=when == "after_with_module")
    return table
