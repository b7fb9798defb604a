"""The named effects, the most telling first: how sure, how large, how far they shrink the gap, and their twins."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ident.show.report.numbers import pair, percent, significant
from ident.show.report.page import Section
from ident.show.report.source import DiagnosisInput
from ident.show.report.words import effect_name, join_words, parameter_name

# Figures that are counted, not measured.
COUNTED = frozenset({"order", "link", "other_joint"})


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
        runs = self.source.record.get("session", {}).get("runs", 2)
        return {"findings": [{**finding_card(finding, runs), "picture": picture} for finding, picture in cards]}


def finding_card(finding: Mapping[str, Any], runs: int) -> dict[str, Any]:
    """A finding as text; of a single run its energy error has no spread."""
    heldout = finding["heldout"]
    twins = [effect_name(effect) for effect in finding.get("class", []) if effect != finding["effect"]]
    return {
        "effect": effect_name(finding["effect"])[0].upper() + effect_name(finding["effect"])[1:],
        "joints": join_words(finding["joints"]),
        "probability": percent(finding.get("probability")),
        "twins": join_words(twins),
        "action": _sentence(finding.get("action", "")),
        "gain": significant(heldout["gain_rms_Nm"]) if "gain_rms_Nm" in heldout else "",
        "shrink": percent(heldout["shrink"]),
        "share": percent(heldout.get("share")) if "share" in heldout else "",
        "bar": round(100.0 * float(np.clip(heldout["shrink"], 0.0, 1.0)), 1),
        "torque": [
            f"{joint} {significant(before)} → {significant(heldout['rms_after_Nm'].get(joint))} N m"
            for joint, before in heldout["rms_before_Nm"].items()
        ],
        "energy": f"{_energy(heldout, 'before', runs)} → {_energy(heldout, 'after', runs)} J",
        "parameters": [parameter_row(name, value) for name, value in finding.get("parameters", {}).items()],
    }


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def _energy(heldout: Mapping[str, Any], when: str, runs: int) -> str:
    """Mean energy error of a run, with its spread over the runs where there are several."""
    spread = heldout.get(f"energy_error_{when}_std_J") if runs > 1 else None
    return pair(heldout.get(f"energy_error_{when}_J"), spread)


def parameter_row(name: str, value: Any) -> dict[str, str]:
    """A figure with its unit and interval as a row of a table."""
    words, unit = parameter_name(name)
    if isinstance(value, Mapping) and name in COUNTED:
        return {"name": words, "unit": unit, "value": f"{value['value']:.0f}", "interval": ""}
    if not isinstance(value, Mapping):
        return {"name": words, "unit": unit, "value": str(value), "interval": ""}
    interval = f"{significant(value.get('low'), 3)} to {significant(value.get('high'), 3)}"
    return {"name": words, "unit": unit, "value": significant(value["value"], 3), "interval": interval}
