"""How far apart the pairs of a scene have to stay, and whether a motion keeps it at every instant.

Links that are closer to each other at the start or the goal than the clearance asked for keep what they have there; of
links that the arm's build hardly ever lets be that far apart, half of what it lets them is asked for. All other pairs
keep what was asked for; an end at which an obstacle is nearer than that is refused.

The proof is conservative advancement by Coal's distances. From an instant at which a pair is d apart, the pair can't
come closer than c before (d − c) / v has passed, v being the most that the pair's distance can change in a second. So
the check walks along the motion in such steps; a motion that is walked to its end keeps c between its samples too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from plan.geometry.scene import Scene
from plan.spline import Splines

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


# The walk is given up where it would have to be finer than this [s].
FINEST = 1e-6
# Pairs that are known to be so much farther apart than the target are not looked at closer [m].
NEAR = 0.2
# How far below the smallest distance seen the proven clearance may lie [m].
SLACK = 2e-4
# A smallest distance nearer than this to what was asked for is not proven to lie above it [m].
CLOSEST = 2e-5


@dataclass(frozen=True)
class Clearance:
    """What is known of a motion's clearance."""

    proven: float  # the motion keeps at least this, between samples too; below zero if it collides [m]
    seen: float  # smallest distance met [m]
    time: float  # when [s]
    pair: str  # names of the two shapes
    checks: int  # positions looked at; none where there was no pair to look at, and nothing is proven

    @property
    def collision_free(self) -> bool:
        """Whether the whole motion is proven to be free."""
        return self.proven > 0.0


def prove_clearance(
    scene: Scene, splines: Splines, wanted: Bool[Array, " P"] | None = None, samples: int = 200, asked: float = 0.0
) -> Clearance:
    """Smallest distance of the wanted pairs along the first of a batch of motions, proven for every instant.

    Args:
        scene: Shapes and pairs.
        splines: The motion.
        wanted: Pairs to look at; all if None.
        samples: Places at which a first guess of the smallest distance is taken.
        asked: What is to be proven if it can be; where less than the slack is left above it, the walk is finer [m].
    """
    wanted = np.ones(len(scene.pairs), dtype=bool) if wanted is None else wanted
    if not wanted.any():
        return Clearance(1.0, 1.0, 0.0, "nothing to hit", 0)
    seen, when, which = np.inf, 0.0, 0
    times = np.linspace(0.0, float(splines.total[0]), samples)
    for time, q in zip(times, splines.at(times)[0], strict=True):
        # The start is looked at inside of meshes too.
        distances = np.where(wanted, scene.distances(q), np.inf) if time == 0.0 else _near(scene, q, wanted, seen, 0.0)
        if distances.min() < seen:
            seen, when, which = float(distances.min()), float(time), int(np.argmin(distances))
    checks, since = samples, 0.0
    while seen > 0.0:
        target = max(seen - SLACK, 0.5 * seen, asked if seen > asked + CLOSEST else 0.0)
        least, where, worst, count = _walk(scene, splines, target, since, wanted)
        checks += count
        if least >= target:
            return Clearance(float(target), min(seen, least), when, scene.pair_name(which), checks)
        # What was walked with a higher target holds for the lower one, too.
        seen, when, since, which = least, where, where, worst
    return Clearance(min(seen, 0.0), seen, when, scene.pair_name(which), checks)


def _near(
    scene: Scene, q: Float[Array, " n"], wanted: Bool[Array, " P"], target: float, near: float
) -> Float[Array, " P"]:
    """Distances of the wanted pairs, exact where they come near the target [m]; infinite of the others."""
    beyond = np.where(wanted, max(target, 0.0), -np.inf)
    return np.where(wanted, scene.near_distances(q, beyond, near), np.inf)


def _walk(
    scene: Scene, splines: Splines, target: float, since: float, wanted: Bool[Array, " P"]
) -> tuple[float, float, int, int]:
    """Walks along the motion in safe steps from a time on [s]; stops at the first place closer than the target.

    Returns:
        Smallest distance met [m], its time [s], its pair, and the number of positions looked at.
    """
    knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
    # Top change of each pair's distance in each section, exact for the cubic's speed [m/s].
    rates = np.maximum(splines.section_speeds[0] @ scene.levers.T, 1e-9)
    least, where, worst, count, t = np.inf, since, 0, 0, since
    while True:
        section = min(int(np.searchsorted(knots, t, side="right")) - 1, len(rates) - 1)
        distances = _near(scene, splines.at(np.array([t]))[0][0], wanted, target, NEAR)
        count += 1
        if distances.min() < least:
            least, where, worst = float(distances.min()), t, int(np.argmin(distances))
        if least < target or t >= knots[-1]:
            return least, where, worst, count
        clear = t + float(((distances - target) / rates[section]).min())
        # Rates hold for the section: look again where it ends.
        t = min(max(clear, t + FINEST), float(knots[section + 1]))
