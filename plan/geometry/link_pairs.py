"""Which pairs of links are looked at, which are left out, by an SRDF file too, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from ident.safe_read import read_text, read_xml
from plan.errors import SceneError
from plan.geometry.boxes import Box
from plan.geometry.compiled import build_tree, compile_bodies
from plan.geometry.sweep import ALL, gaps_of_states
from plan.geometry.tool import CARRIED

# A pair of links that overlaps in most positions is an overlap of the shapes, not of the arm.
ALWAYS = 0.5
PROBES = 500
# Name of the obstacle on which the arm may stand.
FLOOR = "floor"
# Joints closer than this meet in one point [m].
HUB = 1e-6


@dataclass(frozen=True)
class Unchecked:
    """Two links whose clearance is not looked at.

    Attributes:
        links: Their names.
        reason: Why.
    """

    links: tuple[str, str]
    reason: str

    def to_dict(self) -> dict[str, object]:
        return {"links": list(self.links), "reason": self.reason}


def link_pairs(arm: ArmModel, links: Sequence[Box]) -> tuple[list[tuple[int, int]], list[Unchecked]]:
    """Pairs of links that can move against each other, parted into those to check and neighbours along the arm.

    Links whose joints meet in one point, as a shoulder's two, are neighbours too: the boxes round such a hub overlap
    where the rounded castings do not.
    """
    lengths = np.linalg.norm(arm.chain.offsets, axis=1)
    pairs, unchecked = [], []
    for i, a in enumerate(links):
        for k, b in enumerate(links[i + 1 :], start=i + 1):
            if a.joint == b.joint:
                continue
            if abs(b.body - a.body) <= 1:
                unchecked.append(unchecked_pair(links, (i, k), "neighbours along the arm"))
            elif max(a.body, b.body) < CARRIED and lengths[a.joint + 1 : b.joint].sum() < HUB and b.joint - a.joint > 1:
                unchecked.append(unchecked_pair(links, (i, k), "their joints meet in one point"))
            else:
                pairs.append((i, k))
    return pairs, unchecked


def names_of_pair(links: Sequence[Box], pair: tuple[int, int]) -> frozenset[str]:
    return frozenset((links[pair[0]].name, links[pair[1]].name))


def find_standing(arm: ArmModel, links: Sequence[Box], obstacles: Sequence[Box]) -> set[tuple[int, int]]:
    """Floors, by number, and links that overlap with them wherever the arm is: those that turn on the base."""
    floors = [k for k, box in enumerate(obstacles) if box.name == FLOOR]
    near = [i for i, box in enumerate(links) if box.joint == 1]
    pairs = [(k, i) for k in floors for i in near]
    places = [(len(links) + floors.index(k), i) for k, i in pairs]
    gaps = _probe(arm, (*links, *(obstacles[k] for k in floors)), len(links), places)
    return {pair for k, pair in enumerate(pairs) if (gaps[:, k] < 0.0).all()}


def unchecked_pair(links: Sequence[Box], pair: tuple[int, int], reason: str) -> Unchecked:
    return Unchecked((links[pair[0]].name, links[pair[1]].name), reason)


def drop_always(
    arm: ArmModel, links: Sequence[Box], pairs: list[tuple[int, int]]
) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
    """Parts the pairs into those to check and those whose shapes overlap in half of 500 fixed positions."""
    share = (_probe(arm, links, len(links), pairs) < 0).mean(axis=0)
    kept = [pair for pair, often in zip(pairs, share, strict=True) if often < ALWAYS]
    return kept, [pair for pair, often in zip(pairs, share, strict=True) if often >= ALWAYS]


def _probe(arm: ArmModel, boxes: Sequence[Box], links: int, pairs: list[tuple[int, int]]) -> Float[Array, "500 p"]:
    """Gaps of some pairs at fixed positions [m]."""
    rng = np.random.default_rng(0)  # fixed: which pairs are checked must not depend on the run's seed
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = rng.uniform(low, high, (PROBES, arm.n))
    if not pairs:
        return np.empty((PROBES, 0))
    bodies, numbers = compile_bodies(boxes), np.array(pairs, dtype=np.int64)
    tree = build_tree(bodies, len(boxes), links)
    room = bodies.rot.copy(), bodies.at.copy()
    return np.asarray(gaps_of_states(arm.chain, bodies, links, room, numbers, tree, q, 1e9, ALL))


def read_disabled(path: Path, arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that an SRDF file leaves out of checks, and the reason that it gives.

    Raises:
        SceneError: Not an SRDF file, or that of another robot.
    """
    if not path.exists():
        raise SceneError(path, "no such SRDF file", "give its path, from the scene file on")
    text = read_text(path, "give an SRDF file", SceneError)
    root = read_xml(text, path, "give an SRDF file", SceneError)
    if root.tag != "robot":
        raise SceneError(path, f"the root element is <{root.tag}>, not <robot>", "give an SRDF file")
    if root.get("name") != arm.name:
        raise SceneError(
            path, f"it is the SRDF of {root.get('name')!r}, the robot is {arm.name!r}", "give this robot's SRDF"
        )
    links = {frame.name for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    found = {}
    for element in root.findall("disable_collisions"):
        pair = [element.get("link1", ""), element.get("link2", "")]
        unknown = [name for name in pair if name not in links]
        if unknown:
            raise SceneError(path, f"the robot has no link {unknown[0]!r}", "give this robot's SRDF")
        found[frozenset(pair)] = f"left out by {path.name}: {element.get('reason', 'no reason given')}"
    return found
