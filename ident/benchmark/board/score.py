"""Scores of entrants: how probable they held what was true, whether their first name is right, what
their intervals hold, and how well they foretell a torque.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.board.case import NONE, OTHER, TIERS
from ident.benchmark.board.entry import Answer, Named, read_answer, undecided
from ident.benchmark.board.files import Board, Kept, joint_columns, read_columns
from ident.benchmark.board.sealing import digest_of
from ident.benchmark.scores import Score, is_inside, mean, share
from ident.errors import InputError
from ident.outputs import sha256_of
from ident.records import JsonRecord, JsonTable
from ident.safe_read import LARGEST_FIGURE, LARGEST_TEXT, require_regular, unchanged

# What is held less probable counts as this much: no board of some hundred sessions can tell less.
LEAST_PROBABILITY = 1e-3
HALF = 0.5
# Upper ends of what shows hardly, and of what shows as much as what the ordinary model leaves
# [noise floors]: boards ask for one and for three of them. For the table alone.
AMPLITUDE_ENDS = (0.5, 1.5)
AMPLITUDES = ("hidden", "as the noise", "above the noise")
"""How much of an effect shows beside what the ordinary model leaves of the torque."""
SHAPELESS = ("order", "other_joint")
"""Parameters that are no size: an interval of them says nothing."""
Row = JsonRecord


@dataclass(frozen=True)
class SessionScore:
    """What an answer to one session is worth."""

    tier: str
    kind: str
    log_score: float  # -log of the probability of what is true, mean over it
    strict: bool  # whether the most probable answer is true
    classed: bool  # whether what is true is in its class
    class_size: int | None  # of the most probable answer; None where that is no effect
    joint: bool | None  # whether a right effect stands where it may; None where none is right
    intervals: tuple[tuple[bool, float], ...]  # of named causes: holds it, half-width over size
    amplitude: str | None = None  # of what shows least; None of nothing, or where nobody knows


def score_answer(answer: Answer, truth: JsonTable, tier: str) -> SessionScore:
    """Scores an answer by its opened truth."""
    effects = list(truth["effects"])
    labels = [set(labels_of(effect)) for effect in effects] or [{NONE}]
    true = set().union(*labels)
    shares = answer.shares()
    logs: list[float] = []
    for accepted in labels:
        probability = sum(shares.get(label, 0.0) for label in accepted)
        # The true distribution is even over what is wrong.
        logs.append(-math.log(max(probability, LEAST_PROBABILITY)))
    first = max(shares, key=lambda label: shares[label])
    name = answer.best_of(first)
    members = {first} if name is None else set(name.members)
    right = [effect for effect in effects if name and name.effect in labels_of(effect)]
    joint = None
    if right and name is not None:
        joint = any(_stands(name, effect) for effect in right)
    return SessionScore(
        tier=tier,
        kind=str(truth["kind"]),
        log_score=float(np.mean(logs)),
        strict=first in true,
        classed=bool(members & true),
        class_size=None if name is None else len(members),
        joint=joint,
        intervals=tuple(_intervals(answer, effects)),
        amplitude=amplitude_of(effects),
    )


def amplitude_of(effects: Sequence[Row]) -> str | None:
    """How much shows of the effect that shows least, at the joint where it shows most; None without
    effects, or where it was not worked out.
    """
    shown = [max(effect.get("visible", {}).values(), default=None) for effect in effects]
    numbers = [float(number) for number in shown if number is not None]
    if not numbers or len(numbers) < len(shown):
        return None
    return AMPLITUDES[int(np.searchsorted(AMPLITUDE_ENDS, min(numbers)))]


def labels_of(effect: JsonTable) -> list[str]:
    """Answers that are right of a truth."""
    if not effect["in_catalogue"]:
        return [OTHER]
    return [str(effect["effect"]), *effect.get("also", ())]


def _stands(name: Named, effect: JsonTable) -> bool:
    allowed = effect["may_stand_at"]
    return not allowed or not name.joint or name.joint in allowed


def _intervals(
    answer: Answer,
    effects: Sequence[JsonTable],
) -> Iterator[tuple[bool, float]]:
    """Of effects that were given half of their true share or more: an interval beside a name that
    its giver holds improbable is said of nothing.
    """
    shares = answer.shares()
    for effect in effects:
        name = answer.best_of(str(effect["effect"]))
        if name is None or not _stands(name, effect):
            continue
        if shares[name.effect] < HALF / len(effects):
            continue
        for key, value in effect.get("parameters", {}).items():
            given = name.parameters.get(key)
            if given is None or not isinstance(value, int | float) or key in SHAPELESS:
                continue
            low = given["low"]
            high = given["high"]
            half = 0.5 * (high - low) / max(abs(float(value)), 1e-12)
            yield is_inside(key, float(value), low, high), half


# Prediction


@dataclass(frozen=True)
class PredictionScore:
    """How far a foretold torque is off."""

    tier: str
    rms: float  # over all rows and joints [N m]
    share: float  # root mean square over joints of error over spread


def score_torque(
    foretold: Float[Array, "T n"],
    torque: Float[Array, "T n"],
    tier: str,
) -> PredictionScore:
    """Scores a foretold torque against the recorded one.

    Args:
        foretold: The entrant's [N m].
        torque: The recorded one [N m].
        tier: The session's.
    """
    error = np.sqrt(np.mean((foretold - torque) ** 2, axis=0))
    spread = np.maximum(np.std(torque, axis=0), 1e-9)
    rms = float(np.sqrt(np.mean(error**2)))
    return PredictionScore(tier, rms, float(np.sqrt(np.mean((error / spread) ** 2))))


def recorded_torque(board: Board, opened: Kept, session: str) -> Float[Array, "T n"]:
    """The torque of a session's unseen motion.

    Raises:
        InputError: It is not what was sealed.

    Args:
        board: The board.
        opened: What its maker kept.
        session: Its name.
    """
    path = opened.unseen_file(session)
    remedy = "give the folder that the maker kept of this board, as it was"
    require_regular(path, remedy, largest=LARGEST_TEXT)
    with unchanged(path):
        if sha256_of(path) != opened.answers[session]["unseen_sha256"]:
            raise InputError(path, "it is not the torque that was sealed", remedy)
        columns = read_columns(path, "give the folder that the maker kept")
    return joint_columns(columns, board.sessions[session]["joints"], "effort", path)


# An entrant


@dataclass(frozen=True)
class EntryScore:
    """All that an entrant gets."""

    name: str
    sha256: str  # of all its files
    answered: int  # sessions with an answer
    foretold: int  # motions with a torque
    sessions: Mapping[str, SessionScore]  # empty where no session is answered
    predictions: Mapping[str, PredictionScore]  # empty where nothing is foretold

    def to_dict(self) -> Row:
        """Its record, for JSON."""
        record: Row = {
            "name": self.name,
            "sha256": self.sha256,
            "answered": self.answered,
            "foretold": self.foretold,
        }
        if self.sessions:
            rows = list(self.sessions.values())
            record["attribution"] = attribution(rows)
            record["attribution by tier"] = _by(rows, lambda row: row.tier, TIERS)
            kinds = sorted({row.kind for row in rows})
            record["attribution by kind"] = _by(rows, lambda row: row.kind, kinds)
            shown = [f"{tier}, {amplitude}" for tier in TIERS for amplitude in AMPLITUDES]
            by_amplitude = _by(rows, lambda row: f"{row.tier}, {row.amplitude}", shown)
            record["attribution by amplitude"] = by_amplitude
        if self.predictions:
            foretold = list(self.predictions.values())
            record["prediction"] = prediction(foretold)
            by_tier = {}
            for tier in TIERS:
                of_tier = [row for row in foretold if row.tier == tier]
                if of_tier:
                    by_tier[tier] = prediction(of_tier)
            record["prediction by tier"] = by_tier
        return record


def score_entry(folder: Path, board: Board, opened: Kept) -> EntryScore:
    """Reads and scores an entrant's folder.

    Raises:
        InputError: It holds no answer at all, or one that is none.
    """
    sessions: dict[str, SessionScore] = {}
    predictions: dict[str, PredictionScore] = {}
    answered = [name for name in board.sessions if (folder / f"{name}.json").is_file()]
    foretold = [name for name in board.sessions if (folder / f"{name}.parquet").is_file()]
    if not answered and not foretold:
        first = next(iter(board.sessions))
        remedy = f"give a folder with {first}.json or {first}.parquet and so on"
        raise InputError(folder, "it answers no session of the board", remedy)
    for name, facts in board.sessions.items():
        if answered:
            path = folder / f"{name}.json"
            answer = undecided(list(board.effects))
            if path.is_file():
                answer = read_answer(path, board, name)
            sessions[name] = score_answer(answer, opened.answers[name], facts["tier"])
        if foretold and facts["unseen"]:
            torque = recorded_torque(board, opened, name)
            said = _foretold(folder / f"{name}.parquet", facts["joints"], torque)
            predictions[name] = score_torque(said, torque, facts["tier"])
    digest = digest_of(folder, "s*.*")
    return EntryScore(folder.name, digest, len(answered), len(foretold), sessions, predictions)


def _foretold(path: Path, joints: list[str], torque: Float[Array, "T n"]) -> Float[Array, "T n"]:
    if not path.is_file():
        return np.zeros_like(torque)
    said = joint_columns(read_columns(path, "write it as README.md says"), joints, "effort", path)
    if said.shape != torque.shape:
        what = f"it has {len(said)} rows, not {len(torque)}"
        raise InputError(path, what, "give one row for each of the unseen motion's")
    if not np.all(np.abs(said) <= LARGEST_FIGURE):
        what = "a torque is no number, or beyond any arm's"
        raise InputError(path, what, "give a number in every row")
    return said


def attribution(rows: Sequence[SessionScore]) -> Row:
    """Scores of some answers.

    Returns:
        "sessions", "log_score", "strict", "class_aware", "class_size", "joint", "coverage" and
        "half_width".
    """
    sizes = [row.class_size for row in rows if row.class_size is not None]
    placed = [row.joint for row in rows if row.joint is not None]
    intervals = [interval for row in rows for interval in row.intervals]
    widths = [half for _, half in intervals]
    return {
        "sessions": len(rows),
        "log_score": written(mean([row.log_score for row in rows])),
        "strict": written(share(row.strict for row in rows)),
        "class_aware": written(share(row.classed for row in rows)),
        "class_size": round(float(np.mean(sizes)), 2) if sizes else None,
        "joint": written(share(placed)),
        "coverage": written(share(inside for inside, _ in intervals)),
        "half_width": round(float(np.median(widths)), 3) if widths else None,
    }


def prediction(rows: Sequence[PredictionScore]) -> Row:
    """Scores of some foretold motions.

    Returns:
        "motions", "median_Nm" and "share_of_spread".
    """
    return {
        "motions": len(rows),
        "median_Nm": round(float(np.median([row.rms for row in rows])), 4),
        "share_of_spread": round(float(np.median([row.share for row in rows])), 4),
    }


def _by(
    rows: Sequence[SessionScore],
    key: Callable[[SessionScore], str],
    values: Sequence[str],
) -> dict[str, Row]:
    groups: dict[str, Row] = {}
    for value in values:
        chosen = [row for row in rows if key(row) == value]
        if chosen:
            groups[value] = attribution(chosen)
    return groups


def written(score: Score) -> Row:
    """A score with its interval and count.

    Returns:
        "value", "low" and "high", rounded to three decimals, and "count"; of a score without a
        value, "value" None and "count" 0 alone.
    """
    if score.value is None:
        return {"value": None, "count": 0}
    numbers = {"value": score.value, "low": score.low, "high": score.high}
    rounded = {key: round(float(number or 0.0), 3) for key, number in numbers.items()}
    return {**rounded, "count": score.count}
