"""What was recorded: a run is one continuous motion, a session is a list of runs of one set-up of
the arm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ident.arrays import Array, Float, Int, freeze, in_a_line
from ident.errors import RecordingError
from ident.records import Record
from ident.safe_read import FileState

# Per-joint channels of a run, in the order of the native table's columns.
CHANNELS = (
    "position",
    "velocity",
    "acceleration",
    "effort",
    "position_command",
    "velocity_command",
    "effort_command",
    "current",
    "temperature",
)

Severity = Literal["note", "warning", "fatal"]


@dataclass(frozen=True)
class TelemetryIssue(Record):
    """One finding about a recording's fitness for use."""

    issue: str  # identifier, one of the contract's list (``position_wraps``, ``jitter``, …)
    joints: tuple[str, ...]  # names of the joints concerned; empty where the whole run is
    # ``note`` was mended or is harmless, ``warning`` weakens results, ``fatal`` forbids a fit
    severity: Severity
    evidence: str  # what was seen, with numbers and the run's name
    remedy: str  # what the user can do


@dataclass(frozen=True)
class Payload:
    """A known body at the flange."""

    mass_kg: float  # mass [kg]
    # centre of mass in the frame of the last link [m]
    com_m: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Recording:
    """One run: T samples of n joints; arrays are copied in and read-only."""

    __repr__ = in_a_line

    name: str  # name of the run, the file's stem
    joints: tuple[str, ...]  # the n joint names, in the robot's order
    time: Float[Array, " T"]  # session clock [s], shape (T,), strictly increasing
    position: Float[Array, "T n"]  # joint position [rad or m], shape (T, n)
    # Measured joint torque [N m or N], shape (T, n), drive gain and sign of session.toml applied.
    effort: Float[Array, "T n"]
    velocity: Float[Array, "T n"] | None = None  # as above, or None
    acceleration: Float[Array, "T n"] | None = None
    position_command: Float[Array, "T n"] | None = None
    velocity_command: Float[Array, "T n"] | None = None
    effort_command: Float[Array, "T n"] | None = None
    current: Float[Array, "T n"] | None = None  # motor current [A], or None
    temperature: Float[Array, "T n"] | None = None  # joint temperature [degC], or None
    source: Path | None = None  # the file it came from
    state: FileState | None = None  # of that file when it was read
    # The rate that session.toml states although the table has its own time [Hz], or None.
    stated_rate_hz: float | None = None
    # what the reader found and mended (garbage rows, a truncated last row, …)
    issues: tuple[TelemetryIssue, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "joints", tuple(self.joints))
        object.__setattr__(self, "time", freeze(self.time))
        expected = (len(self.time), len(self.joints))
        for name in CHANNELS:
            if (values := getattr(self, name)) is None:
                continue
            if np.shape(values) != expected:
                what = f"{name} has shape {np.shape(values)}, not {expected}"
                raise RecordingError(
                    self.name, what, "give arrays of (samples, joints), as many rows as times"
                )
            object.__setattr__(self, name, freeze(values))

    def __len__(self) -> int:
        return len(self.time)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]; 0 without samples."""
        return float(self.time[-1] - self.time[0]) if len(self) else 0.0

    @cached_property
    def sample_interval(self) -> float:
        """Median sampling interval [s]; NaN of fewer than two samples."""
        return float(np.median(np.diff(self.time)))

    def channels(self) -> dict[str, Float[Array, "T n"]]:
        """The per-joint channels that are there, by the names of their fields."""
        return {name: getattr(self, name) for name in CHANNELS if getattr(self, name) is not None}

    def replace(self, **changes: Any) -> Recording:
        """A copy with some fields changed, checked anew.

        Args:
            **changes: New values by the names of the fields.
        """
        return replace(self, **changes)

    def at(self, rows: slice | Array, name: str | None = None) -> Recording:
        """A copy of some rows (slice, mask or indices), under another name if one is given."""
        cut: dict[str, Any] = {key: values[rows] for key, values in self.channels().items()}
        return replace(self, name=name or self.name, time=self.time[rows], **cut)

    def select(self, joints: Sequence[str]) -> Recording:
        """A copy with the given joints, in the given order.

        Raises:
            ValueError: A joint is not there.
        """
        columns = [self.joints.index(joint) for joint in joints]
        cut: dict[str, Any] = {key: values[:, columns] for key, values in self.channels().items()}
        return replace(self, joints=tuple(joints), **cut)


@dataclass(frozen=True, eq=False)
class Session:
    """Runs of one set-up of the arm (same payload, same mounting)."""

    __repr__ = in_a_line

    name: str  # name of the session, the folder's
    runs: tuple[Recording, ...]  # the runs, in file-name order; all have the same joints
    payload: Payload | None = None  # the known body at the flange, if session.toml names one
    robot: str | None = None  # the robot that session.toml names, if any
    # Whether time goes on from run to run; False where clocks restart (recordings of several days):
    # then the runs are independent and effects that need a common clock are not testable.
    common_clock: bool = True
    path: Path | None = None  # the folder or file it was read from
    # date, notes, origin and own keys of session.toml
    metadata: dict[str, Any] = field(default_factory=dict)
    notes: tuple[TelemetryIssue, ...] = ()  # what the reader found about the session as a whole
    # What session.toml says the effort is: ``joint_torque`` (gravity is in it), or
    # ``gravity_compensated``; None where it says nothing.
    effort_kind: str | None = None
    # Gravity in the base's frame [m/s²], by session.toml or as the torque follows it; None for the
    # URDF's.
    gravity: tuple[float, float, float] | None = None
    # drive gains that nobody measured, by joint [N m/A]
    guessed_gains: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "runs", tuple(self.runs))

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, the same in every run."""
        return self.runs[0].joints

    @property
    def samples(self) -> int:
        """Number of samples of all runs."""
        return sum(len(run) for run in self.runs)

    @property
    def duration(self) -> float:
        """Sum of the runs' durations, pauses not counted [s]."""
        return sum(run.duration for run in self.runs)

    def issues(self) -> tuple[TelemetryIssue, ...]:
        """What the reader found, in the session as a whole and in each run."""
        return self.notes + tuple(issue for run in self.runs for issue in run.issues)

    def replace(self, **changes: Any) -> Session:
        """A copy with some fields changed.

        Args:
            **changes: New values by the names of the fields.
        """
        return replace(self, **changes)


def cut_before(run: Recording, rows: Int[Array, " k"]) -> tuple[Recording, ...]:
    """Cuts a run before each of some rows, given in order; the pieces are named `run[0]`, `run[1]`,
    …
    """
    edges = [0, *(int(row) for row in rows), len(run)]
    numbered = enumerate(pairwise(edges))
    return tuple(run.at(slice(a, b), f"{run.name}[{index}]") for index, (a, b) in numbered)
