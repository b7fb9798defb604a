"""Families of motions that an experimenter knows, each with a few figures, for one joint of an arm in some pose.

A programme is a list of runs. Every run starts and ends at the programme's home pose, so that they can be run one after
the other; the other joints stand in a pose of each run's own, which changes what the joint carries.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.trajectories.kinds import timed_spline
from ident.trajectories.limits import MotionLimits
from ident.trajectories.reference import TICK_S, ReferenceMotion, chirp, fourier, ramps, sampled, ticks, via_spline

RUN_S = 10.0
"""Rough duration of a run [s]."""
STILL_S = 0.3
"""Standstill at both ends of a run [s]."""
# Mean speed of the moves from home to a run's own pose and back, as a share of the speed limits.
TRANSFER_SHARE = 0.3
# Acceleration of corners between steady speeds [rad/s²].
CORNER = 3.0
HARMONICS = 5
# Random paths that are drawn until one touches nothing.
ATTEMPTS = 40


@dataclass(frozen=True)
class Figure:
    """A figure of a family that a search may choose.

    Attributes:
        name: With its unit.
        low, high: Bounds.
        log: Whether it is searched on a logarithmic scale.
    """

    name: str
    low: float
    high: float
    log: bool = False

    def at(self, share: float) -> float:
        """The figure at a share of its range."""
        share = float(np.clip(share, 0.0, 1.0))
        if self.log:
            return float(self.low * (self.high / self.low) ** share)
        return float(self.low + share * (self.high - self.low))


@dataclass(frozen=True, eq=False)
class Stage:
    """Where a run takes place.

    Attributes:
        limits: Of the arm.
        joint: The joint that is asked about.
        pose: The run's pose, in which the other joints stand [rad].
        size: Share of the family's reach that may be used: less where it would not fit.
        duration: Time for the run's own part [s].
        rng: Source of chance.
    """

    limits: MotionLimits
    joint: int
    pose: Float[Array, " n"]
    size: float
    duration: float
    rng: np.random.Generator

    @property
    def reach(self) -> float:
        """How far the joint may go to either side of the pose [rad]."""
        lower, upper = self.limits.lower[self.joint], self.limits.upper[self.joint]
        room = float(min(upper - self.pose[self.joint], self.pose[self.joint] - lower))
        return self.size * min(max(room, 0.0), float(self.limits.span[self.joint]))

    @property
    def top_speed(self) -> float:
        """Of the joint [rad/s]."""
        return float(self.limits.speed[self.joint])

    def alone(self, path: Float[Array, " K"]) -> Float[Array, "K n"]:
        """The joint follows a path, the others stand."""
        q = np.repeat(self.pose[None], len(path), axis=0)
        q[:, self.joint] = path
        return q


Builder = Callable[[Stage, Mapping[str, float]], Float[Array, "K n"]]


@dataclass(frozen=True, eq=False)
class Family:
    """A family of motions.

    Attributes:
        name: As in `ident.effects.effect_info`.
        figures: What a search may choose, beside the home pose.
        build: Positions of a run at the controller's ticks, from rest to rest.
    """

    name: str
    figures: tuple[Figure, ...]
    build: Builder


SPREAD = Figure("pose_spread", 0.0, 1.0)


def _ladder(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """There and back at steady speeds; the time is dealt out evenly among them, in an order of chance."""
    top = figures["fastest_share"] * stage.top_speed
    rungs = stage.rng.permutation(np.geomspace(min(figures["slowest_rad_s"], top), top, 5))
    return stage.alone(_there_and_back(stage, rungs, CORNER))


def _there_and_back(stage: Stage, speeds: Float[Array, " k"], corner: float) -> Float[Array, " K"]:
    middle, moves = float(stage.pose[stage.joint]), []
    for speed in speeds:
        half = min(stage.reach, 0.25 * speed * stage.duration / len(speeds))
        # Back to the middle each time: a slow rung must not begin with a fast one's long way.
        moves += [(middle + half, speed), (middle - half, speed), (middle, speed)]
    return ramps(middle, moves, corner, 0.05)


def _slow(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """There and back at two slow steady speeds."""
    speeds = figures["slowest_rad_s"] * np.array([1.0, figures["ratio"]])
    return stage.alone(_there_and_back(stage, speeds, CORNER))


def _poses(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """One path, both ways, at one speed, as often as the time allows: the pose of the others is what differs."""
    speed, middle = figures["speed_share"] * stage.top_speed, float(stage.pose[stage.joint])
    half = stage.reach * figures["reach"]
    count = max(1, int(stage.duration * speed / max(4.0 * half, 1e-6)))
    moves = [(middle + half, speed), (middle - half, speed)] * count
    return stage.alone(ramps(middle, [*moves, (middle, speed)], CORNER, 0.05))


def _reversals(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """Nested reversals: to and fro between turning points that draw together by a ratio, then anew."""
    speed, middle = figures["speed_rad_s"], float(stage.pose[stage.joint])
    first = min(figures["first_rad"], stage.reach, 0.25 * speed * stage.duration)
    moves, left, at, side, half = [], stage.duration, middle, 1.0, first
    while left > 0.0:
        goal = middle + side * half
        moves.append((goal, speed))
        left -= abs(goal - at) / speed + speed / CORNER + 0.05
        at, side, half = goal, -side, half * figures["ratio"]
        if half < figures["last_rad"]:
            half = first
    return stage.alone(ramps(middle, [*moves, (middle, speed)], CORNER, 0.05))


def _chirp(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """The joint, and to a share its neighbours, swept in frequency about the pose."""
    n, j = len(stage.pose), stage.joint
    swing = np.zeros(n)
    swing[j] = stage.size * figures["swing_rad"]
    for other in (j - 1, j + 1):
        if 0 <= other < n:
            swing[other] = figures["neighbours"] * swing[j]
    phase = stage.rng.uniform(0.0, 2.0 * np.pi, n)
    band = (figures["lowest_hz"], figures["highest_hz"])
    return chirp("", stage.pose, swing, band, phase, stage.duration).q


def _holds(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """Stops on the way there and back, each approached from both sides, with standstill after each approach."""
    middle, dwell, speed = float(stage.pose[stage.joint]), figures["dwell_s"], figures["speed_rad_s"]
    aside = min(0.12, 0.3 * stage.reach)
    each = 2.0 * (dwell + 1.0) + 4.0 * aside / speed
    stops = max(1, round(stage.duration / (each + 1.0)))
    moves = []
    for stop in middle + 0.8 * stage.reach * stage.rng.uniform(-1.0, 1.0, stops):
        moves += [(stop - aside, 3.0 * speed), (stop, speed), (stop + aside, speed), (stop, speed)]
    return stage.alone(ramps(middle, [*moves, (middle, 3.0 * speed)], CORNER, dwell))


def _wide(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """All joints by a Fourier series about the pose."""
    limits = stage.limits
    room = np.minimum(limits.upper - stage.pose, stage.pose - limits.lower)
    weight = stage.rng.uniform(0.4, 1.0, (HARMONICS, len(stage.pose))) / np.arange(1, HARMONICS + 1)[:, None]
    phase = stage.rng.uniform(0.0, 2.0 * np.pi, weight.shape)
    swing = stage.size * figures["swing"] * np.minimum(room, limits.span) * weight / weight.sum(axis=0)
    return fourier("", stage.pose, swing * np.sin(phase), swing * np.cos(phase), figures["base_hz"], stage.duration).q


def _vias(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """All joints by a clamped spline through via points of chance, at equal times; which points is a figure too."""
    limits = stage.limits
    rng = np.random.default_rng([int(figures["draw"]), int(stage.rng.integers(2**31))])
    room = np.minimum(limits.upper - stage.pose, stage.pose - limits.lower)
    swing = stage.size * figures["swing"] * np.minimum(room, limits.span)
    count = max(2, round(stage.duration / figures["leg_s"]) - 1)
    points = stage.pose + swing * rng.uniform(-1.0, 1.0, (count, len(stage.pose)))
    points = np.concatenate([stage.pose[None], np.clip(points, limits.lower, limits.upper), stage.pose[None]])
    return via_spline("", points, stage.duration).q


def _random(stage: Stage, figures: Mapping[str, float]) -> Float[Array, "K n"]:
    """All joints through random points anywhere and the same way back, slower where the limits need it.

    The simulator's usual motion, with which every proposal is compared; here it is a start like any other.
    """
    limits = stage.limits
    rng = np.random.default_rng([int(figures["draw"]), int(stage.rng.integers(2**31))])
    half = 0.5 * stage.duration * (1.0 if rng.uniform() < 0.5 else figures["fast_share"])
    count = max(2, round(0.5 * stage.duration / figures["leg_s"]))
    for attempt in range(ATTEMPTS):
        reach = 0.97**attempt * stage.size * figures["swing"] * limits.span
        points = limits.centre + reach * rng.uniform(-1.0, 1.0, (count, len(stage.pose)))
        points = np.concatenate([stage.pose[None], points])
        path = via_spline("", points, 1.0)
        inside = (path.q >= limits.lower).all() and (path.q <= limits.upper).all()
        if inside and not limits.touches(path.q):
            break
    # In one second the path has the speeds that it has in any other time, times that.
    there = timed_spline(limits, "", points, max(half, float((np.abs(path.dq) / limits.speed).max())))
    return np.concatenate([there.q, there.q[::-1]])


FAMILIES: dict[str, Family] = {
    family.name: family
    for family in (
        Family(
            "ladder",
            (Figure("slowest_rad_s", 0.015, 0.2, log=True), Figure("fastest_share", 0.1, 0.9), SPREAD),
            _ladder,
        ),
        Family(
            "vias",
            (
                Figure("swing", 0.4, 1.0),
                Figure("leg_s", 0.8, 3.0, log=True),
                Figure("draw", 0.0, 1000.0),
                Figure("pose_spread", 0.0, 0.3),
            ),
            _vias,
        ),
        Family(
            "random",
            (
                Figure("swing", 0.6, 1.0),
                Figure("leg_s", 1.0, 2.5, log=True),
                Figure("fast_share", 0.4, 1.0),
                Figure("draw", 0.0, 1000.0),
                Figure("pose_spread", 0.0, 0.3),
            ),
            _random,
        ),
        Family("slow", (Figure("slowest_rad_s", 0.015, 0.06, log=True), Figure("ratio", 1.3, 3.0), SPREAD), _slow),
        Family("poses", (Figure("speed_share", 0.05, 0.6, log=True), Figure("reach", 0.2, 1.0), SPREAD), _poses),
        Family(
            "reversals",
            (
                Figure("first_rad", 0.02, 0.6, log=True),
                Figure("last_rad", 0.002, 0.02, log=True),
                Figure("ratio", 0.4, 0.9),
                Figure("speed_rad_s", 0.03, 0.5, log=True),
                SPREAD,
            ),
            _reversals,
        ),
        Family(
            "chirp",
            (
                Figure("lowest_hz", 0.2, 3.0, log=True),
                Figure("highest_hz", 4.0, 15.0, log=True),
                Figure("swing_rad", 0.03, 0.5, log=True),
                Figure("neighbours", 0.0, 0.8),
                SPREAD,
            ),
            _chirp,
        ),
        Family("holds", (Figure("dwell_s", 0.3, 1.0), Figure("speed_rad_s", 0.05, 0.4, log=True), SPREAD), _holds),
        Family("wide", (Figure("base_hz", 0.08, 0.25, log=True), Figure("swing", 0.4, 1.0), SPREAD), _wide),
    )
}


def make_run(
    family: Family,
    figures: Mapping[str, float],
    limits: MotionLimits,
    joint: int,
    home: Float[Array, " n"],
    size: float,
    rng: np.random.Generator,
) -> ReferenceMotion:
    """One run of a family: from home to the run's own pose, the family's motion there, and back home.

    Args:
        family: Which.
        figures: Its figures.
        limits: Of the arm.
        joint: The joint that is asked about.
        home: Start and end of every run [rad].
        size: Share of the family's reach and spread, 1 for all of it.
        rng: Source of chance: the same state gives the same run.
    """
    own = home + size * figures["pose_spread"] * 0.8 * limits.span * rng.uniform(-1.0, 1.0, len(home))
    own = np.clip(own, limits.lower, limits.upper)
    there = _transfer(home, own, TRANSFER_SHARE * limits.speed)
    stage = Stage(limits, joint, own, size, max(RUN_S - 2.0 * len(there) * TICK_S - 2.0 * STILL_S, 4.0), rng)
    q = np.concatenate([there, family.build(stage, figures), there[::-1]])
    return sampled(family.name, q).held(STILL_S, STILL_S)


def _transfer(start: Float[Array, " n"], goal: Float[Array, " n"], speed: Float[Array, " n"]) -> Float[Array, "K n"]:
    """Straight move from rest to rest, its acceleration continuous."""
    duration = max(0.2, 1.9 * float(np.max(np.abs(goal - start) / speed)))
    s = ticks(duration)[:, None] / duration
    return start + (goal - start) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
