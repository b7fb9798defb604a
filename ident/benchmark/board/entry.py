"""Answers of one entrant: read, checked, and as a distribution over what may be wrong."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.files import Board
from ident.errors import InputError
from ident.safe_read import LARGEST_FIGURE, read_json

SCHEMA = "ident.board_answer/1"
EVENLY = "evenly"
"""Key of an answer: probability that is dealt evenly to all effects, to none and to other."""
NOWHERE = "-"
"""Joint of an effect that nobody named: it stands at none."""
SUM_ERROR = 1e-3  # by which probabilities may miss one, as rounded ones do
WRITE = "write it as README.md of the board says"


@dataclass(frozen=True)
class Named:
    """One effect at one joint."""

    effect: str
    joint: str  # empty for the whole arm; NOWHERE of what nobody named
    probability: float
    members: tuple[str, ...]  # effects that are not told apart, itself first
    parameters: Mapping[str, Mapping[str, float]]  # value, low and high by name


@dataclass(frozen=True)
class Answer:
    """What an entrant says of a session."""

    named: tuple[Named, ...]
    none: float
    other: float

    def shares(self) -> dict[str, float]:
        """Probability of each effect in the order of the names, then of `none` and of `other`."""
        total: dict[str, float] = {}
        for name in self.named:
            total[name.effect] = total.get(name.effect, 0.0) + name.probability
        return {**total, NONE: self.none, OTHER: self.other}

    def best_of(self, effect: str) -> Named | None:
        """The most probable name of an effect."""
        names = [name for name in self.named if name.effect == effect]
        return max(names, key=lambda name: name.probability, default=None)


def undecided(effects: Sequence[str]) -> Answer:
    """All answers equally probable."""
    share = 1.0 / (len(effects) + 2)
    return Answer(tuple(_unnamed(effects, share)), share, share)


def _unnamed(effects: Iterable[str], share: float) -> Iterator[Named]:
    for effect in effects:
        yield Named(effect, NOWHERE, share, (effect,), {})


def read_answer(path: Path, board: Board, session: str) -> Answer:
    """An entrant's answer to a session.

    Raises:
        InputError: It is none: another schema or session, unknown names, probabilities that are
            none or don't add up to one.
    """
    record = read_json(path, WRITE)
    if record.get("schema") != SCHEMA or record.get("session") != session:
        what = f"schema {record.get('schema')!r} and session {record.get('session')!r}"
        raise InputError(path, what, f'write "schema": "{SCHEMA}" and "session": "{session}"')
    listed = record.get("effects", [])
    if not isinstance(listed, list):
        raise InputError(path, "effects is no list", WRITE)
    joints = board.sessions[session]["joints"]
    named = tuple(_named(path, row, board, joints) for row in listed)
    none = _probability(path, NONE, record.get(NONE, 0.0))
    other = _probability(path, OTHER, record.get(OTHER, 0.0))
    evenly = _probability(path, EVENLY, record.get(EVENLY, 0.0))
    total = sum(name.probability for name in named) + none + other + evenly
    if abs(total - 1.0) > SUM_ERROR:
        raise InputError(path, f"its probabilities add up to {total:.4g}", "make them add up to 1")
    if evenly:
        share = evenly / (len(board.effects) + 2)
        named += tuple(_unnamed(board.effects, share))
        none += share
        other += share
    return Answer(named, none, other)


def _named(path: Path, row: Any, board: Board, joints: Sequence[str]) -> Named:
    if not isinstance(row, Mapping):
        raise InputError(path, f"{row!r} is no effect", WRITE)
    effect = _effect(path, row.get("effect"), board)
    joint = row.get("joint", "")
    whole = board.effects[effect]["scope"] == "arm"
    allowed = ["", *joints] if whole else list(joints)
    if joint not in allowed:
        remedy = f"choose from: {', '.join(allowed)}"
        raise InputError(path, f"{effect} stands at {joint!r}", remedy)
    members = row.get("class", [effect])
    if not isinstance(members, list):
        raise InputError(path, f"the class of {effect} is no list", WRITE)
    others = [_effect(path, member, board) for member in members]
    probability = _probability(path, effect, row.get("probability"))
    parameters = _parameters(path, effect, row.get("parameters", {}))
    return Named(effect, joint, probability, tuple(dict.fromkeys([effect, *others])), parameters)


def _effect(path: Path, effect: Any, board: Board) -> str:
    if not isinstance(effect, str) or effect not in board.effects:
        known = ", ".join(board.effects)
        raise InputError(path, f"there is no effect {effect!r}", f"choose from: {known}")
    return effect


def _probability(path: Path, name: str, value: Any) -> float:
    if not _is_number(value) or not 0.0 <= value <= 1.0:
        raise InputError(path, f"the probability of {name} is {value!r}", "give 0 to 1")
    return float(value)


def _parameters(path: Path, effect: str, given: Any) -> dict[str, dict[str, float]]:
    if not isinstance(given, Mapping):
        raise InputError(path, f"the parameters of {effect} are no table", WRITE)
    parameters: dict[str, dict[str, float]] = {}
    for key, interval in given.items():
        ends: dict[str, float] = {}
        for word in ("value", "low", "high"):
            number = interval.get(word) if isinstance(interval, Mapping) else None
            if number is None:
                raise InputError(path, f"{key} of {effect} has no {word}", "give value, low, high")
            if not _is_number(number):
                what = f"{word} of {key} of {effect} is {number!r}"
                remedy = f"give numbers within ±{LARGEST_FIGURE:g}, or leave the parameter out"
                raise InputError(path, what, remedy)
            ends[word] = float(number)
        parameters[str(key)] = ends
    return parameters


def _is_number(value: Any) -> bool:
    is_one = isinstance(value, int | float) and not isinstance(value, bool)
    return is_one and abs(value) <= LARGEST_FIGURE
