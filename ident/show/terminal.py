"""A comparison in plain lines for the terminal, and what it shares with a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from ident.errors import join_words, plural
from ident.show.console import print_issues, say
from ident.show.palette import NAMED, NOISE, TUNED
from ident.show.report.diagnosis_verdict import (
    MOST_TIED,
    OF_THE_ARM,
    in_units_of,
    is_likely,
    name_with_rivals,
    order_of,
    place_words,
    units_of,
)
from ident.show.report.words import (
    TABLES,
    effect_name,
    fixed,
    parameter_name,
    parameters_in_words,
    percent,
    sentence,
    significant,
    with_units,
)
from ident.show.results import draw_bars

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# A result, or a part of it, as JSON has it.
Record = Mapping[str, Any]

STILL = "only torque beyond its static friction shows"
# Where the rest is of a result whose first screen leaves something out.
REST = "More: `--details` prints {}; `--html PAGE` has it with pictures."
UNTESTABLE: list[dict[str, Any]] = TABLES["untestable"]


def group_silent(rows: Sequence[Record]) -> list[str]:
    """Lines such as: not testable, as the motion shows too little of it: backlash (joint_1), …"""
    return [f"not testable, as {reason}: {', '.join(items)}" for reason, items in silent_groups(rows)]


def silent_groups(rows: Sequence[Record]) -> list[tuple[str, list[str]]]:
    """Reasons, each with the effects that it keeps from being tested, and at which joints."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        kind = next(one["words"] for one in UNTESTABLE if any(mark in row["reason"] for mark in one["marks"]))
        joints = found.setdefault(kind, {}).setdefault(str(row["effect"]), [])
        joints += [joint for joint in row.get("joints", []) if joint not in joints]
    rows_of: list[tuple[str, list[str]]] = []
    for reason in sorted(found, key=[one["words"] for one in UNTESTABLE].index):
        places = {
            effect: join_words(joints) if 0 < len(joints) <= 3 else f"{len(joints)} joints" if joints else "the arm"
            for effect, joints in found[reason].items()
        }
        rows_of.append((reason, [f"{effect_name(effect)} ({where})" for effect, where in places.items()]))
    return rows_of


def describe_limits(record: Record) -> str:
    """One line about all effects that would have been named, each with its range over the joints; "" without any."""
    rows = [one for one in record.get("detectable", []) if not one["hidden"] and one["limit"] is not None]
    parts, found = [], dict[tuple[str, str, str], list[float]]()
    for one in rows:
        unit = in_units_of(one["joints"], record, parameter_name(one["figure"])[1], one["effect"])
        found.setdefault((one["effect"], one["named"], unit), []).append(one["limit"])
    for (effect, named, unit), limits in found.items():
        low, high = significant(min(limits)), significant(max(limits))
        parts.append(f"{effect_name(effect)} {named} {low}{f' to {high}' * (low != high)} {unit}".strip())
    return f"would have been named nine times in ten: {', '.join(parts)}" if parts else ""


def limit_rows(record: Record) -> list[dict[str, str]]:
    """A row for each effect and joint: what would have been named, and what bounds it."""
    rows = []
    for one in record.get("detectable", []):
        limit = "shows nothing"
        if one["limit"] is not None:
            name, unit = parameter_name(one["figure"])
            limit = f"{name} {one['named']} {significant(one['limit'])} {unit}".strip()
            limit += ": more than is plausible" if one["hidden"] else ""
        joints = join_words(one["joints"]) if len(one["joints"]) <= 3 else "the whole arm"
        bound = TABLES["bounds"].get(one["bound_by"], one["bound_by"])
        limit = in_units_of(one["joints"], record, limit, one["effect"])
        rows.append({"effect": effect_name(one["effect"]), "joints": joints, "limit": limit, "bound": bound})
    return rows


def headline(record: Record) -> tuple[str, str]:
    """The verdict as a sentence, and what to do where no change is named."""
    from ident.diagnosis.change.candidates import CARRIED  # a diagnosis compares nothing
    from ident.diagnosis.change.laws import PLAIN_FRICTION

    named = []
    for change in record["changes"][:3]:  # each with its place; one of the whole arm has none
        tied = change.get("class", [])[:MOST_TIED] if not is_likely(change) else []
        mass, effect = change["parameters"].get("mass_kg"), " or ".join(map(effect_name, tied or [change["effect"]]))
        if change["effect"] == CARRIED:
            side = "more" if mass["value"] > 0.0 else "less"
            effect = f"{significant(abs(mass['value']), 3)} kg {side} at the flange"
        elif where := places_of(change):
            effect += f" in {where if len(change['joints']) <= 3 else 'the whole arm'}"
        named.append(effect)
    more = len(record["changes"]) - 3
    changes = join_words(named) + (f", and {more} more" if more > 0 else "")
    kind, risen = record["verdict"], join_words(describe_risen(record))
    if kind == "no_change" and any(row["effect"] == PLAIN_FRICTION for row in record["not_testable"]):
        kind = "friction_unseen"
    unforetold = join_words(describe_unforetold(record))
    if kind == "changed_unexplained" and not changes and (unforetold or risen):
        kind = "unforetold" if unforetold else "risen"
    words, order = TABLES["changes"][kind]
    colon = f": {changes}" if changes else ""
    told = words.format(changes=changes, colon=colon, risen=risen, unforetold=unforetold)
    return told, "" if changes else order


def describe_unforetold(record: Record) -> list[str]:
    """How far off each joint is that one set's model does not foretell and no change is named at; the worst first."""
    named = {joint for change in record["changes"] for joint in change["joints"]}
    rows = [one for one in record.get("unforetold", ()) if one["joint"] not in named]
    rows.sort(key=lambda one: -one["ratio"])
    return [
        f"{one['joint']} is off by {significant(one['error_Nm'])} {in_units_of([one['joint']], record, 'N m')} (rms), "
        f"{one['ratio']:.1f} times the usual ({one['low']:.1f} to {one['high']:.1f})"
        for one in rows
    ]


def describe_risen(record: Record) -> list[str]:
    """By how much each joint's residual rose beside what every law explains."""
    return [
        f"that of {one['joint']} is {one['ratio']:.1f} times what it was (rms; {one['low']:.1f} to {one['high']:.1f})"
        for one in record.get("risen", ())
    ]


def places_of(change: Record) -> str:
    """A change's joints, and those where it may be as well; nothing of one of the whole arm."""
    return "" if change["effect"] in OF_THE_ARM else with_others(change)


def with_others(one: Record) -> str:
    """The joints of a finding or change, and those where the same effect may be as well."""
    others = [it["joint"] for it in one.get("elsewhere", ()) if it["joint"] and it["effect"] == one["effect"]]
    return join_words(one["joints"]) + (f" (or {join_words(others)})" if others else "")


def print_comparison(console: Console, record: Record, details: bool = False) -> None:
    """Verdict and changes with what to do; all else where `details` are asked for."""
    for name in ("before", "after"):
        side = record[name]
        size = f"{plural(side['runs'], 'run')}, {side['samples']} samples, {side['duration_s']:.0f} s"
        console.print(f"{name}: {', '.join(side['sessions'][:6])}{' …' if len(side['sessions']) > 6 else ''}; {size}")
    say(console, describe_known(record), hanging="  ")
    print_issues(console, record["telemetry"], "warning")
    words, order = headline(record)
    say(console, words, style="bold")
    if order:
        say(console, f"Do: {sentence(order)}.", hanging="    ")
    for number, change in enumerate(record["changes"], start=1):
        say(console, describe_name(change, record, "in the later set"), f"{number}. ", "   ")
        if details:
            say(console, f"{sentence(describe_sizes(change, record))}.", "   ")
        say(console, f"Do: {sentence(order_of(change, record))}.", "   ", "       ")
    lines = [*describe_unnamed_changes(record), *describe_still(record)]
    rest = [*describe_unreported(record), *describe_used(record), describe_spread(record)]
    rest += group_silent(without_still(record))
    for line in filter(None, [*lines, *rest] if details else lines):
        say(console, f"{sentence(line)}.", "  ", "    ")
    if not details:
        parts = ["the sizes of each change"] if record["changes"] else []
        parts += ["what fits and is not reported"] if record["reservations"] else []
        parts += ["how much friction differs from run to run, what these recordings can't show"]
        say(console, REST.format(", ".join(parts)))


def describe_known(record: Record) -> str:
    """Which loads and which mount of the base were taken as known, in a sentence or two."""
    loads = [_load_of(record[name]) for name in ("before", "after")]
    carried = f"{loads[0]} before, {loads[1]} after" if loads[0] != loads[1] else f"{loads[0]} before and after"
    mounts = [_mount_of(record[name]) for name in ("before", "after")]
    told = f"Taken as known: payload {carried}; the base {mounts[0]}."
    if mounts[0] != mounts[1]:
        told += f" After, the base is said to be {mounts[1]}: that is not used."
    return told


def _load_of(side: Record) -> str:
    """The load of one set's sessions by their session.toml."""
    loads = sorted(set(side.get("payload_kg", ())))
    if not any(loads):
        return "none"
    return f"{' to '.join(f'{load:.4g}' for load in dict.fromkeys([loads[0], loads[-1]]))} kg"


def _mount_of(side: Record) -> str:
    """How one set's base is mounted."""
    gravity = side.get("gravity_mps2")
    if gravity is None:
        return "as the URDF has it"
    return f"under gravity along [{', '.join(fixed(value, 2) for value in gravity)}] m/s²"


def without_still(record: Record) -> list[Record]:
    """What could not be tested for another reason than that a joint stood still."""
    said = {one["reason"] for one in record.get("still", ())}
    return [one for one in record["not_testable"] if one["reason"] not in said]


def describe_name(cause: Record, record: Record, measured: str) -> str:
    """A name in one sentence: where, how sure, what it closes at the joint where it closes most.

    Args:
        cause: A finding or a change.
        record: The result that holds it.
        measured: Where the error was measured.
    """
    where = f" in {with_others(cause)}"
    if cause["effect"] in OF_THE_ARM:
        where = place_words(cause["effect"], cause["joints"])
    name = sentence(name_with_rivals(cause))
    closes = f"torque error {measured} {describe_fall(cause, record)}"
    rivals = cause.get("class", ())[1:]
    if rivals and not is_likely(cause):
        sure = percent(cause["class_probability"])
        return f"{name}{where}: {sure} sure that it is one of these; {closes}"
    tied = " or ".join(map(effect_name, rivals))
    others = f"; can't be told from {tied} by these recordings" if tied else ""
    return f"{name}{where}: {percent(cause['probability'])} sure; {closes}{others}"


def describe_fall(cause: Record, record: Record) -> str:
    """The torque error without and with a cause, at the joint where it closes most."""
    before = cause["heldout"]["rms_before_Nm"]
    after = cause["heldout"]["rms_after_Nm"]
    worst = max(before, key=lambda joint: before[joint] ** 2 - after[joint] ** 2)
    old = significant(before[worst])
    new = significant(after[worst])
    fall = f"{old} → {new}" if old != new else f"stays at {old}"
    return f"{fall} {in_units_of([worst], record, 'N m')} at {worst}"


def describe_sizes(change: Record, record: Record) -> str:
    """How large a change is, and what it explains at each of its joints."""
    heldout = change["heldout"]
    after = heldout["rms_after_Nm"]
    parts = [
        f"{name} {fixed(before)} → {fixed(after[name])} {in_units_of([name], record, 'N m')}"
        for name, before in heldout["rms_before_Nm"].items()
    ]
    words = parameters_in_words(change["parameters"])
    sizes = in_units_of(change["joints"], record, words, change["effect"])
    closed = f"{percent(heldout['shrink'])} of what can be closed"
    return f"{sizes}; error in the later set {', '.join(parts)} ({closed})"


def describe_notes(record: Record) -> list[str]:
    """What is not reported, what has no name, and joints of which little was used."""
    lines = [*describe_unreported(record), *describe_unnamed_changes(record)]
    return [*lines, *describe_used(record), *describe_still(record)]


def describe_unreported(record: Record) -> list[str]:
    """What fits and is not reported, a line for each reason."""
    found: dict[str, list[str]] = {}
    for one in record["reservations"]:
        reason = in_units_of(one["joints"], record, with_units(one["reason"]), one["effect"])
        found.setdefault(reason, []).append(f"{effect_name(one['effect'])} in {join_words(one['joints'])}")
    return [f"not reported: {join_words(what)}: {reason}" for reason, what in found.items()]


def describe_unnamed_changes(record: Record) -> list[str]:
    """What changed beside the changes that have a name."""
    if not record["changes"]:
        return []
    grown = "torque that follows no law has grown beside the changes"
    lines = [f"{grown}: {line}" for line in describe_risen(record)]
    unnamed = "no change is named where one set does not foretell the other"
    return lines + [f"{unnamed}: {line}" for line in describe_unforetold(record)]


def describe_still(record: Record) -> list[str]:
    """Joints that stood still."""
    return [f"of {row['joint']} {STILL}: {row['reason']}" for row in record.get("still", ())]


def describe_spread(record: Record) -> str:
    """How much friction differs from run to run of one set, or is taken to where each has a single run."""
    parts = [f"{joint} {percent(share)}" for joint, share in record["friction_run_spread"].items()]
    if parts and record["before"]["runs"] + record["after"]["runs"] <= 2:
        return "how much friction differs from run to run is assumed, for single runs can't say: record three a side"
    return f"friction differs from run to run of one set by: {', '.join(parts)}" if parts else ""


def describe_used(record: Record) -> list[str]:
    """Joints whose friction is known in less than half of their samples, a line each: what the others are."""
    return [
        f"samples of {one['joint']}: {percent(one['in_motion'])} in motion, {percent(one['at_rest'])} at rest "
        f"({plural(one['holds'], 'hold')}, each one observation), {percent(one['turning'])} near stops and turns, "
        f"{percent(one['left_out'])} left out ({one['why']})"
        for one in record.get("samples_used", ())
        if one["in_motion"] < 0.5
    ]


def draw_comparison(record: Record) -> Figure:
    """Error of the common model in the later set, without and with the changes."""
    heldout = record["heldout"]
    names: list[str] = list(heldout["rms_before_Nm"]) or list(record["joints"])
    bars = [("without the changes", TUNED, "rms_before_Nm"), ("with them", NAMED, "rms_after_Nm")]
    bars = [*bars[: 2 if record["changes"] else 1], ("noise", NOISE, "noise_Nm")]
    rows = {words: (colour, [heldout[key].get(name) for name in names]) for words, colour, key in bars}
    return draw_bars(names, rows, f"torque [{units_of(record)}]", f"{record['robot']}: {record['verdict']}")
