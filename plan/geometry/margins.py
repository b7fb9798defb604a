"""How far apart each pair of shapes has to stay: what was asked for, and where an end of the motion allows less.

Links that are closer to each other at the start or the goal than the clearance asked for keep what they have there; of
links that the arm's build hardly ever lets be that far apart, half of what it lets them is asked for. All other pairs
keep what was asked for; an end at which an obstacle is nearer than that is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float, freeze

if TYPE_CHECKING:
    from plan.geometry.scene import Scene

# A proven clearance may fall short of what has to be kept by this [m].
SHORT = 5e-4
# So far below the gap that a pair has at an end lies the least that a search lets it have on the way: a motion that
# could not lose a micrometre on its first step would not begin [m].
ROOM = 0.2 * SHORT
ENDS = ("start", "goal", "build")


@dataclass(frozen=True, eq=False)
class Margins:
    """What a search keeps of the compiled gaps [m].

    Attributes:
        asked: Clearance asked for.
        pairs: Least gap of each pair.
        bodies: The same for each pair of links, then for each moving link against the whole world.
    """

    asked: float
    pairs: Float[Array, " P"]
    bodies: Float[Array, " c"]


@dataclass(frozen=True)
class Cut:
    """Two links that have to be closer to each other than was asked for.

    Attributes:
        pair: Number of the pair.
        links: Their names.
        end: Where they are that close: start, goal, or almost everywhere by the arm's build.
        asked, kept: Clearance asked for, and what they keep [m].
    """

    pair: int
    links: tuple[str, str]
    end: str
    asked: float
    kept: float

    def __str__(self) -> str:
        links, kept, asked = " and ".join(self.links), f"{1000 * self.kept:.1f} mm", f"{1000 * self.asked:g} mm"
        if self.end == "build":
            return f"{links} are hardly ever {asked} apart on this arm and keep {kept} instead"
        return f"{links} are {kept} apart at the {self.end} and keep that instead of the {asked} asked for"

    def to_dict(self) -> dict[str, object]:
        return {"links": list(self.links), "end": self.end, "asked_m": self.asked, "kept_m": self.kept}


def find_margins(scene: Scene, ends: Float[Array, "2 n"], asked: float) -> Margins:
    """What a search keeps: the clearance asked for, or almost what a pair's compiled gap is at an end if that is less.

    An obstacle's compiled gap may lie below the true distance, so obstacles are treated alike here; the motion found
    is then proven by true distances, against `find_cuts`.
    """
    have = scene.gaps(ends, asked + SHORT).min(axis=0)
    room = np.where(have > 2 * ROOM, ROOM, np.maximum(0.5 * have, 1e-6))
    pairs = np.minimum(_possible(scene, asked), have - room)
    return Margins(asked, freeze(pairs), freeze(scene.by_body(pairs)))


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
