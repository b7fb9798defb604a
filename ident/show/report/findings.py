"""The named effects, the most telling first: how sure, how large, how far they shrink the gap, and their twins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.show.report.diagnosis_verdict import order_of
from ident.show.report.numbers import pair, percent, significant
from ident.show.report.page import Section
from ident.show.report.source import DiagnosisInput
from ident.show.report.words import effect_name, join_words, parameter_cells


@dataclass(frozen=True, eq=False)
class FindingsSection(Section):
    """One card a finding."""

    source: DiagnosisInput
    anchor: ClassVar[str] = "findings"
    title: ClassVar[str] = "What causes it, and what to do"
    template: ClassVar[str] = "findings.html"

    @property
    def is_present(self) -> bool:
        return bool(self.source.record.get("findings"))

    def context(self) -> dict[str, Any]:
        findings, pictures = self.source.record["findings"], self.source.pictures
        drawn = [*pictures, *[None] * (len(findings) - len(pictures))]
        cards = zip(findings, drawn, strict=False)
        record = self.source.record
        return {"findings": [{**finding_card(finding, record), "picture": picture} for finding, picture in cards]}


def finding_card(finding: Mapping[str, Any], record: Mapping[str, Any]) -> dict[str, Any]:
    """A finding of a record as text; of a single run its energy error has no spread."""
    runs = record.get("session", {}).get("runs", 2)
    heldout = finding["heldout"]
    twins = [effect_name(effect) for effect in finding.get("class", []) if effect != finding["effect"]]
    return {
        "effect": effect_name(finding["effect"])[0].upper() + effect_name(finding["effect"])[1:],
        "joints": join_words(finding["joints"]),
        "probability": percent(finding.get("probability")),
        "twins": join_words(twins),
        "action": _sentence(order_of(finding, record)),
        "gain": significant(heldout["gain_rms_Nm"]) if "gain_rms_Nm" in heldout else "",
        "shrink": percent(heldout["shrink"]),
        "share": percent(heldout.get("share")) if "share" in heldout else "",
        "bar": round(100.0 * float(np.clip(heldout["shrink"], 0.0, 1.0)), 1),
        "torque": [
            f"{joint} {significant(before)} → {significant(heldout['rms_after_Nm'].get(joint))} N m"
            for joint, before in heldout["rms_before_Nm"].items()
        ],
        "energy": f"{energy_pair(heldout, 'before', runs)} → {energy_pair(heldout, 'after', runs)} J",
        "parameters": [parameter_cells(name, value) for name, value in finding.get("parameters", {}).items()],
    }


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def energy_pair(heldout: Mapping[str, Any], when: str, runs: int) -> str:
    """Mean energy error of a run, with its spread over the runs where there are several."""
    spread = heldout.get(f"energy_error_{when}_std_J") if runs > 1 else None
    return pair(heldout.get(f"energy_error_{when}_J"), spread)
