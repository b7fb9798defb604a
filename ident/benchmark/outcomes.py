"""A decision rule on a stored table: what each session would be told, and whether that is right.

Candidates are taken in the order of their probability; one that says what a name before it says
already is skipped, and what is at 0.5 or more is a name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.benchmark.corpus_table import CANDIDATE, SessionRow, Table
from ident.benchmark.labels import RIGHT, UNKNOWN, WRONG, says_the_same

NAMED_FROM = 0.5  # probability from which a candidate is a name
# A name that the untouched recording of the same arm has at this probability is no news there.
KNOWN_FROM = 0.25
LEAST_PROBABLE = 0.02  # below it a candidate is not weighed at all


@dataclass(frozen=True)
class Said:
    """A name that a rule gives."""

    row: int  # of the table
    probability: float
    label: str


@dataclass(frozen=True)
class SessionOutcome:
    """One session under a rule."""

    session: SessionRow
    said: tuple[Said, ...]  # names with any probability, the most probable first
    matched: frozenset[int]  # truths that a name at 0.5 or more is right of
    strict: bool  # whether the first name is a truth's own

    @property
    def sure(self) -> list[Said]:
        """The names with a probability from which on a diagnosis names."""
        return [name for name in self.said if name.probability >= NAMED_FROM]

    @property
    def wrong(self) -> bool:
        """Whether a name at 0.5 or more is wrong."""
        return any(name.label == WRONG for name in self.sure)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall; a truth that is named twice is named once."""
        names = [name for name in self.sure if name.label != UNKNOWN]
        hits = sum(name.label == RIGHT for name in names)
        if not hits:
            return 0.0
        precision = hits / len(names)
        recall = len(self.matched) / len(self.session.truths)
        return 2.0 * precision * recall / (precision + recall)

    @property
    def good(self) -> bool:
        """Whether the session went as it should: truths named and nothing else, or silence."""
        if self.session.kind in ("single", "pair", "measured"):
            return len(self.matched) == len(self.session.truths) and not self.wrong
        if self.session.kind == "healthy":
            return not self.wrong and not self.session.told_gap and not self.session.error
        return not self.wrong and not self.session.error


def apply_rule(table: Table, probability: Float[Array, " N"]) -> dict[str, SessionOutcome]:
    """Outcomes of all sessions, by case."""
    p = np.where(np.isfinite(probability), probability, 0.0)
    labels = table.labels(p >= KNOWN_FROM)
    rows_of: dict[str, list[int]] = {case: [] for case in table.sessions}
    for number, row in enumerate(table.rows):
        rows_of[row["case"]].append(number)
    outcomes: dict[str, SessionOutcome] = {}
    for case, rows in rows_of.items():
        said = names_of(table, rows, p, labels)
        sure = [name for name in said if name.probability >= NAMED_FROM]
        matched = frozenset(table.rows[name.row]["matched"] for name in sure if name.label == RIGHT)
        strict = bool(sure) and bool(table.rows[sure[0].row]["strict"])
        outcomes[case] = SessionOutcome(table.sessions[case], tuple(said), matched, strict)
    return outcomes


def names_of(table: Table, rows: Sequence[int], p: Float[Array, " N"], labels: Array) -> list[Said]:
    """Candidates of a session that no more probable one says already."""
    said: list[Said] = []
    for number in sorted(rows, key=lambda k: -p[k]):
        if p[number] < LEAST_PROBABLE:
            break
        name = table.names[number]
        repeated = any(says_the_same(name, table.names[before.row]) for before in said)
        if not (repeated and table.source == CANDIDATE):  # what was reported stands as it is
            said.append(Said(number, float(p[number]), str(labels[number])))
    return said
