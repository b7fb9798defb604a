"""The numbers by which the gap is mapped, and by which what could be explained at all is measured."""

from __future__ import annotations

from ident.records import Settings


class MapSettings(Settings, table="map"):
    """Where the gap lies: the cells of the map and their test."""


class CeilingSettings(Settings, table="ceiling"):
    """What a flexible function of the state could explain, and what counts as more than chance."""


class ReplaySettings(Settings, table="replay"):
    """The motion replayed under the recorded torques."""


USUAL_MAP, USUAL_CEILING, USUAL_REPLAY = MapSettings(), CeilingSettings(), ReplaySettings()


class GapSettings(Settings, table="gap"):
    """Where the gap lies and how far it shrinks."""

    map: MapSettings = USUAL_MAP
    ceiling: CeilingSettings = USUAL_CEILING
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
