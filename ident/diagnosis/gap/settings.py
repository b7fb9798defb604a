"""The numbers by which the gap is mapped, and by which what could be explained at all is measured."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class MapSettings(Settings, table="map"):
    """Where the gap lies: the cells of the map and their test."""

    bins: int = number()
    frequency_edges_hz: tuple[float, ...] = number()
    flips: int = number()
    most_blocks: int = number()
    shortest_block_s: float = number()
    least_excess: float = number()
    least_samples: int = number()
    within_from: float = number()
    significant: float = number()
    least_density: float = number()
    places_each: int = number()
    places_told: int = number()


@dataclass(frozen=True)
class CeilingSettings(Settings, table="ceiling"):
    """What a flexible function of the state could explain, and what counts as more than chance."""

    least_nats: float = number()
    least_fall: float = number()
    folds: int = number()
    sure_folds: int = number()
    most_samples: int = number()
    least_samples: int = number()
    neighbours: int = number()


@dataclass(frozen=True)
class ReplaySettings(Settings, table="replay"):
    """The motion replayed under the recorded torques."""

    window_s: float = number()
    most_windows: int = number()
    far_share: float = number()


USUAL_MAP, USUAL_CEILING, USUAL_REPLAY = MapSettings(), CeilingSettings(), ReplaySettings()


@dataclass(frozen=True)
class GapSettings(Settings, table="gap"):
    """Where the gap lies and how far it shrinks."""

    map: MapSettings = USUAL_MAP
    ceiling: CeilingSettings = USUAL_CEILING
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
