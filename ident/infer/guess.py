"""What is read of a foreign table, and what is guessed of it, with reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RecordingError
from ident.recordings.lerobot import longest_episode
from ident.recordings.load import TEXTS, is_dataset, open_run
from ident.recordings.recording import Recording
from ident.recordings.text import constant_texts
from ident.records import Record
from ident.safe_read import unchanged


@dataclass(frozen=True, eq=False)
class ForeignTable:
    """Columns of one run under their own names."""

    source: Path  # the file
    # Name -> numbers, all of one length, in the file's order; a column without a name by number.
    columns: dict[str, Float[Array, " T"]]
    has_names: bool = True  # whether the file names its columns
    rate_hz: float | None = None  # rate that the file states [Hz], or None
    # Columns that hold one and the same text: joints' names, in dumps of messages.
    texts: Mapping[str, str] = field(default_factory=dict)


def read_foreign(path: Path) -> ForeignTable:
    """Reads all columns of a table, a bag or a data set that hold some numbers.

    Those that have the usual length.

    Raises:
        RecordingError: It can't be read, or holds no numbers.
    """
    with unchanged(path, RecordingError):
        return _read_foreign(path)


def _read_foreign(path: Path) -> ForeignTable:
    """The same, of a file that stays as it is."""
    has_names = True
    rate = None
    if is_dataset(path):
        columns, rate = longest_episode(path)
    else:
        run = open_run(path, None)
        columns = dict(run.numbers())
        has_names = run.has_names
    lengths = [len(values) for values in columns.values()]
    usual = max(set(lengths), key=lengths.count, default=0)
    numbers = {name: values for name, values in columns.items() if _counts(values, usual)}
    if not numbers:
        raise RecordingError(path, "has no row with a number", "give a table with samples")
    texts = constant_texts(path) if path.suffix.lower() in TEXTS and path.is_file() else {}
    return ForeignTable(path, numbers, has_names, rate, texts)


def _counts(values: Float[Array, " T"], usual: int) -> bool:
    """Whether a column has the usual length and holds a number."""
    return len(values) == usual and bool(np.isfinite(values).any())


@dataclass(frozen=True)
class Reason(Record):
    """Why something was guessed."""

    what: str  # channel, or key of session.toml
    guess: str  # what was guessed, in words
    evidence: str  # what was seen, with numbers


@dataclass(frozen=True, eq=False)
class Signals:
    """The columns of a run by what they are taken for, in the units of the file or in SI."""

    joints: tuple[str, ...]  # the robot's joints in the columns' order
    columns: Mapping[str, tuple[str, ...]]  # channel -> names of its columns, one a joint
    tables: Mapping[str, Float[Array, "T n"]]  # channel -> numbers, shape (T, n)
    clock: str | None  # name of the time's column, or None
    time: Float[Array, " T"]  # time [unit of the file]; sample numbers where there is none
    reasons: tuple[Reason, ...] = ()  # why
    # Whether the joints are called so by their columns' places alone.
    by_place: bool = False

    def run(self, torque: Float[Array, "T n"], joints: Sequence[str] | None = None) -> Recording:
        """A recording of the motion with a torque.

        Args:
            torque: Of each joint [N m].
            joints: What the joints are called; by their own names if None.
        """
        position = self.tables["position"]
        velocity = self.tables.get("velocity")
        named = tuple(joints or self.joints)
        return Recording("guess", named, self.time, position, torque, velocity=velocity)
