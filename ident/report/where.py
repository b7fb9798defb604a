"""Where the gap lies: a map of joints against speed, load, position and the rest, and its densest cells in words."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from ident.report.numbers import percent, significant
from ident.report.page import Section
from ident.report.source import DiagnosisInput, WhereMap
from ident.report.words import axis_name, interval_words

SIGNIFICANT = 0.05
MOST_SENTENCES = 5


@dataclass(frozen=True, eq=False)
class WhereSection(Section):
    """The densest cell of every joint and axis; then full maps, if there are any."""

    source: DiagnosisInput
    anchor: ClassVar[str] = "where"
    title: ClassVar[str] = "Where the gap lies"
    template: ClassVar[str] = "where.html"

    @property
    def is_present(self) -> bool:
        return bool(self.source.record.get("where") or self.source.maps)

    def context(self) -> dict[str, Any]:
        places = self.source.record.get("where", [])
        axes = list(dict.fromkeys(place["axis"] for place in places))
        told = {place["joint"] for place in places}
        joints = [joint for joint in self.source.record["joints"] if joint in told]
        return {
            "axes": [axis_name(axis) for axis in axes],
            "rows": [{"joint": joint, "cells": [_densest(places, joint, axis) for axis in axes]} for joint in joints],
            "sentences": [describe_place(p) for p in places if p["p_value"] <= SIGNIFICANT][:MOST_SENTENCES],
            "maps": [full_map(one) for one in self.source.maps],
        }


def describe_place(place: Mapping[str, Any]) -> str:
    """A cell of the map in words."""
    where = interval_words(place["axis"], place["low"], place["high"])
    where = f"in moving {where}" if place["axis"] == "direction" else f"at {axis_name(place['axis'])} {where}"
    text = f"{place['joint']}: {percent(place['share_of_gap'])} of its gap lies {where}"
    if place.get("share_of_time") is not None:
        text += f", in {percent(place['share_of_time'])} of the time"
    return f"{text} (p = {significant(place['p_value'], 1)})."


def _densest(places: Sequence[Mapping[str, Any]], joint: str, axis: str) -> dict[str, Any] | None:
    """The cell of one joint and axis that holds the largest share of the gap, significant ones first."""
    own = [place for place in places if place["joint"] == joint and place["axis"] == axis]
    if not own:
        return None
    best = min(own, key=lambda place: (place["p_value"] > SIGNIFICANT, -place["share_of_gap"]))
    return {
        "where": interval_words(axis, best["low"], best["high"]),
        "share": percent(best["share_of_gap"]),
        "sure": best["p_value"] <= SIGNIFICANT,
        "colour": shade(best["share_of_gap"] if best["p_value"] <= SIGNIFICANT else 0.0),
    }


def full_map(one: WhereMap) -> dict[str, Any]:
    """All cells of one axis."""
    edges = one.edges
    return {
        "axis": axis_name(one.axis),
        "unit": one.unit,
        "bins": [f"{significant(low)} to {significant(high)}" for low, high in itertools.pairwise(edges)],
        "rows": [
            {"joint": joint, "cells": [{"share": percent(s), "colour": shade(float(s))} for s in shares]}
            for joint, shares in zip(one.joints, one.share, strict=True)
        ],
    }


def shade(share: float) -> str:
    """White to a light orange that black text stays readable on."""
    depth = min(1.0, max(0.0, share))
    red, green, blue = (round(255 + depth * (end - 255)) for end in (240, 150, 70))
    return f"#{red:02x}{green:02x}{blue:02x}"
