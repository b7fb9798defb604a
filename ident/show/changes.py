"""A comparison in plain lines and as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console

from ident.console import styled
from ident.diagnosis.change.candidates import CARRIED
from ident.effects.catalogue import CATALOGUE
from ident.errors import plural
from ident.show.console import print_serious
from ident.show.palette import NAMED, NOISE, TUNED
from ident.show.panels import draw_bars
from ident.show.report.words import TABLES, effect_name, fixed, join_words, parameters_in_words, percent, significant
from ident.show.terminal import group_silent

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_THE_ARM = {effect.id for effect in CATALOGUE if effect.scope == "arm"}


def headline(record: Mapping[str, Any]) -> str:
    """The verdict as a sentence."""
    named = []
    for change in record["changes"][:3]:  # each with its place; one of the whole arm has none
        mass, effect = change["parameters"].get("mass_kg"), effect_name(change["effect"])
        where = places_of(change) if len(change["joints"]) <= 3 else "the whole arm"
        if change["effect"] == CARRIED:
            side = "more" if mass["value"] > 0.0 else "less"
            effect = f"{significant(abs(mass['value']), 3)} kg {side} at the flange"
        elif change["effect"] not in OF_THE_ARM:
            effect = f"{effect} in {where}"
        named.append(effect)
    told = join_words(named)
    more = len(record["changes"]) - 3
    told += f", and {more} more" if more > 0 else ""
    return str(TABLES["changes"][record["verdict"]]).format(told=told, colon=f": {told}" if told else "")


def places_of(change: Mapping[str, Any]) -> str:
    """A change's joints, and those where it may be as well."""
    places = [one["joint"] for one in change.get("elsewhere", ()) if one["effect"] == change["effect"]]
    return join_words(change["joints"]) + (f" (or {join_words(places)})" if places else "")


def print_comparison(console: Console, record: Mapping[str, Any]) -> None:
    """Verdict, changes with what to do, and what could not be judged."""
    for name in ("before", "after"):
        side = record[name]
        size = f"{plural(side['runs'], 'run')}, {side['samples']} samples, {side['duration_s']:.0f} s"
        console.print(f"{name}: {', '.join(side['sessions'][:6])}{' …' if len(side['sessions']) > 6 else ''}; {size}")
    print_serious(console, record["telemetry"])
    console.print(styled((record["verdict"], "bold"), f": {headline(record)}"), soft_wrap=True)
    for change in record["changes"]:
        told = f"  {describe_change(change)}\n    do: {change['action']}"
        console.print(told, soft_wrap=True, highlight=False, markup=False)
    lines = [
        f"not reported: {effect_name(one['effect'])} in {join_words(one['joints'])}: {one['reason']}"
        for one in record["reservations"]
    ]
    lines.append(describe_spread(record["friction_run_spread"]))
    if min(record["before"]["runs"], record["after"]["runs"]) < 2:
        unknown = "of a single run nothing is known of what runs differ by"
        lines.append(f"{unknown}: a usual spread is assumed; record three or more")
    lines += [*describe_used(record), *describe_still(record), *group_silent(without_still(record))]
    for line in filter(None, lines):
        console.print(f"  {line}", soft_wrap=True, highlight=False, markup=False)


def describe_still(record: Mapping[str, Any]) -> list[str]:
    """Joints that stood still, a line each."""
    shows = "only torque beyond its static friction shows"
    return [f"of {one['joint']} {shows}: {one['reason']}" for one in record.get("still", ())]


def without_still(record: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """What could not be tested for another reason than that a joint stood still."""
    told = {one["reason"] for one in record.get("still", ())}
    return [one for one in record["not_testable"] if one["reason"] not in told]


def describe_change(change: Mapping[str, Any]) -> str:
    """One change's record in one line: where, what, how large, how sure, how much it explains."""
    rivals, heldout = [effect_name(name) for name in change["class"][1:]], change["heldout"]
    open_between = f"; can't be told from {join_words(rivals)}" if rivals else ""
    after = heldout["rms_after_Nm"]
    parts = [f"{name} {fixed(before)} → {fixed(after[name])} N m" for name, before in heldout["rms_before_Nm"].items()]
    where = "" if change["effect"] in OF_THE_ARM else f"{places_of(change)}: "
    return (
        f"{where}{effect_name(change['effect'])}{open_between}; {parameters_in_words(change['parameters'])}; "
        f"error in the later set {', '.join(parts)} ({percent(heldout['shrink'])} of what can be closed)"
    )


def describe_spread(spread: Mapping[str, float]) -> str:
    """How much friction differs from run to run of one set."""
    parts = [f"{joint} {percent(share)}" for joint, share in spread.items()]
    return f"friction differs from run to run of one set by: {', '.join(parts)}" if parts else ""


def describe_used(record: Mapping[str, Any]) -> list[str]:
    """Joints whose friction is known in less than half of their samples, a line each: what the others are."""
    return [
        f"samples of {one['joint']}: {percent(one['in_motion'])} in motion, {percent(one['at_rest'])} at rest "
        f"({plural(one['holds'], 'hold')}, each one observation), {percent(one['turning'])} near stops and turns, "
        f"{percent(one['left_out'])} left out ({one['why']})"
        for one in record.get("samples_used", ())
        if one["in_motion"] < 0.5
    ]


def draw_comparison(record: Mapping[str, Any]) -> Figure:
    """Error of the common model in the later set, without and with the changes."""
    heldout = record["heldout"]
    names: Sequence[str] = list(heldout["rms_before_Nm"]) or list(record["joints"])

    def bars(key: str) -> list[float | None]:
        return [heldout[key].get(name) for name in names]

    rows = {
        "without the changes": (TUNED, bars("rms_before_Nm")),
        "with them": (NAMED, bars("rms_after_Nm")),
        "noise": (NOISE, bars("noise_Nm")),
    }
    return draw_bars(list(names), rows, "torque [N m]", f"{record['robot']}: {record['verdict']}")
