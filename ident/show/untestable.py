"""What recordings could not show, in three lines at most, and how small an effect would have been named."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ident.show.report.numbers import significant
from ident.show.report.words import effect_name, join_words, parameter_name

# Marks of a reason -> what lies behind it. What fits nowhere is a matter of the motion.
KINDS: tuple[tuple[str, tuple[str, ...]], ...] = (
    (
        "noise, or the URDF's tolerance, hides what is plausible of it",
        ("noise hides", "noise of", "tolerance hides", "tolerance of"),
    ),
    (
        "the arm, its sensors or its URDF can't show it",
        ("gear ratio", "no other joint", "no torque depends", "noisy", "temperature", "clock", "acts on no torque"),
    ),
    (
        "there are too few runs, or the two sets differ too much",
        ("one run a side", "the two sets", "runs", "days"),
    ),
    ("the motion shows too little of it", ()),
)


BOUNDS = {
    "encoder": "encoder noise",
    "torque": "torque noise",
    "tolerance": "the URDF's tolerance",
    "size": "smaller ones matter little",
}


def group_silent(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines such as: not testable, as the motion shows too little of it: backlash (joint_1), …

    Args:
        rows: Entries with `effect`, `joints` and `reason`.
    """
    return [f"not testable, as {reason}: {', '.join(items)}" for reason, items in silent_groups(rows)]


def silent_groups(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
    """Reasons, each with the effects that it keeps from being tested, and at which joints."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        kind = next(words for words, marks in KINDS if not marks or any(mark in row["reason"] for mark in marks))
        joints = found.setdefault(kind, {}).setdefault(str(row["effect"]), [])
        joints += [joint for joint in row.get("joints", []) if joint not in joints]
    order = [words for words, _ in KINDS]
    return [
        (reason, [_where(effect, joints) for effect, joints in found[reason].items()])
        for reason in sorted(found, key=order.index)
    ]


def _where(effect: str, joints: Sequence[str]) -> str:
    where = join_words(joints) if 0 < len(joints) <= 3 else f"{len(joints)} joints" if joints else "the arm"
    return f"{effect_name(effect)} ({where})"


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
            "joints": join_words(one["joints"]) if len(one["joints"]) <= 3 else "the whole arm",
            "limit": _limit(one),
            "bound": BOUNDS.get(one["bound_by"], one["bound_by"]),
        }
        for one in record.get("detectable", [])
    ]


def _limit(one: Mapping[str, Any]) -> str:
    if one["limit"] is None:
        return "shows nothing"
    name, unit = parameter_name(one["figure"])
    limit = f"{name} {one['named']} {significant(one['limit'])} {unit}".strip()
    return f"{limit}: more than is plausible" if one["hidden"] else limit
