"""A diagnosis read from its file: the diagnosis's own attributes, made of its record."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property

from ident.diagnosis.gap.gap_map import Place
from ident.effects.base import Interval
from ident.recordings.recording import TelemetryIssue
from ident.records import JsonRecord, JsonTable


@dataclass(frozen=True, eq=False)
class SavedFinding:
    """A named effect, as its record has it."""

    effect: str
    joints: tuple[str, ...]
    probability: float  # that it is the cause, and none of its class
    class_probability: float  # that one of its class is
    rivals: tuple[str, ...]  # effects that the recordings can't tell from it, itself first
    parameters: dict[str, Interval]
    rms_before: dict[str, float]  # held-out error without it, by joint [N m]
    rms_after: dict[str, float]  # held-out error with it, by joint [N m]
    shrink: float  # share of the mean square above the noise that it closes at these joints
    action: str  # what a person at the cell can do about it

    @classmethod
    def of(cls, record: JsonTable) -> SavedFinding:
        """Read from the record of a finding.

        Raises:
            KeyError: A part of the record is missing.
        """
        heldout = record["heldout"]
        parameters = {name: interval_of(value) for name, value in record["parameters"].items()}
        return cls(
            effect=record["effect"],
            joints=tuple(record["joints"]),
            probability=record["probability"],
            class_probability=record.get("class_probability", record["probability"]),
            rivals=tuple(record["class"]),
            parameters=parameters,
            rms_before=dict(heldout["rms_before_Nm"]),
            rms_after=dict(heldout["rms_after_Nm"]),
            shrink=heldout["shrink"],
            action=record.get("action", ""),
        )


@dataclass(frozen=True, eq=False)
class SavedGain:
    """What all names together close on held-out runs, as the record has it."""

    rms_before: dict[str, float]  # by joint [N m]
    rms_after: dict[str, float]
    shrink: float


def interval_of(record: JsonTable) -> Interval:
    """An interval of a record; further keys are passed over."""
    return Interval(**_known_keys(record, Interval))


def _known_keys(record: JsonTable, kind: type[Interval | Place]) -> JsonRecord:
    """The entries of a record that are fields of a class."""
    names = [entry.name for entry in fields(kind)]
    return {name: record[name] for name in names if name in record}


@dataclass(frozen=True, eq=False)
class SavedParts:
    """The parts of a diagnosis's record, with the names that they have on a `Diagnosis`."""

    record: JsonTable  # `ident.diagnosis/1`; `ident schema diagnosis` says what it holds

    @property
    def robot(self) -> str:
        """Name of the arm."""
        return str(self.record["robot"])

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, in the arm's order."""
        return tuple(self.record["joints"])

    @property
    def verdict(self) -> str:
        """`no_gap`, `named`, `partial`, `none_of_catalogue`, `not_testable` or `refused`."""
        return str(self.record["verdict"])

    @property
    def session(self) -> Mapping[str, float]:
        """How much was recorded: `runs`, `samples`, `duration_s`."""
        return dict(self.record["session"])

    @property
    def gap(self) -> Mapping[str, JsonTable]:
        """The record of each joint's gap (`JointGap.to_dict`), by joint name; empty without any."""
        return dict(self.record["gap"])

    @property
    def identified(self) -> JsonTable:
        """The URDF's numbers beside those that were found (`IdentifiedNumbers.to_dict`); empty
        where the record has none.
        """
        return dict(self.record.get("identified", {}))

    @cached_property
    def telemetry(self) -> tuple[TelemetryIssue, ...]:
        """The issues that the check of the recordings found."""
        rows = self.record["telemetry"]
        return tuple(TelemetryIssue(**{**row, "joints": tuple(row["joints"])}) for row in rows)

    @cached_property
    def where(self) -> tuple[Place, ...]:
        """The cells of the map in which the gap stands out, in the record's order."""
        places = []
        for row in self.record["where"]:
            whole = {"share_of_time": 0.0, "energy_J": None, **row}
            places.append(Place(**_known_keys(whole, Place)))
        return tuple(places)

    @cached_property
    def findings(self) -> tuple[SavedFinding, ...]:
        """The names, in the order of the gap that each closes."""
        return tuple(SavedFinding.of(row) for row in self.record["findings"])

    @cached_property
    def heldout(self) -> SavedGain | None:
        """Error on held-out runs before and after all names; None where the record has none."""
        row = self.record["heldout"]
        if "shrink" not in row:
            return None
        return SavedGain(dict(row["rms_before_Nm"]), dict(row["rms_after_Nm"]), row["shrink"])
