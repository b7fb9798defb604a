"""A diagnosis and a comparison in plain lines for the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from ident.console import styled
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.gap.axes import session_axes
from ident.errors import plural
from ident.show.console import print_serious
from ident.show.palette import NAMED, TUNED
from ident.show.report.diagnosis_verdict import (
    describe_reservations,
    describe_unnamed,
    diagnosis_headline,
    energy_pair,
    first_action,
    order_of,
)
from ident.show.report.words import (
    TABLES,
    axis_name,
    effect_name,
    interval_words,
    join_words,
    parameter_name,
    parameters_in_words,
    significant,
)
from ident.show.timeline import Curve, Mark

UNTESTABLE: list[dict[str, Any]] = TABLES["untestable"]


def group_silent(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines such as: not testable, as the motion shows too little of it: backlash (joint_1), …"""
    return [f"not testable, as {reason}: {', '.join(items)}" for reason, items in silent_groups(rows)]


def silent_groups(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
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


def describe_limits(record: Mapping[str, Any]) -> str:
    """One line about all effects that would have been named, each with its range over the joints; "" without any."""
    rows = [one for one in record.get("detectable", []) if not one["hidden"] and one["limit"] is not None]
    parts = []
    for effect in dict.fromkeys(one["effect"] for one in rows):
        own = [one for one in rows if one["effect"] == effect]
        values = sorted(one["limit"] for one in own)
        unit = parameter_name(own[0]["figure"])[1]
        low, high = significant(values[0]), significant(values[-1])
        span = low if low == high else f"{low} to {high}"
        parts.append(f"{effect_name(effect)} {own[0]['named']} {span} {unit}".strip())
    return f"would have been named nine times in ten: {', '.join(parts)}" if parts else ""


def limit_rows(record: Mapping[str, Any]) -> list[dict[str, str]]:
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
        rows.append({"effect": effect_name(one["effect"]), "joints": joints, "limit": limit, "bound": bound})
    return rows


MOST_MARKS = 60
MARK_LENGTH = 0.5  # [s]
# Mean square of a stretch that is marked, in units of the noise's.
MARK_FROM = 4.0


def print_diagnosis(console: Console, record: Mapping[str, Any]) -> None:
    """Verdict, findings, and what could not be judged."""
    facts, verdict, findings = record["session"], record["verdict"], record["findings"]
    runs = int(facts["runs"])
    console.print(f"{record['robot']}: {plural(runs, 'run')}, {facts['samples']} samples, {facts['duration_s']:.0f} s")
    print_serious(console, record["telemetry"])
    console.print(styled((verdict, "bold"), f": {diagnosis_headline(record)}"), soft_wrap=True)
    say = partial(console.print, soft_wrap=True, highlight=False, markup=False)  # "[open]" is no markup
    if action := first_action(record):
        say(f"  first: {action}")
    for one in findings:
        say(f"{describe(one, runs)}\n    do: {order_of(one, record)}")
    lines = [*describe_reservations(record), describe_unnamed(record), *map(describe_gap, record["gap"].items())]
    lines += [describe_limits(record) if verdict == "no_gap" else "", *group_silent(record["not_testable"])]
    for line in filter(None, lines):
        say(f"  {line}")
    if until := record.get("until"):
        say(describe_looks(until))
        if not until["enough"] and record["next_experiment"] is not None:
            say(f"  record next: {record['next_experiment']['motion']}")


def describe_gap(gap: tuple[str, Mapping[str, Any]]) -> str:
    """A joint's gap in one line."""
    joint, one = gap
    left = f"; a function of {one['unexplained']} leaves {one['ceiling_rms_Nm']:.3f}" if one["unexplained"] else ""
    return f"{joint}: {one['rms_Nm']:.3f} N m against {one['noise_floor_Nm']:.3f} of noise{left}"


def describe_looks(until: Mapping[str, Any]) -> str:
    """Whether the runs of repeated looks were enough, or what is missing, in one line."""
    amount = f"{plural(until['runs'], 'run')} ({until['minutes']:.1f} min)"
    if until["enough"]:
        return f"sure after {amount}, looked at {len(until['looks'])} times: that much is enough"
    return f"not sure after {amount}: {'; '.join(until['missing'])}"


def describe(finding: Mapping[str, Any], runs: int) -> str:
    """One finding's record in one line: where, what, how sure, how large, how far; of one run, energy has no spread."""
    heldout, others = finding["heldout"], list(finding["class_shares"].items())[1:]
    names = ", ".join(f"{one} {share:.0%}" for one, share in others)
    rivals = f"; one of its class {finding['class_probability']:.0%}: {names}" if others else ""
    before, after = (energy_pair(heldout, when, runs) for when in ("before", "after"))
    return (
        f"  {', '.join(finding['joints'])}: {finding['effect']} ({finding['probability']:.0%}{rivals}), "
        f"{parameters_in_words(finding['parameters'])}; "
        f"explains {significant(heldout['gain_rms_Nm'])} N m (rms) on unseen runs, {heldout['shrink']:.0%} of what can "
        f"be closed; energy error {before} → {after} J"
    )


def gap_marks(analysis: Analysis) -> list[Mark]:
    """The half seconds in which a joint's residual stands highest above its noise, and the cells that they lie in."""
    found: list[tuple[float, int, int, slice]] = []
    level = np.maximum(analysis.evidence.floor, 1e-9)
    for k, item in enumerate(analysis.series):
        width = max(1, round(MARK_LENGTH / item.step))
        power = np.where(item.counts, (item.before / level) ** 2, 0.0)
        for start in range(0, len(power) - width + 1, width):
            rows = slice(start, start + width)
            heights = power[rows].mean(axis=0)
            found += [(float(heights[j]), k, int(j), rows) for j in np.flatnonzero(heights > MARK_FROM)]
    found.sort(key=lambda one: -one[0])
    axes, sure, marks = session_axes(analysis.series), analysis.diagnosis.settings.gap.map.significant, []
    for height, k, j, rows in found[:MOST_MARKS]:
        item, name = analysis.series[k], analysis.diagnosis.joints[j]
        words = [f"gap {np.sqrt(height):.1f} times the noise"]
        for place in analysis.diagnosis.where:
            if place.joint == name and place.axis in axes and place.p_value <= sure:
                middle = float(np.median(axes[place.axis](item, j)[rows]))
                if place.low <= middle <= place.high:
                    words.append(f"{axis_name(place.axis)} {interval_words(place.axis, place.low, place.high)}")
        marks.append(Mark(item.index, rows.start * item.step, rows.stop * item.step, name, ", ".join(words)))
    return marks


def gap_curves(analysis: Analysis) -> list[list[Curve]]:
    """What the tuned model leaves, run by run, with the named effects and without; the latter last: it is marked.

    Of very many runs only some have curves.
    """
    rungs = [("tuned", "after tuning", TUNED)]
    if analysis.diagnosis.findings:
        rungs.insert(0, ("named", "with the named effects", NAMED))
    curves: list[list[Curve]] = [[] for _ in analysis.session.runs]
    for item in analysis.series:
        curves[item.index] = [
            Curve(joint, ("residual", rung), words, colour, (item.after if rung == "named" else item.before)[:, j])
            for j, joint in enumerate(analysis.diagnosis.joints)
            for rung, words, colour in rungs
        ]
    return curves
