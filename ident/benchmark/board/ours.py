"""Our own results as answers: a diagnosis where the URDF says how the arm should move, a comparison
where the arm before does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.baselines import UNNAMED, spread_unnamed, undecided_record
from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.entry import SCHEMA
from ident.benchmark.board.files import Board
from ident.benchmark.board.unnamed import (
    LISTED,
    NOTHING,
    SOMETHING,
    UNEXPLAINED,
    Shares,
    deal,
)
from ident.records import JsonRecord, JsonTable

NOT_FITTED = ("refused", "not_testable")
"""Verdicts without a word on causes."""
RISEN = "changed_unexplained"
Row = JsonRecord
Effects = Mapping[str, JsonTable]
"""The published list by id."""


@dataclass(frozen=True)
class NamedShares:
    """What a diagnosis says in probabilities.

    Attributes:
        rows: Names of listed effects, each with its probability.
        left: Probability that no name has, by what is said beside the names.
        even: What each answer has on top, whatever is said.
    """

    rows: tuple[Row, ...]
    left: Mapping[str, float]
    even: float


def read_said(record: JsonTable, effects: Effects, joints: Sequence[str]) -> NamedShares:
    """The probabilities of a diagnosis that was fitted.

    The true distribution of a session is even over what is wrong in it; a name gets its mean share
    of that, causes taken as independent. Within a class it is dealt by the probabilities of its
    members; those beside the first have the same. A share of one in all answers and one more goes
    to all of them evenly: nothing is impossible.

    Args:
        record: The diagnosis.
        effects: The published list.
        joints: Of the session.
    """
    classes = list(_classes([*record["findings"], *record["reservations"]], effects, joints))
    labels = len(effects) + 2
    smooth = 1.0 / (labels + 1)
    shares = (1.0 - smooth) * mean_shares([whole for whole, _ in classes])
    listed: list[Row] = []
    unlisted = 0.0
    for share, (_, rows) in zip(shares, classes, strict=True):
        if rows[0]["effect"] == OTHER:
            unlisted += float(share)
            continue
        listed += [{**row, "probability": float(share * row["probability"])} for row in rows]
    is_named = any(finding.get("effect") in effects for finding in record["findings"])
    unexplained = float(record.get("outside_score") or 0.0)
    unnamed = 1.0 - smooth - float(shares.sum())
    left = {
        SOMETHING if is_named else NOTHING: unnamed * (1.0 - unexplained),
        UNEXPLAINED: unnamed * unexplained + unlisted,
    }
    return NamedShares(tuple(listed), left, smooth / labels)


def mean_shares(probabilities: Sequence[float]) -> Float[Array, " K"]:
    """Mean share of each of several independent causes in all that is there.

    A cause that is there beside s others has the share 1 / (1 + s); the mean over them is
    p_k sum_s P(s others) / (1 + s). All together have the probability that any is there.

    Args:
        probabilities: Of each cause.
    """
    shares = np.zeros(len(probabilities))
    for index, probability in enumerate(probabilities):
        others = np.ones(1)  # probability of each number of others
        for other in (*probabilities[:index], *probabilities[index + 1 :]):
            others = np.convolve(others, [1.0 - other, other])
        shares[index] = probability * np.sum(others / np.arange(1, len(others) + 1))
    return shares


def our_answer(name: str, record: JsonTable, board: Board, shares: Shares) -> Row:
    """A diagnosis as an answer: what no name has goes where causes without a name are.

    Args:
        name: The session.
        record: The diagnosis.
        board: Where the session stands.
        shares: Where causes are that have no name, as fitted to other sessions.
    """
    if record["verdict"] in NOT_FITTED:
        return undecided_record(name, board)
    joints = board.sessions[name]["joints"]
    said = read_said(record, board.effects, joints)
    places = deal(said.left, shares)
    rows = [dict(row) for row in said.rows]
    answer: Row = {"schema": SCHEMA, "session": name, "effects": rows}
    answer[NONE] = places[NONE] + said.even
    answer[OTHER] = places[OTHER] + said.even
    each = said.even + places[LISTED] / len(board.effects)
    for row in rows:  # every effect has its even share once
        first = next(other for other in rows if other["effect"] == row["effect"])
        row["probability"] += each if first is row else 0.0
    return spread_unnamed({**answer, UNNAMED: each}, board, joints)


def as_diagnosis(record: JsonTable) -> Row:
    """A comparison as a diagnosis of what came; without a name, a gap that rose is unexplained."""
    unexplained = record["verdict"] == RISEN and not record["changes"]
    return {
        "verdict": record["verdict"],
        "joints": record["joints"],
        "findings": record["changes"],
        "reservations": record["reservations"],
        "outside_score": float(unexplained),
    }


def _classes(
    findings: Sequence[JsonTable],
    effects: Effects,
    joints: Sequence[str],
) -> Iterator[tuple[float, list[Row]]]:
    """Each class with its probability, and its members with their shares of it, the first first."""
    for finding in findings:
        effect = finding.get("effect")
        first = finding.get("probability")
        if not effect or first is None:
            continue
        whole = min(float(finding.get("class_probability", first)), 1.0)
        if whole <= 0.0:
            continue
        if effect not in effects:
            yield whole, [{"effect": OTHER}]
            continue
        others = [member for member in finding.get("class", ()) if member in effects]
        members = [effect, *(member for member in others if member != effect)]
        share = min(float(first) / whole, 1.0) if len(members) > 1 else 1.0
        rows: list[Row] = []
        for member in members:
            joint = _joint(member, finding["joints"], effects, joints)
            rows.append({"effect": member, "joint": joint, "class": members, "probability": share})
            share = (1.0 - rows[0]["probability"]) / max(len(members) - 1, 1)
        rows[0]["parameters"] = _parameters(finding.get("parameters", {}))
        yield whole, rows


def _joint(effect: str, places: Sequence[str], effects: Effects, joints: Sequence[str]) -> str:
    if effects[effect]["scope"] == "arm":
        return ""
    return str(places[0]) if places else joints[0]


def _parameters(given: JsonTable) -> dict[str, dict[str, float]]:
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
