"""The page of a comparison: what changed and what to do, every change with its figures, what could not be told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ident.errors import plural
from ident.recordings.recording import TelemetryIssue
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
from ident.show.report.provenance import FactsSection, provenance_facts
from ident.show.report.telemetry import TelemetrySection
from ident.show.report.words import effect_name, join_words, parameter_cells
from ident.show.untestable import silent_groups

TITLE = "What changed"


@dataclass(frozen=True, eq=False)
class ChangesSection(Section):
    """One sentence, then each change with what to do about it."""

    record: Mapping[str, Any]
    anchor: ClassVar[str] = "verdict"
    title: ClassVar[str] = "Verdict"
    template: ClassVar[str] = "changes.html"

    def context(self) -> dict[str, Any]:
        record = self.record
        heldout = record["heldout"]
        return {
            "headline": headline(record),
            "changes": [_card(change) for change in record["changes"]],
            "doubts": [
                f"Not told: {effect_name(one['effect'] or '')} in {join_words(one['joints'])}: {one['reason']}."
                for one in record.get("reservations", [])
            ],
            "rows": [
                {"joint": joint, "before": before, "after": heldout["rms_after_Nm"][joint], "noise": noise}
                for (joint, before), noise in zip(
                    heldout["rms_before_Nm"].items(), heldout["noise_Nm"].values(), strict=True
                )
            ],
            "spread": describe_spread(record["friction_run_spread"]),
            "still": [f"{line[0].upper()}{line[1:]}." for line in (*describe_used(record), *describe_still(record))],
            "silent": silent_groups(without_still(record)),
            "fatal": [issue for issue in record["telemetry"] if issue["severity"] == "fatal"],
        }


def _card(change: Mapping[str, Any]) -> dict[str, Any]:
    heldout = change["heldout"]
    name = effect_name(change["effect"])
    return {
        "effect": name[0].upper() + name[1:],
        "joints": "" if change["effect"] in OF_THE_ARM else places_of(change),
        "action": change["action"][0].upper() + change["action"][1:],
        "twins": join_words([effect_name(one) for one in change["class"] if one != change["effect"]]),
        "gain": fixed(heldout["gain_rms_Nm"]),
        "shrink": percent(heldout["shrink"]),
        "torque": [
            f"{joint} {fixed(before)} → {fixed(heldout['rms_after_Nm'][joint])} N m"
            for joint, before in heldout["rms_before_Nm"].items()
        ],
        "parameters": [parameter_cells(key, value) for key, value in change["parameters"].items()],
    }


def comparison_sections(record: Mapping[str, Any]) -> list[Section]:
    """All sections, the verdict first."""
    issues = [
        TelemetryIssue(one["issue"], tuple(one["joints"]), one["severity"], one["evidence"], one["remedy"])
        for one in record["telemetry"]
    ]
    return [ChangesSection(record), TelemetrySection(issues), FactsSection(provenance_facts(record))]


def _subtitle(record: Mapping[str, Any]) -> str:
    sides = [
        f"{name}: {', '.join(record[name]['sessions'][:4])}{' …' if len(record[name]['sessions']) > 4 else ''} "
        f"({plural(record[name]['runs'], 'run')}, {record[name]['duration_s']:.0f} s)"
        for name in ("before", "after")
    ]
    return " · ".join([record["robot"], *sides])


def render_comparison_report(record: Mapping[str, Any]) -> str:
    """The page as text."""
    return render_page(f"{TITLE}: {record['robot']}", comparison_sections(record), _subtitle(record))
