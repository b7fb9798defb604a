"""Where the gap lies: a strip of shaded cells a joint and axis, and the cells that matter in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ident.diagnosis.gap.settings import USUAL_MAP
from ident.show.report.numbers import fixed, percent, significant
from ident.show.report.page import Section
from ident.show.report.source import DiagnosisInput
from ident.show.report.words import axis_name, axis_unit, interval_words

MOST_SENTENCES = 5
# A cell this many times as dense as the mean has the darkest shade.
DENSEST = 3.0


@dataclass(frozen=True, eq=False)
class WhereSection(Section):
    """The cells that matter in words, then the map: against the tuned model, and against it as it is."""

    source: DiagnosisInput
    anchor: ClassVar[str] = "where"
    title: ClassVar[str] = "Where the gap lies"
    template: ClassVar[str] = "where.html"

    @property
    def is_present(self) -> bool:
        return bool(self.source.record.get("where") or self.source.record.get("maps"))

    def context(self) -> dict[str, Any]:
        record = self.source.record
        places = record.get("where", [])
        return {
            "sentences": [describe_place(p) for p in places if p["p_value"] <= USUAL_MAP.significant][:MOST_SENTENCES],
            "map": map_table(record.get("maps", []), record["joints"]),
            "fixed": map_table(record.get("maps_fixed", []), record["joints"]),
        }


def describe_place(place: Mapping[str, Any]) -> str:
    """A cell of the map in words."""
    where = interval_words(place["axis"], place["low"], place["high"])
    where = f"in moving {where}" if place["axis"] == "direction" else f"at {axis_name(place['axis'])} {where}"
    text = f"{place['joint']}: {percent(place['share_of_gap'])} of its gap lies {where}"
    if place.get("share_of_time") is not None:
        whole = "noise" if place["axis"] == "frequency" else "time"
        text += f", in {percent(place['share_of_time'])} of the {whole}"
    return f"{text} (p = {significant(place['p_value'], 1)})."


def map_table(strips: Sequence[Mapping[str, Any]], joints: Sequence[str]) -> dict[str, Any]:
    """Rows of strips: a row a joint, a column an axis."""
    axes = list(dict.fromkeys(strip["axis"] for strip in strips))
    table = {(strip["joint"], strip["axis"]): strip for strip in strips}
    told = [joint for joint in joints if any(joint == own for own, _ in table)]
    rows = [{"joint": j, "strips": [_strip(table[j, a]) if (j, a) in table else None for a in axes]} for j in told]
    heads = [{"name": axis_name(axis), "unit": axis_unit(axis)} for axis in axes]
    return {"axes": heads, "rows": rows}


def _strip(strip: Mapping[str, Any]) -> dict[str, Any]:
    """Cells of one axis, with what a pointer over them tells."""
    edges = strip["edges"]
    columns = ("share_of_gap", "share_of_time", "energy_J", "p_value")
    cells = []
    for k, (gap, time, energy, p_value) in enumerate(zip(*(strip[name] for name in columns), strict=True)):
        words = [f"{interval_words(strip['axis'], edges[k], edges[k + 1])}: {percent(gap)} of the gap"]
        words += [f"in {percent(time)} of the {'noise' if energy is None else 'time'}"]
        words += [] if energy is None else [f"{fixed(energy)} J"]
        cells.append(
            {
                "colour": shade(_depth(gap, time)),
                "sure": p_value <= USUAL_MAP.significant and gap > time,
                "share": percent(gap),
                "words": f"{', '.join(words)}, p = {significant(p_value, 1)}",
            }
        )
    low = 0.0 if abs(edges[0]) < 1e-3 * abs(edges[-1]) else edges[0]
    ends = ("−", "+") if strip["axis"] == "direction" else (significant(low), significant(edges[-1]))
    return {"cells": cells, "low": ends[0], "high": ends[1]}


def _depth(gap: float, time: float) -> float:
    """Shade of a cell by its density: none up to the mean, full at several times the mean."""
    return (gap / max(time, 1e-9) - 1.0) / (DENSEST - 1.0)


def shade(share: float) -> str:
    """White to a light orange that black text stays readable on."""
    depth = min(1.0, max(0.0, share))
    red, green, blue = (round(255 + depth * (end - 255)) for end in (240, 150, 70))
    return f"#{red:02x}{green:02x}{blue:02x}"
