"""Settings of the gap's map, its ceiling, and the replay."""

from __future__ import annotations

from dataclasses import dataclass

from ident.recordings.blocks import SHORTEST_MAPPED_S
from ident.records import Numbers, number


@dataclass(frozen=True)
class MapSettings(Numbers):
    """Cells of the map and their test."""

    bins: int = number(
        5,
        "1",
        "number of cells of an axis, of equal time",
        "chosen: what a person reads",
    )
    frequency_edges_hz: tuple[float, ...] = number(
        (0.0, 1.0, 3.0, 10.0, 40.0),
        "Hz",
        "edges of the cells of frequency",
        "chosen: half decades over what arms move at",
    )
    flips: int = number(
        999,
        "1",
        "number of random signs; the least p-value is 1 / (flips + 1)",
        "law: resolution of 0.001",
    )
    most_blocks: int = number(
        256,
        "1",
        "largest number of blocks of time whose signs are drawn",
        "chosen: work",
    )
    least_excess: float = number(
        1.2,
        "1",
        "least ratio of a joint's mean square to the noise's for its map",
        "chosen: less has no place",
    )
    within_from: float = number(
        0.25,
        "1",
        "share of a cell's contrast within blocks above which it is tested within blocks",
        "chosen: else nearly nothing is compared",
    )
    significant: float = number(
        0.05,
        "1",
        "p-value of a cell that stands out",
        "law: the usual 5 %",
    )
    least_density: float = number(
        1.25,
        "1",
        "least ratio of share of the gap to share of the time of a cell that stands out",
        "chosen: a quarter more",
    )
    places_each: int = number(
        3,
        "1",
        "number of reported cells of a joint",
        "chosen: what a person reads",
    )
    places_told: int = number(
        12,
        "1",
        "number of reported cells of all joints",
        "chosen: what a person reads",
    )
    shortest_block_s: float = number(
        SHORTEST_MAPPED_S,
        "s",
        "least length of a block of time whose signs are drawn",
        "chosen: some correlation times of a residual",
    )


@dataclass(frozen=True)
class CeilingSettings(Numbers):
    """Significance of what a flexible function of the state explains."""

    folds: int = number(
        4,
        "1",
        "folds on which neighbours in angle are tested",
        "chosen: work",
    )
    most_samples: int = number(
        3000,
        "1",
        "largest number of samples among which neighbours are sought",
        "chosen: work",
    )
    least_samples: int = number(
        200,
        "1",
        "least number of samples of a joint for this test",
        "chosen: fewer than two neighbourhoods a fold",
    )
    neighbours: int = number(
        8,
        "1",
        "number of nearest samples whose mean is the prediction",
        "chosen: a mean that noise moves by a third",
    )


@dataclass(frozen=True)
class ReplaySettings(Numbers):
    """Windows of the replay."""

    window_s: float = number(
        0.25,
        "s",
        "length of a replayed window",
        "chosen: a newton metre on 1 kg m² shows by 31 mrad",
    )
    most_windows: int = number(
        400,
        "1",
        "largest number of windows, spread evenly over the session",
        "chosen: enough for two digits",
    )
    far_share: float = number(
        0.5,
        "1",
        "deviation at the end of a window, as a share of the joint's travel in it, that is doubted",
        "chosen: such a model does not predict motion",
    )


USUAL_MAP = MapSettings()
USUAL_CEILING = CeilingSettings()
USUAL_REPLAY = ReplaySettings()


@dataclass(frozen=True)
class GapSettings(Numbers):
    """Settings of the gap's map, its ceiling, and the replay."""

    map: MapSettings = USUAL_MAP
    ceiling: CeilingSettings = USUAL_CEILING
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
