"""What was guessed of a foreign table, in one piece: the columns and settings of a session.toml, each with a reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ident.arrays import Array, Float
from ident.recordings.recording import Recording
from ident.records import Record


@dataclass(frozen=True)
class Reason(Record):
    """Why something was guessed.

    Attributes:
        what: Channel, or key of session.toml.
        guess: What was guessed, in words.
        evidence: What was seen, with figures.
    """

    what: str
    guess: str
    evidence: str


@dataclass(frozen=True, eq=False)
class Signals:
    """The columns of a run by what they are taken for, units as in the file.

    Attributes:
        joints: The robot's joints in the columns' order.
        columns: Channel -> names of its columns, one a joint.
        tables: Channel -> numbers, shape (T, n).
        clock: Name of the time's column, or None.
        time: Time as it stands [unit of the file]; sample numbers where there is none.
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
        tables = {name: one for name, one in self.tables.items() if name != channel}
        return Signals(self.joints, columns, tables, self.clock, self.time, self.reasons)

    def run(self, time_factor: float, angle_factor: float, torque: Float[Array, "T n"]) -> Recording:
        """A recording in SI units."""
        velocity = self.tables.get("velocity")
        return Recording(
            "guess",
            self.joints,
            time_factor * self.time,
            angle_factor * self.tables["position"],
            torque,
            velocity=None if velocity is None else angle_factor * velocity,
        )


@dataclass(frozen=True, eq=False)
class Guess:
    """A session.toml in the making.

    Attributes:
        columns: Foreign name -> native name.
        settings: Keys of session.toml beside `[columns]`.
        reasons: Why, in the order in which it is told.
        left_out: What is not used, in words.
    """

    columns: dict[str, str]
    settings: dict[str, Any] = field(default_factory=dict)
    reasons: tuple[Reason, ...] = ()
    left_out: tuple[str, ...] = ()
