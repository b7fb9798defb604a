"""Is a motion free of collisions, at every instant? Conservative advancement by Coal's distances.

From an instant at which a pair is d apart, the pair can't come closer than c before (d − c) / v has passed, v being
the most that the pair's distance can change in a second. So the check walks along the motion in such steps; a motion
that is walked to its end keeps c between its samples too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from plan.geometry.scene import Scene
from plan.spline import Splines

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
    """What is known of a motion's clearance.

    Attributes:
        proven: The motion keeps at least this, between samples too; below zero if it collides [m].
        seen: Smallest distance met [m].
        time: When [s].
        pair: Names of the two shapes.
        checks: Positions looked at.
    """

    proven: float
    seen: float
    time: float
    pair: str
    checks: int

    @property
    def checked(self) -> bool:
        """Whether there was any pair to look at; without one nothing is proven."""
        return self.checks > 0

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
    total = float(splines.total[0])
    wanted = np.ones(len(scene.pairs), dtype=bool) if wanted is None else wanted
    if not wanted.any():
        return Clearance(1.0, 1.0, 0.0, "nothing to hit", 0)
    times = np.linspace(0.0, total, samples)
    seen, when, name = _least(scene, splines, times, wanted)
    checks, since = samples, 0.0
    while seen > 0.0:
        target = max(seen - SLACK, 0.5 * seen, asked if seen > asked + CLOSEST else 0.0)
        least, where, worst, count = _walk(scene, splines, target, since, wanted)
        checks += count
        if least >= target:
            return Clearance(float(target), min(seen, least), when, name, checks)
        # What was walked with a higher target holds for the lower one, too.
        seen, when, since, name = least, where, where, scene.pair_name(worst)
    return Clearance(min(seen, 0.0), seen, when, name, checks)


def _least(
    scene: Scene, splines: Splines, times: Float[Array, " T"], wanted: Bool[Array, " P"]
) -> tuple[float, float, str]:
    """Smallest distance at some times [m], when, and of which pair; the start is looked at inside of meshes too."""
    positions = splines.at(times)[0]
    distances = np.where(wanted, scene.distances(positions[0]), np.inf)
    pair = int(np.argmin(distances))
    seen, when, which = float(distances[pair]), float(times[0]), pair
    for time, q in zip(times[1:], positions[1:], strict=True):
        distances = _distances(scene, q, max(seen, 0.0), 0.0, wanted)
        pair = int(np.argmin(distances))
        if distances[pair] < seen:
            seen, when, which = float(distances[pair]), float(time), pair
    return seen, when, scene.pair_name(which)


def _distances(
    scene: Scene, q: Float[Array, " n"], target: float, near: float, wanted: Bool[Array, " P"]
) -> Float[Array, " P"]:
    """Distances of the wanted pairs, exact where they come near the target [m]; infinite of the others."""
    return np.where(wanted, scene.near_distances(q, np.where(wanted, target, -np.inf), near), np.inf)


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
    clear = np.zeros(len(scene.pairs))
    while True:
        section = min(int(np.searchsorted(knots, t, side="right")) - 1, len(rates) - 1)
        q: Float[Array, " n"] = splines.at(np.array([t]))[0][0]
        distances = _distances(scene, q, target, NEAR, wanted)
        count += 1
        if distances.min() < least:
            least, where, worst = float(distances.min()), t, int(np.argmin(distances))
        if least < target or t >= knots[-1]:
            return least, where, worst, count
        clear = t + (distances - target) / rates[section]
        # Rates hold for the section: look again where it ends.
        t = min(max(float(clear.min()), t + FINEST), float(knots[section + 1]))
