"""The page of a comparison: what changed and what to do, every change with its figures, what could not be told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ident.errors import plural
from ident.show.changes import (
    OF_THE_ARM,
    describe_spread,
    describe_still,
    describe_used,
    headline,
    places_of,
    without_still,
)
from ident.show.report.numbers import fixed, percent
from ident.show.report.page import Section, render_page
from ident.show.report.sections import facts_section, provenance_facts, telemetry_section
from ident.show.report.words import effect_name, join_words, parameter_cells, sentence
from ident.show.untestable import silent_groups


def render_comparison_report(record: Mapping[str, Any]) -> str:
    """The page as text: one sentence, then each change with what to do about it."""
    heldout, after = record["heldout"], record["heldout"]["rms_after_Nm"]
    values = {
        "headline": headline(record),
        "changes": [_card(change) for change in record["changes"]],
        "doubts": [
            f"Not told: {effect_name(one['effect'] or '')} in {join_words(one['joints'])}: {one['reason']}."
            for one in record.get("reservations", [])
        ],
        "rows": [
            {"joint": joint, "before": before, "after": after[joint], "noise": heldout["noise_Nm"][joint]}
            for joint, before in heldout["rms_before_Nm"].items()
        ],
        "spread": describe_spread(record["friction_run_spread"]),
        "still": [f"{sentence(line)}." for line in (*describe_used(record), *describe_still(record))],
        "silent": silent_groups(without_still(record)),
        "fatal": [issue for issue in record["telemetry"] if issue["severity"] == "fatal"],
    }
    sections = [
        Section("verdict", "Verdict", "changes.html", values),
        telemetry_section(record["telemetry"]),
        facts_section(provenance_facts(record)),
    ]
    sides = [
        f"{name}: {', '.join(record[name]['sessions'][:4])}{' …' if len(record[name]['sessions']) > 4 else ''} "
        f"({plural(record[name]['runs'], 'run')}, {record[name]['duration_s']:.0f} s)"
        for name in ("before", "after")
    ]
    return render_page(f"What changed: {record['robot']}", sections, " · ".join([record["robot"], *sides]))


def _card(change: Mapping[str, Any]) -> dict[str, Any]:
    heldout = change["heldout"]
    name = effect_name(change["effect"])
    return {
        "effect": sentence(name),
        "joints": "" if change["effect"] in OF_THE_ARM else places_of(change),
        "action": sentence(change["action"]),
        "twins": join_words([effect_name(one) for one in change["class"] if one != change["effect"]]),
        "gain": fixed(heldout["gain_rms_Nm"]),
        "shrink": percent(heldout["shrink"]),
        "torque": [
            f"{joint} {fixed(before)} → {fixed(heldout['rms_after_Nm'][joint])} N m"
            for joint, before in heldout["rms_before_Nm"].items()
        ],
        "parameters": [parameter_cells(key, value) for key, value in change["parameters"].items()],
    }
