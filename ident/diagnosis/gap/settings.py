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
    places_told: int = number(12, "1", "cells of the map that are told", "chosen: what a person reads")


@dataclass(frozen=True)
class TreeSettings(Settings):
    """What any function of the state could explain: the trees and what counts as more than luck."""

    folds: int = number(4, "1", "folds on which the trees are judged", "chosen: work")
    sure_folds: int = number(3, "1", "folds in which the error must fall", "chosen: all but one")
    least_fall: float = number(
        0.03, "1", "share by which the mean square must fall on average", "calibrated: early development sets"
    )
    most_samples: int = number(3000, "1", "samples that are shown to the trees", "chosen: work")
    least_samples: int = number(
        200, "1", "samples of a joint below which no trees are grown", "chosen: fewer than two leaves a fold"
    )
    enough: float = number(
        0.8,
        "1",
        "share of what all inputs explain at which a smaller set of them is told as the kind",
        "chosen: most of it",
    )
    worth_trees: float = number(
        1.05,
        "1",
        "error over noise from which on trees are put in the names' place",
        "chosen: else there is nothing to learn",
    )
    rounds: int = number(40, "1", "trees", "chosen: few, for few samples")
    leaves: int = number(12, "1", "leaves of a tree", "chosen: few, for few samples")
    rate: float = number(0.15, "1", "share of each tree's answer that is taken", "chosen: usual for so few trees")
    leaf_samples: int = number(25, "1", "samples of a leaf", "chosen: a mean that noise moves by a fifth")
    penalty: float = number(1.0, "1", "of the squares of the leaves' answers", "chosen: usual")
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


USUAL_MAP, USUAL_TREES, USUAL_REPLAY = MapSettings(), TreeSettings(), ReplaySettings()


@dataclass(frozen=True)
class GapSettings(Settings):
    """Where the gap lies and how far it shrinks."""

    map: MapSettings = USUAL_MAP
    trees: TreeSettings = USUAL_TREES
    replay: ReplaySettings = USUAL_REPLAY


USUAL_GAP = GapSettings()
