"""What is read of a foreign table, and what is guessed of it: columns and settings of a session.toml, with reasons."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.recordings.columns import ANGLES
from ident.recordings.lerobot import is_dataset, longest_episode
from ident.recordings.load import open_run
from ident.recordings.recording import Recording
from ident.records import Record


@dataclass(frozen=True, eq=False)
class ForeignTable:
    """Columns of one run under their own names.

    Attributes:
        source: The file.
        columns: Name -> numbers, all of one length, in the file's order; a column without a name by its number.
        has_names: Whether the file names its columns.
        rate_hz: Rate that the file states [Hz], or None.
    """

    source: Path
    columns: dict[str, Float[Array, " T"]]
    has_names: bool = True
    rate_hz: float | None = None


def read_foreign(path: Path) -> ForeignTable:
    """Reads all columns of a table, a bag or a data set that hold some numbers, and have the usual length.

    Raises:
        RecordingError: It can't be read, or holds no numbers.
    """
    has_names, rate = True, None
    if is_dataset(path):
        columns, rate = longest_episode(path)
    else:
        run = open_run(path, None)
        columns, has_names = dict(run.numbers()), run.has_names
    lengths = [len(values) for values in columns.values()]
    usual = max(set(lengths), key=lengths.count, default=0)
    kept = {name: one for name, one in columns.items() if len(one) == usual and np.isfinite(one).any()}
    return ForeignTable(path, kept, has_names, rate)


@dataclass(frozen=True)
class Reason(Record):
    """Why something was guessed.

    Attributes:
        what: Channel, or key of session.toml.
        guess: What was guessed, in words.
        evidence: What was seen, with numbers.
    """

    what: str
    guess: str
    evidence: str


@dataclass(frozen=True, eq=False)
class Signals:
    """The columns of a run by what they are taken for, in the units of the file or, see `in_si`, in SI.

    Attributes:
        joints: The robot's joints in the columns' order.
        columns: Channel -> names of its columns, one a joint.
        tables: Channel -> numbers, shape (T, n).
        clock: Name of the time's column, or None.
        time: Time [unit of the file]; sample numbers where there is none.
        reasons: Why.
    """

    joints: tuple[str, ...]
    columns: Mapping[str, tuple[str, ...]]
    tables: Mapping[str, Float[Array, "T n"]]
    clock: str | None
    time: Float[Array, " T"]
    reasons: tuple[Reason, ...] = ()

    def without(self, channel: str) -> Signals:
        """The same without a channel."""
        columns = {name: one for name, one in self.columns.items() if name != channel}
        return replace(self, columns=columns, tables={name: self.tables[name] for name in columns})

    def in_si(self, time: float, angle: float) -> Signals:
        """The same, time and angles with their derivatives in SI by these factors; torque and current as they are."""
        tables = {name: angle * one if name in ANGLES else one for name, one in self.tables.items()}
        return replace(self, time=time * self.time, tables=tables)

    def run(self, torque: Float[Array, "T n"], joints: Sequence[str] | None = None) -> Recording:
        """A recording of the motion with a torque, its joints called so if not by their own names."""
        position, velocity = self.tables["position"], self.tables.get("velocity")
        return Recording("guess", tuple(joints or self.joints), self.time, position, torque, velocity=velocity)


@dataclass(frozen=True, eq=False)
class Guess:
    """A session.toml in the making.

    Attributes:
        columns: Foreign name -> native name.
        settings: Keys of session.toml beside `[columns]`.
        reasons: Why, in the order in which they are reported.
        left_out: What is not used, in words.
    """

    columns: dict[str, str]
    settings: dict[str, Any] = field(default_factory=dict)
    reasons: tuple[Reason, ...] = ()
    left_out: tuple[str, ...] = ()
