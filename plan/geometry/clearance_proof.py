"""How far apart the pairs of a scene have to stay, and whether a motion keeps it at every instant.

Links that are closer to each other at the start or the goal than the clearance asked for keep what
they have there; of links that the arm's build hardly ever lets be that far apart, half of what it
lets them is asked for. All other pairs keep what was asked for; an end at which an obstacle is
nearer than that is refused.

The proof is conservative advancement by Coal's distances. From an instant at which a pair is d
apart, the pair can't come closer than c before (d − c) / v has passed, v being the most that the
pair's distance can change in a second. So the check walks along the motion in such steps; a motion
that is walked to its end keeps c between its samples too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, freeze
from plan.geometry.scene import Scene
from plan.spline import Splines

# A proven clearance may fall short of what has to be kept by this [m].
SHORT = 5e-4
# So far below the gap that a pair has at an end lies the least that a search lets it have on the
# way: a motion that could not lose a micrometre on its first step would not begin [m].
ROOM = 0.2 * SHORT
# Least gap that is kept of a pair that touches at an end [m].
LEAST = 1e-6
ENDS = ("start", "goal", "build")
# The walk is given up where it would have to be finer than this [s].
FINEST = 1e-6
# Pairs that are known to be so much farther apart than the target are not looked at closer [m].
NEAR = 0.2
# How far below the smallest distance seen the proven clearance may lie [m].
SLACK = 2e-4
# A smallest distance nearer than this to what was asked for is not proven to lie above it [m].
CLOSEST = 2e-5


@dataclass(frozen=True)
class Cut:
    """Two links that have to be closer to each other than was asked for."""

    pair: int  # number of the pair
    links: tuple[str, str]  # their names
    end: str  # where they are that close: start, goal, or almost everywhere by the arm's build
    asked: float  # clearance asked for, and what they keep [m]
    kept: float

    def __str__(self) -> str:
        links = " and ".join(self.links)
        keeps = f"{1000 * self.kept:.1f} mm"
        asked = f"{1000 * self.asked:g} mm"
        if self.end == "build":
            return f"{links} are hardly ever {asked} apart on this arm and keep {keeps} instead"
        apart = f"{links} are {keeps} apart at the {self.end}"
        return f"{apart} and keep that instead of the {asked} asked for"

    def to_dict(self) -> dict[str, object]:
        """Its record: "links" (two names), "end", "asked_m" and "kept_m"."""
        return {
            "links": list(self.links),
            "end": self.end,
            "asked_m": self.asked,
            "kept_m": self.kept,
        }


def find_margins(scene: Scene, ends: Float[Array, "2 n"], asked: float) -> Float[Array, " P"]:
    """Least compiled gap of each pair that a search keeps [m].

    That is the clearance asked for, or almost what the pair's gap is at an end if that is less.

    An obstacle's compiled gap may lie below the true distance, so obstacles are treated alike here;
    the motion found is then proven by true distances, against `find_cuts`.
    """
    gaps = scene.gaps(ends, asked + SHORT).min(axis=0)
    room = np.where(gaps > 2 * ROOM, ROOM, np.maximum(0.5 * gaps, LEAST))
    return freeze(np.minimum(_possible(scene, asked), gaps - room))


def _possible(scene: Scene, asked: float) -> Float[Array, " P"]:
    """What can be asked of each pair [m].

    Where the arm's build hardly ever allows so much, half of what it allows.
    """
    return np.where(scene.widest < asked, 0.5 * scene.widest, asked)


def find_cuts(scene: Scene, ends: Float[Array, "2 n"], asked: float) -> tuple[Cut, ...]:
    """Pairs of the arm's own shapes that keep less than was asked for.

    Args:
        scene: Shapes and pairs.
        ends: Start and goal.
        asked: Clearance that was asked for [m].

    Returns:
        One a pair that keeps less at an end, or anywhere; empty if there is none.
    """
    if len(scene.pairs) == 0:
        return ()
    at_ends = [scene.distances(q) for q in ends]
    distances = np.array([*at_ends, _possible(scene, asked)])
    end = distances.argmin(axis=0)
    least = distances.min(axis=0)
    cuts = []
    for number in np.flatnonzero(scene.own & (least < asked)):
        pair = int(number)
        keeps = max(float(least[pair]), 0.0)
        cuts.append(Cut(pair, scene.names_of(pair), ENDS[end[pair]], asked, keeps))
    return tuple(cuts)


def why_refused(scene: Scene, q: Float[Array, " n"], asked: float) -> tuple[str, str] | None:
    """Why no motion may start or end at a position, and the remedy; None where a motion may."""
    if len(scene.pairs) == 0:
        return None
    distances = scene.distances(q)
    deepest = int(np.argmin(distances))
    if distances[deepest] <= 0.0:
        depth = f"{1000 * -distances[deepest]:.0f} mm deep"
        what = f"{scene.pair_name(deepest)} collide there, {depth}"
        return what, "move that position or the obstacle"
    outside = np.where(scene.own, np.inf, distances)
    nearest = int(np.argmin(outside))
    if outside[nearest] >= asked - SHORT:
        return None
    apart = f"{1000 * outside[nearest]:.1f} mm apart there"
    what = f"{scene.pair_name(nearest)} are {apart}, {1000 * asked:g} mm are asked for"
    return what, "move that position or the obstacle, or lower task.clearance_m"


@dataclass(frozen=True)
class Clearance:
    """What is known of a motion's clearance."""

    # The motion keeps at least this, between samples too; below zero if it collides [m].
    proven: float
    seen: float  # smallest distance met [m]
    time: float  # when [s]
    pair: str  # names of the two shapes
    # Positions looked at; none where there was no pair to look at, and nothing is proven.
    checks: int

    @property
    def collision_free(self) -> bool:
        """Whether the whole motion is proven to be free."""
        return self.proven > 0.0


@dataclass(frozen=True)
class _Closest:
    """Where pairs come closest, as far as a motion was looked at."""

    distance: float = np.inf  # smallest distance met [m]
    time: float = 0.0  # when [s]
    pair: int = 0  # number of the pair

    def or_nearer(self, distances: Float[Array, " P"], time: float) -> _Closest:
        """The same, or where it is now if some pair is nearer here."""
        if distances.min() < self.distance:
            return _Closest(float(distances.min()), time, int(np.argmin(distances)))
        return self


def prove_clearance(
    scene: Scene,
    splines: Splines,
    wanted: Bool[Array, " P"] | None = None,
    samples: int = 200,
    asked: float = 0.0,
) -> Clearance:
    """Smallest distance of the wanted pairs along the first of a batch of motions.

    It is proven for every instant.

    Args:
        scene: Shapes and pairs.
        splines: The motion.
        wanted: Pairs to look at; all if None.
        samples: Places at which a first guess of the smallest distance is taken.
        asked: What is to be proven if it can be; where less than the slack is left above it, the
            walk is finer [m].
    """
    if wanted is None:
        wanted = np.ones(len(scene.pairs), dtype=bool)
    if not wanted.any():
        return Clearance(1.0, 1.0, 0.0, "nothing to hit", 0)
    closest = _look_at_samples(scene, splines, wanted, samples)
    checks = samples
    since = 0.0
    while closest.distance > 0.0:
        target = _target(closest.distance, asked)
        met, count = _walk(scene, splines, target, since, wanted)
        checks += count
        if met.distance >= target:
            seen = min(closest.distance, met.distance)
            name = scene.pair_name(closest.pair)
            return Clearance(float(target), seen, closest.time, name, checks)
        # What was walked with a higher target holds for the lower one, too.
        closest = met
        since = met.time
    name = scene.pair_name(closest.pair)
    proven = min(closest.distance, 0.0)
    return Clearance(proven, closest.distance, closest.time, name, checks)


def _target(seen: float, asked: float) -> float:
    """Clearance that is tried to be proven where the smallest distance seen is as given [m]."""
    target = max(seen - SLACK, 0.5 * seen)
    if seen > asked + CLOSEST:
        target = max(target, asked)
    return target


def _look_at_samples(
    scene: Scene, splines: Splines, wanted: Bool[Array, " P"], samples: int
) -> _Closest:
    """Where the wanted pairs are closest, of so many instants evenly along a motion."""
    closest = _Closest()
    times = np.linspace(0.0, float(splines.total[0]), samples)
    positions = splines.at(times)[0]
    for time, q in zip(times, positions, strict=True):
        if time == 0.0:
            # The start is looked at inside of meshes too.
            distances = np.where(wanted, scene.distances(q), np.inf)
        else:
            distances = _near(scene, q, wanted, closest.distance, 0.0)
        closest = closest.or_nearer(distances, float(time))
    return closest


def _near(
    scene: Scene, q: Float[Array, " n"], wanted: Bool[Array, " P"], target: float, near: float
) -> Float[Array, " P"]:
    """Distances of the wanted pairs, exact where they come near the target [m]; else infinite."""
    beyond = np.where(wanted, max(target, 0.0), -np.inf)
    return np.where(wanted, scene.near_distances(q, beyond, near), np.inf)


def _walk(
    scene: Scene, splines: Splines, target: float, since: float, wanted: Bool[Array, " P"]
) -> tuple[_Closest, int]:
    """Walks along the motion in safe steps; stops at the first place closer than the target.

    Args:
        scene: Shapes and pairs.
        splines: The motion.
        target: Clearance that is to be proven [m].
        since: Time from which on it is walked [s].
        wanted: Pairs to look at.

    Returns:
        Where the pairs came closest, and the number of positions looked at.
    """
    knots = np.concatenate([[0.0], np.cumsum(splines.durations[0])])
    # Top change of each pair's distance in each section, exact for the cubic's speed [m/s].
    rates = np.maximum(splines.section_speeds[0] @ scene.levers.T, 1e-9)
    closest = _Closest(time=since)
    count = 0
    time = since
    while True:
        section = int(np.searchsorted(knots, time, side="right")) - 1
        section = min(section, len(rates) - 1)
        position = splines.at(np.array([time]))[0][0]
        distances = _near(scene, position, wanted, target, NEAR)
        count += 1
        closest = closest.or_nearer(distances, time)
        if closest.distance < target or time >= knots[-1]:
            return closest, count
        clear = _clear_until(time, section, distances - target, rates, knots)
        time = min(max(clear, time + FINEST), float(knots[-1]))


def _clear_until(
    time: float,
    section: int,
    spare: Float[Array, " P"],
    rates: Float[Array, "K P"],
    knots: Float[Array, " k"],
) -> float:
    """Until when no pair can have come as close as the target [s].

    A controller's curve has a section a tick: were each of them looked at, the proof of a motion of
    two seconds would take one.

    Args:
        time: When the arm is where it was looked at [s].
        section: The section which that lies in.
        spare: What each pair has there beyond the target [m].
        rates: Top change of each pair's distance in each section [m/s].
        knots: Ends of the sections, and the first one's beginning [s].
    """
    while True:
        clear = time + float((spare / rates[section]).min())
        ends = float(knots[section + 1])
        if clear < ends or section == len(rates) - 1:
            return clear
        spare = spare - rates[section] * (ends - time)
        time = ends
        section += 1
