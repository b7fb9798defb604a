"""The file of `ident ranges`."""

from __future__ import annotations

from typing import Literal

from typing_extensions import TypedDict

from ident.schemas.common import ProvenanceRecord


class FigureRangeRecord(TypedDict):
    """A figure's range, and what makes it so wide: its own interval, or its spread over the days."""

    value: float
    low: float
    high: float
    unit: str
    source: Literal["interval", "days"]


class HeldOutRangesRecord(TypedDict):
    """How often the torque of a day left out lies inside, and how many times the habit's ranges are wider."""

    level: float
    inside: dict[str, float]
    narrower_than_habit: float | None
    habit: float


class RangesRecord(TypedDict):
    """Ranges by `joint/figure`."""

    schema: Literal["ident.ranges/1"]
    robot: str
    joints: list[str]
    days: list[str]
    ranges: dict[str, FigureRangeRecord]
    noise_Nm: dict[str, float]
    heldout: HeldOutRangesRecord
    provenance: ProvenanceRecord
