"""Which pairs of shapes are looked at and which are left out, by an SRDF file too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.errors import InputError
from ident.records import Record
from ident.robot.arm import ArmModel
from ident.robot.safe_xml import read_xml
from ident.safe_read import read_text
from plan.dynamics.rigid import random_positions
from plan.geometry.compiled import compile_scene
from plan.geometry.solids import Box
from plan.geometry.sweep import ALL, gaps_of_states
from plan.geometry.tool import CARRIED

# A pair of links that overlaps in most positions is an overlap of the shapes, not of the arm.
ALWAYS = 0.5
PROBES = 500
# Attributes of an SRDF's elements that name links and joints.
SRDF_NAMES = {
    "disable_collisions": ("link1", "link2"),
    "joint": ("name",),
    "chain": ("base_link", "tip_link"),
    "link": ("name",),
}
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
    arm: ArmModel,
    links: Sequence[Box],
    obstacles: Sequence[Box],
    left_out: Mapping[frozenset[str], str],
) -> tuple[list[tuple[int, int]], tuple[Unchecked, ...]]:
    """Pairs to check, by numbers of links and then of obstacles, and those that could move and are
    not checked.

    Links whose joints meet in one point, as a shoulder's two, are neighbours too: the boxes round
    such a hub overlap where the rounded castings do not. A floor is not checked against what stands
    on it wherever the arm is.

    Args:
        arm: The arm.
        links: Its shapes and what it carries, from the base on.
        obstacles: Shapes fixed to the world.
        left_out: Pairs of links to leave out, by name, with the reason.
    """
    boxes = (*links, *obstacles)
    count = len(links)
    between = []
    for i, k in combinations(range(count), 2):
        if links[i].joint != links[k].joint:
            between.append((i, k))
    reasons = _reasons_by_build(arm, links, between, left_out)
    between = [pair for pair in between if pair not in reasons]
    overlapping = (_probe(arm, links, count, between) < 0.0).mean(axis=0)
    for pair, share in zip(between, overlapping, strict=True):
        if share >= ALWAYS:
            reasons[pair] = OVERLAP
    for pair in _standing_on_floors(arm, links, obstacles):
        reasons[pair] = "it stands there"
    outside = []
    for obstacle in range(count, len(boxes)):
        outside += [(obstacle, link) for link in range(count) if links[link].joint > 0]
    checked = []
    for first, second in [*between, *outside]:
        if (first, second) not in reasons and (second, first) not in reasons:
            checked.append((first, second))
    unchecked = []
    for (first, second), reason in reasons.items():
        unchecked.append(Unchecked((boxes[first].name, boxes[second].name), reason))
    # A shape of several solids is told once.
    return checked, tuple(dict.fromkeys(unchecked))


def _reasons_by_build(
    arm: ArmModel,
    links: Sequence[Box],
    pairs: Sequence[tuple[int, int]],
    left_out: Mapping[frozenset[str], str],
) -> dict[tuple[int, int], str]:
    """Why pairs of links are not looked at, of those that the arm's build or the user leaves out.

    Args:
        arm: The arm.
        links: Its shapes and what it carries, from the base on.
        pairs: Numbers of two of these each.
        left_out: Pairs of links to leave out, by name, with the reason.
    """
    lengths = np.linalg.norm(arm.chain.offsets, axis=1)
    reasons: dict[tuple[int, int], str] = {}
    for i, k in pairs:
        inner = links[i]
        outer = links[k]
        names = frozenset((inner.name, outer.name))
        if abs(outer.body - inner.body) <= 1:
            reasons[i, k] = "neighbours along the arm"
        elif _meet_in_a_point(inner, outer, lengths):
            reasons[i, k] = "their joints meet in one point"
        elif names in left_out:
            reasons[i, k] = left_out[names]
    return reasons


def _meet_in_a_point(inner: Box, outer: Box, lengths: Float[Array, " n"]) -> bool:
    """Whether all joints between two links lie in the same place.

    Args:
        inner, outer: The links, the one nearer to the base first.
        lengths: Distance of each joint from the one before it [m].
    """
    if max(inner.body, outer.body) >= CARRIED or outer.joint - inner.joint <= 1:
        return False
    return bool(lengths[inner.joint + 1 : outer.joint].sum() < HUB)


def _standing_on_floors(
    arm: ArmModel, links: Sequence[Box], obstacles: Sequence[Box]
) -> list[tuple[int, int]]:
    """Links of the first joint that are sunk in a floor wherever the arm is.

    Returns:
        Numbers of the link and, behind all links, of the floor.
    """
    count = len(links)
    floors = [number for number, box in enumerate(obstacles) if box.name == FLOOR]
    lowest = [number for number, box in enumerate(links) if box.joint == 1]
    near = []
    for place in range(len(floors)):
        near += [(count + place, link) for link in lowest]
    boxes = [*links, *(obstacles[number] for number in floors)]
    is_sunk = np.asarray((_probe(arm, boxes, count, near) < 0.0).all(axis=0))
    standing = []
    for (place, link), always in zip(near, is_sunk, strict=True):
        if always:
            standing.append((link, count + floors[place - count]))
    return standing


def _probe(
    arm: ArmModel, boxes: Sequence[Box], links: int, pairs: list[tuple[int, int]]
) -> Float[Array, "500 p"]:
    """Gaps of some pairs at random positions [m].

    Args:
        arm: The arm.
        boxes: Its shapes and then others.
        links: How many are its own.
        pairs: Numbers of two shapes each.
    """
    if not pairs:
        return np.empty((PROBES, 0))
    scene = compile_scene(arm.chain, boxes, links)
    numbers = np.array(pairs, dtype=np.int64)
    # Read-only as a scene's are: loops are compiled anew for what may be written.
    numbers.setflags(write=False)
    q = freeze(random_positions(arm, PROBES))
    return np.asarray(gaps_of_states(scene, numbers, q, 1e9, ALL))


def read_srdf(path: Path, arm: ArmModel) -> ElementTree.Element:
    """The root of a robot's SRDF file.

    Robots are often called otherwise in their URDF than in their SRDF, so what counts is whether it
    speaks of this robot's links and joints.

    Raises:
        InputError: Not an SRDF file, or that of another robot.
    """
    if not path.exists():
        raise InputError(path, "no such SRDF file", "give its path, from the scene file on")
    remedy = "give an SRDF file"
    root = read_xml(read_text(path, remedy), path, remedy, InputError)
    if root.tag != "robot":
        what = f"the root element is <{root.tag}>, not <robot>"
        raise InputError(path, what, remedy)
    if root.get("name") != arm.name and not _names_only(root, arm):
        what = f"it is the SRDF of {root.get('name')!r}, the robot is {arm.name!r}"
        raise InputError(path, what, "give this robot's SRDF")
    return root


def _names_only(root: ElementTree.Element, arm: ArmModel) -> bool:
    """Whether an SRDF names links and joints, and all of them are the robot's."""
    known = {frame.name for frame in arm.model.frames}
    named = {
        element.get(key)
        for tag, keys in SRDF_NAMES.items()
        for element in root.iter(tag)
        for key in keys
    }
    return bool(named) and named <= known


def read_disabled(path: Path, arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that an SRDF file leaves out of checks, and the reason that it gives.

    Raises:
        InputError: Not an SRDF file, or that of another robot.
    """
    root = read_srdf(path, arm)
    frames = arm.model.frames
    links = {frame.name for frame in frames if frame.type == pin.FrameType.BODY}
    of = path.name
    if root.get("name") != arm.name:
        of += f", which is of a robot {root.get('name')!r}"
    disabled = {}
    for element in root.findall("disable_collisions"):
        pair = frozenset((element.get("link1", ""), element.get("link2", "")))
        for name in sorted(pair - links):
            what = f"the robot has no link {name!r}"
            raise InputError(path, what, "give this robot's SRDF")
        reason = element.get("reason", "no reason given")
        disabled[pair] = f"left out by {of}: {reason}"
    return disabled
