"""What recordings could not test, and how large an effect would have been named: in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ident.errors import join_words
from ident.show.report.finding_words import in_units_of
from ident.show.report.numbers import MOST_NAMED
from ident.show.report.words import TABLES, effect_name, parameter_name, significant

# A result, or a part of it, as JSON has it.
Record = Mapping[str, Any]

UNTESTABLE: list[dict[str, Any]] = TABLES["untestable"]


def group_silent(rows: Sequence[Record]) -> list[str]:
    """Lines such as: not testable, as the motion shows too little of it: backlash (joint_1), …"""
    lines = []
    for reason, items in silent_groups(rows):
        lines.append(f"not testable, as {reason}: {', '.join(items)}")
    return lines


def silent_groups(rows: Sequence[Record]) -> list[tuple[str, list[str]]]:
    """Reasons, each with the effects that it keeps from being tested, and at which joints."""
    groups: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        effects = groups.setdefault(_kind_of(row["reason"]), {})
        joints = effects.setdefault(str(row["effect"]), [])
        joints += [joint for joint in row.get("joints", []) if joint not in joints]
    told: list[tuple[str, list[str]]] = []
    for kind in (entry["words"] for entry in UNTESTABLE):
        if kind in groups:
            effects = groups[kind]
            items = [f"{effect_name(name)} ({_few(joints)})" for name, joints in effects.items()]
            told.append((kind, items))
    return told


def _kind_of(reason: str) -> str:
    """What lies behind a reason why an effect could not be tested, in words."""
    for entry in UNTESTABLE:
        if any(mark in reason for mark in entry["marks"]):
            return str(entry["words"])
    raise LookupError(reason)


def _few(joints: Sequence[str]) -> str:
    """Some joints by their names, more of them by their number; of none the arm."""
    if not joints:
        return "the arm"
    return join_words(joints) if len(joints) <= MOST_NAMED else f"{len(joints)} joints"


def describe_limits(record: Record) -> str:
    """One line about all effects that would have been named, each with its range over the joints;
    "" without any.
    """
    limits: dict[tuple[str, str, str], list[float]] = {}
    for row in record.get("detectable", []):
        if not row["hidden"] and row["limit"] is not None:
            unit = parameter_name(row["figure"])[1]
            unit = in_units_of(row["joints"], record, unit, row["effect"])
            limits.setdefault((row["effect"], row["named"], unit), []).append(row["limit"])
    ranges = []
    for (effect, named, unit), sizes in limits.items():
        low = significant(min(sizes))
        high = significant(max(sizes))
        span = low if low == high else f"{low} to {high}"
        ranges.append(f"{effect_name(effect)} {named} {span} {unit}".strip())
    return f"would have been named nine times in ten: {', '.join(ranges)}" if ranges else ""


def limit_rows(record: Record) -> list[dict[str, str]]:
    """A row for each effect and joint: what would have been named, and what bounds it.

    Returns:
        Rows of "effect", "joints", "limit" and "bound".
    """
    rows = []
    for entry in record.get("detectable", []):
        limit = "shows nothing"
        if entry["limit"] is not None:
            name, unit = parameter_name(entry["figure"])
            limit = f"{name} {entry['named']} {significant(entry['limit'])} {unit}".strip()
            limit += ": more than is plausible" if entry["hidden"] else ""
        joints = entry["joints"]
        row = {
            "effect": effect_name(entry["effect"]),
            "joints": join_words(joints) if len(joints) <= MOST_NAMED else "the whole arm",
            "limit": in_units_of(joints, record, limit, entry["effect"]),
            "bound": TABLES["bounds"].get(entry["bound_by"], entry["bound_by"]),
        }
        rows.append(row)
    return rows
