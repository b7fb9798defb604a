"""The file of `ident servo`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from ident.schemas.common import ProvenanceRecord


class ServoFigureRecord(TypedDict):
    """A figure with its 95 % interval."""

    value: float
    low: float
    high: float
    unit: str


class ServoJointRecord(TypedDict):
    """What is told of a joint, what else would look the same, and what is not told, with the reason."""

    figures: dict[str, ServoFigureRecord]
    not_told: dict[str, str]
    heldout: dict[str, float] | None


class ServoRecord(TypedDict):
    """Joints of a position-only arm."""

    schema: Literal["ident.servo/1"]
    robot: str
    joints: dict[str, ServoJointRecord]
    provenance: ProvenanceRecord
