"""Which pairs of shapes are looked at and which are left out, by an SRDF file too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.records import Record
from ident.robot.arm import ArmModel
from ident.safe_read import read_text, read_xml
from plan.dynamics.rigid import random_positions
from plan.geometry.compiled import compile_scene
from plan.geometry.solids import Box
from plan.geometry.sweep import ALL, gaps_of_states
from plan.geometry.tool import CARRIED

# A pair of links that overlaps in most positions is an overlap of the shapes, not of the arm.
ALWAYS = 0.5
PROBES = 500
# Name of the obstacle on which the arm may stand.
FLOOR = "floor"
# Joints closer than this meet in one point [m].
HUB = 1e-6
# Why a pair is dropped that could hit: the shapes, as they are known here, do so nearly everywhere.
OVERLAP = "their shapes overlap in most positions"


@dataclass(frozen=True)
class Unchecked(Record):
    """Two links whose clearance is not looked at."""

    links: tuple[str, str]  # their names
    reason: str  # why


def choose_pairs(
    arm: ArmModel, links: Sequence[Box], obstacles: Sequence[Box], left_out: Mapping[frozenset[str], str]
) -> tuple[list[tuple[int, int]], tuple[Unchecked, ...]]:
    """Pairs to check, by numbers of links and then of obstacles, and those that could move and are not checked.

    Links whose joints meet in one point, as a shoulder's two, are neighbours too: the boxes round such a hub overlap
    where the rounded castings do not. A floor is not checked against what stands on it wherever the arm is.

    Args:
        arm: The arm.
        links: Its shapes and what it carries, from the base on.
        obstacles: Shapes fixed to the world.
        left_out: Pairs of links to leave out, by name, with the reason.
    """
    lengths, boxes, count = np.linalg.norm(arm.chain.offsets, axis=1), (*links, *obstacles), len(links)
    reasons: dict[tuple[int, int], str] = {}
    pairs = [(i, k) for i, k in combinations(range(count), 2) if links[i].joint != links[k].joint]
    for i, k in pairs:
        a, b = links[i], links[k]
        if abs(b.body - a.body) <= 1:
            reasons[i, k] = "neighbours along the arm"
        elif max(a.body, b.body) < CARRIED and lengths[a.joint + 1 : b.joint].sum() < HUB and b.joint - a.joint > 1:
            reasons[i, k] = "their joints meet in one point"
        elif frozenset((a.name, b.name)) in left_out:
            reasons[i, k] = left_out[frozenset((a.name, b.name))]
    pairs = [pair for pair in pairs if pair not in reasons]
    share = (_probe(arm, links, count, pairs) < 0.0).mean(axis=0)
    reasons |= {pair: OVERLAP for pair, often in zip(pairs, share, strict=True) if often >= ALWAYS}
    floors = [count + k for k, box in enumerate(obstacles) if box.name == FLOOR]
    near = [(count + f, i) for f in range(len(floors)) for i in range(count) if links[i].joint == 1]
    sunk = np.asarray((_probe(arm, [*links, *(boxes[k] for k in floors)], count, near) < 0.0).all(axis=0))
    standing = [(i, floors[f - count]) for (f, i), always in zip(near, sunk, strict=True) if always]
    reasons |= dict.fromkeys(standing, "it stands there")
    outside = [(k, i) for k in range(count, len(boxes)) for i in range(count) if links[i].joint > 0]
    checked = [pair for pair in [*pairs, *outside] if pair not in reasons and pair[::-1] not in reasons]
    unchecked = (Unchecked((boxes[i].name, boxes[k].name), reason) for (i, k), reason in reasons.items())
    return checked, tuple(dict.fromkeys(unchecked))


def _probe(arm: ArmModel, boxes: Sequence[Box], links: int, pairs: list[tuple[int, int]]) -> Float[Array, "500 p"]:
    """Gaps of some pairs at random positions [m]."""
    if not pairs:
        return np.empty((PROBES, 0))
    which, q = np.array(pairs, dtype=np.int64), random_positions(arm, PROBES)
    return np.asarray(gaps_of_states(compile_scene(arm.chain, boxes, links), which, q, 1e9, ALL))


def read_srdf(path: Path, arm: ArmModel) -> ElementTree.Element:
    """The root of a robot's SRDF file.

    Raises:
        InputError: Not an SRDF file, or that of another robot.
    """
    if not path.exists():
        raise InputError(path, "no such SRDF file", "give its path, from the scene file on")
    root = read_xml(read_text(path, "give an SRDF file"), path, "give an SRDF file", InputError)
    if root.tag != "robot":
        raise InputError(path, f"the root element is <{root.tag}>, not <robot>", "give an SRDF file")
    if root.get("name") != arm.name:
        what = f"it is the SRDF of {root.get('name')!r}, the robot is {arm.name!r}"
        raise InputError(path, what, "give this robot's SRDF")
    return root


def read_disabled(path: Path, arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that an SRDF file leaves out of checks, and the reason that it gives.

    Raises:
        InputError: Not an SRDF file, or that of another robot.
    """
    root = read_srdf(path, arm)
    links = {frame.name for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    found = {}
    for element in root.findall("disable_collisions"):
        pair = frozenset((element.get("link1", ""), element.get("link2", "")))
        for name in sorted(pair - links):
            raise InputError(path, f"the robot has no link {name!r}", "give this robot's SRDF")
        found[pair] = f"left out by {path.name}: {element.get('reason', 'no reason given')}"
    return found
