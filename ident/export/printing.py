"""A patch in plain lines for the terminal."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from ident.errors import join_words, plural
from ident.export.formats import FORMATS
from ident.export.promotion import in_words
from ident.show.console import say
from ident.show.diagnosis_lines import print_numbers
from ident.show.palette import FLEXIBLE, NAMED, NOISE, ORANGE
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
    "Next: load robot.xml (MuJoCo) or robot.urdf from there in your simulator; what a format has no place for, "
    "extra_torque.py adds."
)
# By state of the file: greys before, then ever nearer to what is written.
COLOURS = dict(zip(WHEN, ("#cccccc", NOISE, ORANGE, FLEXIBLE, NAMED), strict=True))


def print_patch(console: Console, record: dict[str, Any], out: Path) -> None:
    """What is expressed where, what is not and why, and the gaps before and after."""
    for effect in record["effects"]:
        formats = effect["formats"]
        answers = ", ".join(
            f"{NAMES[form]} {ANSWERS[formats[form]['expressed']]}" for form in FORMATS
        )
        say(
            console,
            f"{effect_name(effect['effect'])} in {join_words(effect['joints'])}: {answers}",
            "",
            "  ",
        )
        for form in FORMATS:
            if formats[form]["expressed"] != "yes":
                say(console, f"{NAMES[form]}: {formats[form]['how']}", "    ", "      ")
    if record.get("identified"):
        told = {key: record[key] for key in ("identified", "joints")}
        print_numbers(console, told)
        console.print()
    for line in record["told"]:
        say(console, line, "  ", "    ")
    for form, found in record["structure"].items():
        left = found["torque_difference_Nm"]
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


def print_into(console: Console, into: dict[str, Any]) -> None:
    """What was written into the user's own file, and what was not."""
    rotor = "" if into["format"] == "urdf" else " and rotor inertia"
    links = f"; inertia of {join_words(into['links'])}" if into["links"] else ""
    number = plural(len(into["joints"]), "joint")
    say(
        console,
        f"{into['file']}: damping, dry friction{rotor} of {number}{links} written, all else as it was",
        "",
        "  ",
    )
    for line in into["left"]:
        say(console, f"not written: {line}", "  ", "    ")
    name = Path(into["file"]).name
    say(
        console,
        f"as it was, for this diagnosis and models fitted to it: before_{name} in the folder",
        "  ",
        "    ",
    )


def gap_table(heldout: dict[str, Any]) -> Table:
    """Torque gap of each joint [N m], and the rollout gap over all joints, of each file in each
    state.
    """
    kind = (
        "that were diagnosed"
        if heldout["in_sample"]
        else "that were not diagnosed; they decide what is written"
    )
    table = Table(
        "file",
        "gap",
        title=f"gap on {plural(len(heldout['runs']), 'run')} {kind}",
        title_justify="left",
    )
    for words in WHEN.values():
        table.add_column(words, justify="right")
    for form, found in heldout["gaps"].items():
        torques = [gap["torque_rms_Nm"] for gap in found.values()]
        rows = {f"{name} [N m]": [torque[name] for torque in torques] for name in torques[0]}
        miss = [list(gap["position_rms_rad"].values()) for gap in found.values()]
        rows[f"rollout {heldout['window_s']:g} s [mrad]"] = list(
            1e3 * np.sqrt(np.mean(np.square(miss), axis=1))
        )
        for name, values in rows.items():
            cells = {when: f"{value:.3f}" for when, value in zip(found, values, strict=True)}
            table.add_row(
                form,
                name,
                *(cells.get(when, "") for when in WHEN),
                end_section=name.startswith("rollout"),
            )
    return table


def write(console: Console, result: Any) -> None:
    """Prints a patch, an export or a verification in plain lines."""
    record = result.to_dict()
    lines = []
    if "effects" in record:
        print_patch(console, record, result.folder)
        return
    for check in record.get("checks", ()):
        value = (
            "not tested by these recordings" if check["value"] is None else f"{check['value']:.4g}"
        )
        mark = "kept" if check["passed"] else "NOT KEPT"
        place = f"{check['session']}: {check['figure']} {check['joint']}"
        lines.append(f"{place}: {value}, limit {check['bound']:g}: {mark}")
    for name, found in record.get("loaded_back", {}).items():
        error = found.get("torque_difference_Nm")
        if found.get("loads") is None:
            lines.append(f"{name}: {found['told']}")
            continue
        near = "" if error is None else f", torque within {error:.1e} N m of what it states"
        lines.append(f"{name}: loaded back{near}")
    for name, error in record.get("torque_rmse_Nm", {}).items():
        lines.append(f"{name}: torque RMSE {error['before']:.3f} -> {error['after']:.3f} N m")
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
        for form, found in record.get("heldout", {}).get("gaps", {}).items():
            rows |= {
                f"{form}, {WHEN[k]}": (COLOURS[k], list(one["torque_rms_Nm"].values()))
                for k, one in found.items()
            }
        joints = record["joints"] if rows else []
        return draw_bars(joints, rows, "torque gap [N m]", f"files of {record['robot']}")
    checks = [one for one in record["checks"] if one["value"] is not None]
    shares: list[float | None] = [
        one["value"] / one["bound"] if one["bound"] else None for one in checks
    ]
    names = [f"{one['figure']} {one['joint']}" for one in checks]
    return draw_bars(
        names,
        {"share of its limit": (COLOURS["after"], shares)},
        "1",
        f"limits of {record['model']}",
    )
