"""Fits where the cause is that no name of ours tells, to sessions with truth that are on no board.

    python -m ident.benchmark.board.fit_unnamed --pairs CASES… --index INDEX --results RESULTS

`CASES` is what `python -m ident.benchmark.change_calibration store` fills; `INDEX` and `RESULTS`
are those of a corpus, of which the simulated arms are taken, whole: of a real arm nobody knows in
full what is wrong. Writes `unnamed.toml`.

What is fitted are the shares of the places in each state (`unnamed.py`), by expectation and
maximisation (Dempster, Laird and Rubin 1977) of the probability that an answer gives to what is
true, with one session in each place of each state before any is counted.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

import numpy as np
import tomli_w

from ident.benchmark.board.case import NONE, OTHER
from ident.benchmark.board.ours import NOT_FITTED, NamedShares, as_diagnosis, read_said
from ident.benchmark.board.published import published_effects
from ident.benchmark.board.score import LEAST_PROBABILITY, labels_of
from ident.benchmark.board.unnamed import (
    COMPARISON,
    DIAGNOSIS,
    FILE,
    LISTED,
    PLACES,
    SCHEMA,
    STATES,
    Shares,
)
from ident.benchmark.change_calibration import Pairs
from ident.benchmark.corpus import Truth, read_index
from ident.benchmark.corpus_run import result_path
from ident.files import atomic_write
from ident.records import JsonRecord, JsonTable
from ident.safe_read import read_json

ROUNDS = 500  # most steps of the fit
CHANGE = 1e-6  # of a share in one step, below which it stands still
RECORDED = "real"  # group of a corpus that holds real arms
BEFORE = 1.0  # sessions in each place before any is counted
DIGITS = 4


Place = tuple[str, str]
"""State and place."""
KEYS: tuple[Place, ...] = tuple(product(STATES, PLACES))


@dataclass(frozen=True)
class Case:
    """What was said of a session whose truth is known.

    Attributes:
        said: The names, and what they leave.
        truths: Of each thing that is wrong the answers that are right; `none` where nothing is.
    """

    said: NamedShares
    truths: tuple[frozenset[str], ...]

    def named(self, accepted: frozenset[str]) -> float:
        """Probability that the names give to a truth, with what every answer has."""
        rows = [row["probability"] for row in self.said.rows if row["effect"] in accepted]
        return float(sum(rows)) + self.said.even * len(accepted)

    def left(self, accepted: frozenset[str], effects: int, shares: Shares) -> dict[Place, float]:
        """What a truth gets of the probability that no name has, by state and place.

        Args:
            accepted: Effects, by id, any of which is the truth; `NONE` and `OTHER` among them.
            effects: Number of listed effects, among which a place's share is spread evenly.
            shares: Of each place in each state.
        """
        sizes = {NONE: float(NONE in accepted), OTHER: float(OTHER in accepted)}
        sizes[LISTED] = len(accepted - {NONE, OTHER}) / effects
        parts: dict[Place, float] = {}
        for state, mass in self.said.left.items():
            for place in PLACES:
                parts[state, place] = mass * shares[state][place] * sizes[place]
        return parts


def fit_shares(cases: Sequence[Case], effects: int) -> Shares:
    """Shares of the places in each state, under which what is true is likeliest.

    Args:
        cases: Sessions with truth.
        effects: Number of listed effects.
    """
    shares = _normalised(dict.fromkeys(KEYS, 1.0))
    for _ in range(ROUNDS):
        updated = _normalised(_expected_counts(cases, effects, shares))
        change = max(abs(updated[state][place] - shares[state][place]) for state, place in KEYS)
        shares = updated
        if change < CHANGE:
            break
    return shares


def _expected_counts(cases: Sequence[Case], effects: int, shares: Shares) -> dict[Place, float]:
    """How many sessions have their cause in each place, under these shares."""
    counts = dict.fromkeys(KEYS, BEFORE)
    for case in cases:
        for accepted in case.truths:
            parts = case.left(accepted, effects, shares)
            whole = case.named(accepted) + sum(parts.values())
            for key, chance in parts.items():
                counts[key] += chance / whole / len(case.truths)
    return counts


def _normalised(counts: Mapping[Place, float]) -> Shares:
    shares: dict[str, dict[str, float]] = {}
    for state in STATES:
        total = sum(counts[state, place] for place in PLACES)
        shares[state] = {place: counts[state, place] / total for place in PLACES}
    return shares


def log_scores(cases: Sequence[Case], effects: int, shares: Shares) -> list[float]:
    """The log score of each session, as a board counts it."""
    scores: list[float] = []
    for case in cases:
        logs: list[float] = []
        for accepted in case.truths:
            left = sum(case.left(accepted, effects, shares).values())
            logs.append(-np.log(max(case.named(accepted) + left, LEAST_PROBABILITY)))
        scores.append(float(np.mean(logs)))
    return scores


# Sessions


def cases_of_pairs(folders: Sequence[Path]) -> list[Case]:
    """Comparisons of pairs with truth.

    Raises:
        InputError: None is stored.
    """
    pairs = Pairs.read(folders)
    cases: list[Case] = []
    for name, result in pairs.results.items():
        record = result["comparison"]
        truths = pairs.answers[name]["effects"]
        cases += _case(as_diagnosis(record), truths)
    return cases


def cases_of_corpus(index: Path, results: Path) -> list[Case]:
    """Diagnoses of simulated arms with truth, of whole sessions.

    Raises:
        InputError: No index.
    """
    cases: list[Case] = []
    for entry in read_index(index):
        path = result_path(results, entry.case)
        if entry.group == RECORDED or entry.seconds or not path.is_file():
            continue
        record = read_json(path, "diagnose the corpus anew").get("diagnosis")
        if record:
            cases += _case(record, [_as_answer(truth) for truth in entry.truth])
    return cases


def _case(record: JsonTable, truths: Sequence[JsonTable]) -> Iterator[Case]:
    """The case of a record; none where nothing was fitted."""
    if record["verdict"] in NOT_FITTED:
        return
    said = read_said(record, published_effects(), record["joints"])
    accepted = [frozenset(labels_of(truth)) for truth in truths]
    yield Case(said, tuple(accepted) or (frozenset({NONE}),))


def _as_answer(truth: Truth) -> JsonRecord:
    return {"effect": truth.effect, "in_catalogue": truth.in_catalogue, "also": truth.also}


# Command


def write_shares(fitted: Mapping[str, tuple[int, Shares]], out: Path) -> None:
    """Writes sessions and shares of each kind."""
    record: JsonRecord = {"schema": SCHEMA}
    for kind, (sessions, shares) in fitted.items():
        record[kind] = {"sessions": sessions}
        for state in STATES:
            places = shares[state].items()
            record[kind][state] = {place: round(share, DIGITS) for place, share in places}
    with atomic_write(out) as unfinished:
        unfinished.write_text(tomli_w.dumps(record), encoding="utf-8")


def main() -> None:
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=form)
    parser.add_argument("--pairs", type=Path, nargs="+", required=True)
    parser.add_argument("--index", type=Path, required=True)
    parser.add_argument("--results", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=FILE)
    given = parser.parse_args()
    kinds = {
        DIAGNOSIS: cases_of_corpus(given.index, given.results),
        COMPARISON: cases_of_pairs(given.pairs),
    }
    effects = len(published_effects())
    fitted: dict[str, tuple[int, Shares]] = {}
    for kind, cases in kinds.items():
        shares = fit_shares(cases, effects)
        fitted[kind] = (len(cases), shares)
        score = float(np.mean(log_scores(cases, effects, shares)))
        print(f"{kind}: {len(cases)} sessions, log score {score:.3f}")
    write_shares(fitted, given.out)


if __name__ == "__main__":
    main()
