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
