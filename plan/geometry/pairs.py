"""Which pairs of shapes are looked at and which are left out, by an SRDF file too, and how far apart each has to stay.

Links that are closer to each other at the start or the goal than the clearance asked for keep what they have there; of
links that the arm's build hardly ever lets be that far apart, half of what it lets them is asked for. All other pairs
keep what was asked for; an end at which an obstacle is nearer than that is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.errors import InputError
from ident.records import Record
from ident.robot.arm import ArmModel
from ident.safe_read import read_text, read_xml
from plan.dynamics.rigid import random_positions
from plan.geometry.compiled import compile_scene
from plan.geometry.solids import Box
from plan.geometry.sweep import ALL, gaps_of_states
from plan.geometry.tool import CARRIED

if TYPE_CHECKING:
    from plan.geometry.scene import Scene

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


def read_disabled(path: Path, arm: ArmModel) -> dict[frozenset[str], str]:
    """Pairs of links that an SRDF file leaves out of checks, and the reason that it gives.

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
    links = {frame.name for frame in arm.model.frames if frame.type == pin.FrameType.BODY}
    found = {}
    for element in root.findall("disable_collisions"):
        pair = frozenset((element.get("link1", ""), element.get("link2", "")))
        for name in sorted(pair - links):
            raise InputError(path, f"the robot has no link {name!r}", "give this robot's SRDF")
        found[pair] = f"left out by {path.name}: {element.get('reason', 'no reason given')}"
    return found


# A proven clearance may fall short of what has to be kept by this [m].
SHORT = 5e-4
# So far below the gap that a pair has at an end lies the least that a search lets it have on the way: a motion that
# could not lose a micrometre on its first step would not begin [m].
ROOM = 0.2 * SHORT
ENDS = ("start", "goal", "build")


@dataclass(frozen=True)
class Cut:
    """Two links that have to be closer to each other than was asked for."""

    pair: int  # number of the pair
    links: tuple[str, str]  # their names
    end: str  # where they are that close: start, goal, or almost everywhere by the arm's build
    asked: float  # clearance asked for, and what they keep [m]
    kept: float

    def __str__(self) -> str:
        links, kept, asked = " and ".join(self.links), f"{1000 * self.kept:.1f} mm", f"{1000 * self.asked:g} mm"
        if self.end == "build":
            return f"{links} are hardly ever {asked} apart on this arm and keep {kept} instead"
        return f"{links} are {kept} apart at the {self.end} and keep that instead of the {asked} asked for"

    def to_dict(self) -> dict[str, object]:
        return {"links": list(self.links), "end": self.end, "asked_m": self.asked, "kept_m": self.kept}


def find_margins(scene: Scene, ends: Float[Array, "2 n"], asked: float) -> Float[Array, " P"]:
    """Least compiled gap of each pair that a search keeps [m].

    That is the clearance asked for, or almost what the pair's gap is at an end if that is less.

    An obstacle's compiled gap may lie below the true distance, so obstacles are treated alike here; the motion found
    is then proven by true distances, against `find_cuts`.
    """
    have = scene.gaps(ends, asked + SHORT).min(axis=0)
    room = np.where(have > 2 * ROOM, ROOM, np.maximum(0.5 * have, 1e-6))
    return freeze(np.minimum(_possible(scene, asked), have - room))


def _possible(scene: Scene, asked: float) -> Float[Array, " P"]:
    """What can be asked of each pair: where the arm's build hardly ever allows so much, half of what it allows."""
    return np.where(scene.widest < asked, 0.5 * scene.widest, asked)


def find_cuts(scene: Scene, ends: Float[Array, "2 n"], asked: float) -> tuple[Cut, ...]:
    """Pairs of the arm's own shapes that keep less than was asked for."""
    if len(scene.pairs) == 0:
        return ()
    distances = np.array([*(scene.distances(q) for q in ends), _possible(scene, asked)])
    end, least = distances.argmin(axis=0), distances.min(axis=0)
    near = np.flatnonzero(scene.own & (least < asked))
    return tuple(Cut(int(p), scene.names_of(int(p)), ENDS[end[p]], asked, max(float(least[p]), 0.0)) for p in near)


def why_refused(scene: Scene, q: Float[Array, " n"], asked: float) -> tuple[str, str] | None:
    """Why no motion may start or end at a position, and the remedy; None where one may."""
    if len(scene.pairs) == 0:
        return None
    distances = scene.distances(q)
    deepest = int(np.argmin(distances))
    if distances[deepest] <= 0.0:
        deep = f"{1000 * -distances[deepest]:.0f} mm deep"
        return f"{scene.pair_name(deepest)} collide there, {deep}", "move that position or the obstacle"
    outside = np.where(scene.own, np.inf, distances)
    nearest = int(np.argmin(outside))
    if outside[nearest] >= asked - SHORT:
        return None
    apart = f"{1000 * outside[nearest]:.1f} mm apart there, {1000 * asked:g} mm are asked for"
    return f"{scene.pair_name(nearest)} are {apart}", "move that position or the obstacle, or lower task.clearance_m"
