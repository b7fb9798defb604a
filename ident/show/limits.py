"""How small an effect would have been named, in words: "payload above 0.12 kg"."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ident.show.report.numbers import significant
from ident.show.report.words import effect_name, join_words, parameter_name

WORDS = {
    "encoder": "encoder noise",
    "torque": "torque noise",
    "tolerance": "the URDF's tolerance",
    "size": "smaller ones matter little",
}


def describe_limits(record: Mapping[str, Any]) -> str:
    """One line about all effects that would have been named, each with its range over the joints; "" without any.

    Args:
        record: `ident.diagnosis/1`.
    """
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
    return [
        {
            "effect": effect_name(one["effect"]),
            "joints": _where(one["joints"]),
            "limit": _limit(one),
            "bound": WORDS.get(one["bound_by"], one["bound_by"]),
        }
        for one in record.get("detectable", [])
    ]


def _where(joints: Sequence[str]) -> str:
    return join_words(joints) if len(joints) <= 3 else "the whole arm"


def _limit(one: Mapping[str, Any]) -> str:
    if one["limit"] is None:
        return "shows nothing"
    name, unit = parameter_name(one["figure"])
    told = f"{name} {one['named']} {significant(one['limit'])} {unit}".strip()
    return f"{told}: more than is plausible" if one["hidden"] else told
