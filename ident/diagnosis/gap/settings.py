"""Settings of the gap's map, its ceiling, and the replay."""

from __future__ import annotations

from ident.recordings.blocks import SHORTEST_MAPPED_S
from ident.records import Settings, number


class MapSettings(Settings, table="map"):
    """Cells of the map and their test."""

    shortest_block_s: float = number(
        SHORTEST_MAPPED_S,
        "s",
        "least length of a block of time whose signs are drawn",
        "chosen: some correlation times of a residual",
    )


class CeilingSettings(Settings, table="ceiling"):
    """Significance of what a flexible function of the state explains."""


class ReplaySettings(Settings, table="replay"):
    """Windows of the replay."""


USUAL_MAP = MapSettings()
USUAL_CEILING = CeilingSettings()
USUAL_REPLAY = ReplaySettings()


class GapSettings(Settings, table="gap"):
    """Settings of the gap's map, its ceiling, and the replay."""

    map: MapSettings = USUAL_MAP
    ceiling: CeilingSettings = USUAL_CEILING
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
