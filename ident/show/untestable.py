"""What recordings could not show, in at most three lines instead of a row an effect and joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ident.show.report.words import effect_name, join_words

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


def group_silent(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Lines such as: not testable, as the motion shows too little of it: backlash (joint_1), …

    Args:
        rows: Entries with `effect`, `joints` and `reason`.
    """
    lines = []
    for reason, items in silent_groups(rows):
        lines.append(f"not testable, as {reason}: {', '.join(items)}")
    return lines


def silent_groups(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, list[str]]]:
    """Reasons, each with the effects that it keeps from being tested, and at which joints."""
    found: dict[str, dict[str, list[str]]] = {}
    for row in rows:
        joints = found.setdefault(_kind(str(row["reason"])), {}).setdefault(str(row["effect"]), [])
        joints += [joint for joint in row.get("joints", []) if joint not in joints]
    order = [words for words, _ in KINDS]
    return [
        (reason, [_where(effect, joints) for effect, joints in found[reason].items()])
        for reason in sorted(found, key=order.index)
    ]


def _kind(reason: str) -> str:
    return next(words for words, marks in KINDS if not marks or any(mark in reason for mark in marks))


def _where(effect: str, joints: Sequence[str]) -> str:
    where = join_words(joints) if 0 < len(joints) <= 3 else f"{len(joints)} joints" if joints else "the arm"
    return f"{effect_name(effect)} ({where})"
