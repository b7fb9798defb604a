"""The numbers by which the gap is mapped, and by which what could be explained at all is measured."""

from __future__ import annotations

from dataclasses import dataclass

from ident.settings import Settings, number


@dataclass(frozen=True)
class MapSettings(Settings):
    """Where the gap lies: the cells of the map and their test."""

    bins: int = number(5, "1", "cells of an axis, of equal time", "chosen: what a person reads")
    frequency_edges_hz: tuple[float, ...] = number(
        (0.0, 1.0, 3.0, 10.0, 40.0),
        "Hz",
        "edges of the cells of frequency",
        "chosen: half decades over what arms move at",
    )
    flips: int = number(999, "1", "draws of signs: the least p-value is one over one more", "law: resolution of 0.001")
    most_blocks: int = number(256, "1", "blocks of time whose signs are drawn, at the most", "chosen: work")
    shortest_block_s: float = number(
        1.5, "s", "and their least length", "chosen: some correlation times of what an arm's model leaves"
    )
    least_excess: float = number(
        1.2, "1", "mean square over the noise's from which on a joint is on the map", "chosen: less shows no place"
    )
    least_samples: int = number(
        100, "1", "samples of a joint from which on it is on the map", "chosen: five cells of twenty"
    )
    within_from: float = number(
        0.25,
        "1",
        "share of a cell's contrast that must lie within blocks to be compared from the inside",
        "chosen: else nearly nothing is compared",
    )
    significant: float = number(
        0.05, "1", "p-value of a cell that holds more of the gap than chance gives it", "law: the usual 5 %"
    )
    least_density: float = number(
        1.25, "1", "share of the gap over share of the time from which on a cell stands out", "chosen: a quarter more"
    )
    places_each: int = number(3, "1", "cells of a joint that are reported", "chosen: what a person reads")
    places_told: int = number(12, "1", "and of all joints", "chosen: what a person reads")


@dataclass(frozen=True)
class CeilingSettings(Settings):
    """What a flexible function of the state could explain, and what counts as more than chance."""

    least_nats: float = number(
        30.0,
        "nats",
        "log Bayes factor of a discrepancy from which on something is left at a joint",
        "calibrated: of 140 joints of healthy arms of three simulators none had more than 22",
    )
    least_fall: float = number(
        0.03, "1", "share by which the mean square must fall on average", "calibrated: early development sets"
    )
    folds: int = number(4, "1", "folds on which neighbours of the angle are tested", "chosen: work")
    sure_folds: int = number(3, "1", "folds in which the error must fall", "chosen: all but one")
    most_samples: int = number(3000, "1", "samples that are shown to the neighbours", "chosen: work")
    least_samples: int = number(
        200, "1", "samples of a joint below which nothing is learnt", "chosen: fewer than two neighbourhoods a fold"
    )
    neighbours: int = number(
        8, "1", "nearest samples whose mean is taken", "chosen: a mean that noise moves by a third"
    )


@dataclass(frozen=True)
class ReplaySettings(Settings):
    """The motion replayed under the recorded torques."""

    window_s: float = number(
        0.25, "s", "length of a stretch that is replayed", "chosen: a newton metre on 1 kg m² shows by 31 mrad"
    )
    most_windows: int = number(400, "1", "stretches, spread evenly over the session", "chosen: enough for two digits")
    far_share: float = number(
        0.5,
        "1",
        "a replay that ends farther off than this share of the joint's way is doubted",
        "chosen: it foretells no motion",
    )


USUAL_MAP, USUAL_CEILING, USUAL_REPLAY = MapSettings(), CeilingSettings(), ReplaySettings()


@dataclass(frozen=True)
class GapSettings(Settings):
    """Where the gap lies and how far it shrinks."""

    map: MapSettings = USUAL_MAP
    ceiling: CeilingSettings = USUAL_CEILING
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
