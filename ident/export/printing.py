"""A patch in plain lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ident.errors import join_words, plural
from ident.export.formats import FORMATS
from ident.export.promotion import in_words
from ident.records import JsonRecord
from ident.show.console import say
from ident.show.number_lines import print_numbers
from ident.show.palette import FLEXIBLE, NAMED, NOISE, ORANGE
from ident.show.report.finding_words import every_place
from ident.show.report.words import effect_name

# What people call the formats, and how far one says an effect.
NAMES = {"urdf": "URDF", "mjcf": "MJCF", "parameters": "parameter file", "module": "Python module"}
ANSWERS = {"yes": "has it", "approximate": "has it nearly", "no": "has no place for it"}
WHEN = {
    "given": "URDF",
    "before": "before",
    "tuned": "tuned",
    "after": "written",
    "after_with_module": "+ module",
}
NEXT = (
    "Next: load robot.xml (MuJoCo) or robot.urdf from there in your simulator; what a format has "
    "no place for, extra_torque.py adds."
)
# By state of the file: greys before, then ever nearer to what is written.
COLOURS = dict(zip(WHEN, ("#cccccc", NOISE, ORANGE, FLEXIBLE, NAMED), strict=True))


def print_patch(console: Console, record: JsonRecord, out: Path) -> None:
    """What is expressed where, what is not and why, and the gaps before and after."""
    for effect in record["effects"]:
        formats = effect["formats"]
        expressed = {form: formats[form]["expressed"] for form in FORMATS}
        answers = ", ".join(f"{NAMES[form]} {ANSWERS[how]}" for form, how in expressed.items())
        where = effect_name(effect["effect"]) + every_place(effect["effect"], effect["joints"])
        say(console, f"{where}: {answers}", "", "  ")
        for form in FORMATS:
            if formats[form]["expressed"] != "yes":
                say(console, f"{NAMES[form]}: {formats[form]['how']}", "    ", "      ")
    if record.get("identified"):
        told: JsonRecord = {
            key: record[key] for key in ("identified", "joints", "slides") if key in record
        }
        print_numbers(console, told)
        console.print()
    for line in record["told"]:
        say(console, line, "  ", "    ")
    for form, check in record["structure"].items():
        left = check["torque_difference_Nm"]
        said = "its torque is not compared state by state"
        if left is not None:
            said = f"its torque is within {left:.1g} N m of the laws that it is to have"
        say(console, f"{NAMES.get(form, form)}: it loads; {said}", "  ", "    ")
    if "heldout" in record:
        console.print(gap_table(record["heldout"]))
    console.print(f"patch written to {out}")
    say(console, NEXT, hanging="  ")
    if "into" in record:
        print_into(console, record["into"])


def print_into(console: Console, into: JsonRecord) -> None:
    """What was written into the user's own file, and what was not."""
    rotor = "" if into["format"] == "urdf" else " and rotor inertia"
    links = f"; inertia of {join_words(into['links'])}" if into["links"] else ""
    number = plural(len(into["joints"]), "joint")
    what = f"damping, dry friction{rotor} of {number}{links} written, all else as it was"
    say(console, f"{into['file']}: {what}", "", "  ")
    for line in into["left"]:
        say(console, f"not written: {line}", "  ", "    ")
    name = Path(into["file"]).name
    what = "as it was, for this diagnosis and models fitted to it"
    say(console, f"{what}: before_{name} in the folder", "  ", "    ")


def gap_table(heldout: JsonRecord) -> Table:
    """Torque gap of each joint [N m], and the rollout gap over all joints, of each file in each
    state.
    """
    kind = "that were not diagnosed; they decide what is written"
    if heldout["in_sample"]:
        kind = "that were diagnosed"
    title = f"gap on {plural(len(heldout['runs']), 'run')} {kind}"
    table = Table("file", title=title, title_justify="left")
    table.add_column("gap", overflow="fold")  # joints whose names begin alike stay apart
    for words in WHEN.values():
        table.add_column(words, justify="right")
    for form, gaps in heldout["gaps"].items():
        torques = {when: gap["torque_rms_Nm"] for when, gap in gaps.items()}
        for joint in next(iter(torques.values())):
            of_joint = {when: torque[joint] for when, torque in torques.items()}
            table.add_row(form, f"{joint} [N m]", *_cells(of_joint))
        missed = {}
        for when, gap in gaps.items():
            angles = list(gap["position_rms_rad"].values())
            missed[when] = 1e3 * float(np.sqrt(np.mean(np.square(angles))))
        name = f"rollout {heldout['window_s']:g} s [mrad]"
        table.add_row(form, name, *_cells(missed), end_section=True)
    return table


def _cells(values: Mapping[str, float]) -> list[str]:
    """A row's cells; empty for states of the file that have no value."""
    return [f"{values[when]:.3f}" if when in values else "" for when in WHEN]


def write(console: Console, result: Any) -> None:
    """Prints a patch, an export or a verification in plain lines."""
    record = result.to_dict()
    lines = []
    if "effects" in record:
        print_patch(console, record, result.folder)
        return
    for check in record.get("checks", ()):
        value = "not tested by these recordings"
        if check["value"] is not None:
            value = f"{check['value']:.4g}"
        mark = "kept" if check["passed"] else "NOT KEPT"
        place = f"{check['session']}: {check['figure']} {check['joint']}"
        lines.append(f"{place}: {value}, limit {check['bound']:g}: {mark}")
    for name, loading in record.get("loaded_back", {}).items():
        error = loading.get("torque_difference_Nm")
        if loading.get("loads") is None:
            lines.append(f"{name}: {loading['told']}")
            continue
        near = "" if error is None else f", torque within {error:.1e} N m of what it states"
        lines.append(f"{name}: loaded back{near}")
    for name, errors in record.get("torque_rmse_Nm", {}).items():
        lines.append(f"{name}: torque RMSE {errors['before']:.3f} -> {errors['after']:.3f} N m")
    if record.get("changed_links"):
        lines.append(f"nearest bodies written for: {', '.join(record['changed_links'])}")
    lines += [f"left out: {line}" for line in record.get("left_out", ())]
    promotion = record.get("promotion")
    if promotion is not None:
        lines += in_words(promotion)
    if "files" not in record:
        end = "passed" if record["passed"] else "not passed"
    else:
        end = f"written to {result.folder}" if record["files"] else "not promoted"
    for line in (*lines, end):
        say(console, line, "", "  ")


def draw(result: Any) -> Any:
    """Torque error of each file where it was measured, or each quantity in shares of its limit."""
    from ident.show.results import draw_bars

    record = result.to_dict()
    if "checks" not in record:
        rows: dict[str, tuple[str, list[float | None]]] = {}
        for form, gaps in record.get("heldout", {}).get("gaps", {}).items():
            for when, gap in gaps.items():
                errors = list(gap["torque_rms_Nm"].values())
                rows[f"{form}, {WHEN[when]}"] = (COLOURS[when], errors)
        joints = record["joints"] if rows else []
        return draw_bars(joints, rows, "torque gap [N m]", f"files of {record['robot']}")
    names = []
    shares: list[float | None] = []
    for check in record["checks"]:
        if check["value"] is not None:
            names.append(f"{check['figure']} {check['joint']}")
            shares.append(check["value"] / check["bound"] if check["bound"] else None)
    bars = {"share of its limit": (COLOURS["after"], shares)}
    return draw_bars(names, bars, "1", f"limits of {record['model']}")
