"""Our own results as answers: a diagnosis where the URDF says how the arm should move, a comparison
where the arm before does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.benchmark.board.baselines import UNNAMED, spread_unnamed, undecided_record
from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.entry import SCHEMA
from ident.benchmark.board.files import Board
from ident.benchmark.board.recorded import TABLES

NOT_FITTED = ("refused", "not_testable")
"""Verdicts without a word on causes."""
UNEXPLAINED = "changed_unexplained"
MISSES: dict[str, float] = TABLES["missed"]
MISSED = MISSES["effects"] / MISSES["of_effects"]
"""Share of listed effects in real recordings that a diagnosis doesn't name."""
MISSED_CHANGES = MISSES["changes"] / MISSES["of_changes"]
"""The same of changes between two halves of a recording."""
Row = dict[str, Any]


def our_answer(
    name: str,
    record: Mapping[str, Any],
    board: Board,
    missed: float = MISSED,
) -> Row:
    """A diagnosis as an answer.

    Causes are taken as independent: with the probability that any is there, one of them is the
    cause, in proportion to their own; a class shares its probability beyond that of its first
    evenly. A change by no listed effect is other. Of what is left all effects have as much, evenly,
    as listed effects are missed, for one session without any; the rest of it is none or other, as
    the score of a cause outside the catalogue says. A share of one in all answers and one more goes
    to all of them evenly: nothing is impossible.

    Args:
        name: The session.
        record: The diagnosis.
        board: Where the session stands.
        missed: Share of listed effects that get no name.
    """
    if record["verdict"] in NOT_FITTED:
        return undecided_record(name, board)
    joints = board.sessions[name]["joints"]
    rows = _rows([*record["findings"], *record["reservations"]], board, joints)
    weights = [row.pop("weight") for row in rows]
    missing = float(np.prod([1.0 - row.pop("whole") for row in rows]))
    total = sum(weights)
    labels = len(board.effects) + 2
    smooth = 1.0 / (labels + 1)
    even = smooth / labels
    certain = (1.0 - smooth) * (1.0 - missing if total > 0.0 else 0.0)
    for row, weight in zip(rows, weights, strict=True):
        row["probability"] = certain * weight / total if total > 0.0 else 0.0
    outside = record.get("outside_score") or 0.0
    unlisted = sum(row["probability"] for row in rows if row["effect"] == OTHER)
    rows = [row for row in rows if row["effect"] != OTHER]
    answer: Row = {"schema": SCHEMA, "session": name, "effects": rows}
    unnamed = 1.0 - smooth - certain
    unseen = unnamed * missed / (1.0 + missed)
    rest = unnamed - unseen
    answer[NONE] = rest * (1.0 - outside) + even
    answer[OTHER] = rest * outside + unlisted + even
    each = even + unseen / len(board.effects)
    for row in rows:  # every effect has its even share once
        first = next(other for other in rows if other["effect"] == row["effect"])
        row["probability"] += each if first is row else 0.0
    return spread_unnamed({**answer, UNNAMED: each}, board, joints)


def as_diagnosis(record: Mapping[str, Any]) -> Row:
    """A comparison as a diagnosis of what came: without a name, what can't be explained is other."""
    unexplained = record["verdict"] == UNEXPLAINED and not record["changes"]
    return {
        "verdict": record["verdict"],
        "findings": record["changes"],
        "reservations": record["reservations"],
        "outside_score": float(unexplained),
    }


def _rows(
    findings: Sequence[Mapping[str, Any]],
    board: Board,
    joints: Sequence[str],
) -> list[Row]:
    """Names with a probability, and others of their classes; `whole` stands at the first alone."""
    rows: list[Row] = []
    for finding in findings:
        effect = finding.get("effect")
        first = finding.get("probability")
        if not effect or first is None:
            continue
        whole = float(finding.get("class_probability", first))
        if effect not in board.effects:
            rows.append({"effect": OTHER, "weight": whole, "whole": min(whole, 1.0)})
            continue
        others = [member for member in finding.get("class", ()) if member in board.effects]
        members = [effect, *(member for member in others if member != effect)]
        joint = _joint(effect, finding["joints"], board, joints)
        row: Row = {"effect": effect, "joint": joint, "class": members}
        row["parameters"] = _parameters(finding.get("parameters", {}))
        row["weight"] = float(first)
        row["whole"] = min(whole, 1.0)
        rows.append(row)
        for member in members[1:]:
            place = _joint(member, finding["joints"], board, joints)
            beside: Row = {"effect": member, "joint": place, "class": members}
            beside["weight"] = max(whole - float(first), 0.0) / (len(members) - 1)
            beside["whole"] = 0.0
            rows.append(beside)
    return rows


def _joint(effect: str, places: Sequence[str], board: Board, joints: Sequence[str]) -> str:
    if board.effects[effect]["scope"] == "arm":
        return ""
    return str(places[0]) if places else joints[0]


def _parameters(given: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Intervals with what a URDF may be off by, where they are told apart: a board's URDFs are."""
    parameters: dict[str, dict[str, float]] = {}
    for key, interval in given.items():
        if not isinstance(interval, Mapping):
            continue
        ends = {"value": interval.get("value")}
        for word in ("low", "high"):
            ends[word] = interval.get(f"{word}_with_urdf", interval.get(word))
        numbers = {word: float(end) for word, end in ends.items() if isinstance(end, int | float)}
        if len(numbers) == len(ends):
            parameters[key] = numbers
    return parameters
