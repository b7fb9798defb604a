"""Motions that an experimenter would record, random but within limits and free of self-collision.

Kinds: `spline` (via points; both directions at several speeds), `fourier`, `sweep` (slow, with
nested reversals), `ladder` (constant speeds, both ways), `jointwise` (one joint after the other),
`chirp` (up to 10 Hz), `hold` (standstill approached from both sides).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import (
    TICK_S,
    ReferenceMotion,
    chirp,
    fourier,
    ramps,
    ticks,
    together,
    via_spline,
)

ATTEMPTS = 60
# Share of the joints' spans by which the middle of a random path strays, and paths that are tried
# for a spline.
STRAY = 0.15
PATHS = 12
# Share of the joints' spans that a path covers.
COVERED = 0.8
# Paces at which a spline is tried, as shares of the one asked for.
PACES = 1.12 ** -np.arange(40.0)
# Standstill before and after every motion [s].
REST_S = 0.25
# Shortest and longest run [s].
SHORTEST_S = 1.0
LONGEST_S = 3600.0
# Orders of a Fourier series.
ORDERS = 5
# Band of a chirp [Hz].
BAND_HZ = (0.2, 10.0)
# Turning points of a sweep, as shares of half the span.
TURNS = np.array([1.0, -1.0, 0.7, -0.6, 0.4, -0.25, 0.15, 0.0])
# Speeds of a ladder, as shares of what a joint may use.
RUNGS = np.geomspace(0.03, 0.55, 6)
# Side to which a joint goes, and how much faster than on the others, on each way of `jointwise`.
THERE_AND_BACK = ((1.0, 1.0), (-1.0, 2.0), (0.0, 1.0))
# Time at a pose of `hold` [s], and the shares of its four moves.
POSE_S = 4.0
SLOTS = np.array([0.3, 0.25, 0.2, 0.25])

Make = Callable[[Float[Array, " n"], float], ReferenceMotion]
"""A motion about a pose, by a share of its full size."""


def plan_motions(
    arm: ArmModel, kinds: Sequence[str], runs: int, duration: float, rng: np.random.Generator
) -> tuple[ReferenceMotion, ...]:
    """Plans the runs of a session: the kinds in turn.

    Splines come in groups of path, way back, and other speeds.

    Args:
        arm: The arm.
        kinds: Of the motions.
        runs: How many.
        duration: Of each, about [s].
        rng: What they are drawn by.

    Raises:
        InputError: Unknown kind, or a duration or number that makes no motion.
    """
    names = f"choose from: {', '.join(KINDS)}"
    if not kinds:
        raise InputError("--motion", "no motion asked for", names)
    for kind in kinds:
        if kind not in KINDS:
            raise InputError("--motion", f"unknown motion {kind!r}", names)
    if runs < 1:
        raise InputError("--runs", f"{runs} runs", "ask for one run or more")
    if not SHORTEST_S <= duration <= LONGEST_S:
        remedy = f"choose between {SHORTEST_S:g} and {LONGEST_S:g} s"
        raise InputError("--duration", f"{duration:g} s a run", remedy)
    limits = MotionLimits(arm)
    motions: list[ReferenceMotion] = []
    turns = cycle(kinds)
    while len(motions) < runs:
        motions += KINDS[next(turns)](limits, duration, rng)
    return tuple(motion.held(REST_S, REST_S) for motion in motions[:runs])


def random_path(
    limits: MotionLimits, vias: int, rng: np.random.Generator, span: float = COVERED
) -> Float[Array, "m n"]:
    """Start, via points and goal of a path that touches nothing [rad].

    Args:
        limits: Of the arm.
        vias: Number of via points.
        rng: What it is drawn by.
        span: Share of the joints' spans that it covers.
    """
    n = limits.arm.n
    for attempt in range(ATTEMPTS):
        share = 0.97**attempt
        away = rng.uniform(-1.0, 1.0, n)
        middle = limits.centre + share * STRAY * limits.span * away
        around = rng.uniform(-1.0, 1.0, (vias + 2, n))
        points = middle + share * span * limits.span * around
        path = via_spline("", points, 1.0)
        if limits.holds(path.q) and not limits.touches(path.q):
            return points
    what = f"no free path found in {ATTEMPTS} tries"
    raise RobotError(limits.arm.name, what, "check its joint limits and geometry")


def timed_spline(
    limits: MotionLimits, name: str, points: Float[Array, "m n"], duration: float
) -> ReferenceMotion:
    """A spline through points, slower than asked where the limits need it."""
    motion = via_spline(name, points, duration)
    pace = limits.first_pace(motion, PACES)
    if pace is None:
        what = "a path can't be followed within limits"
        raise RobotError(limits.arm.name, what, "check its effort and velocity limits")
    return motion if pace == 1.0 else via_spline(name, points, duration / pace)


def _spline(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    vias = int(np.clip(round(duration / 2.0), 2, 12))
    for attempt in range(PATHS):
        # Nearer to the centre where a weak arm can't hold itself up on the way, however slowly it
        # goes.
        points = random_path(limits, vias, rng, COVERED * 0.85**attempt)
        try:
            slow = timed_spline(limits, "spline", points, duration)
        except RobotError:
            if attempt == PATHS - 1:
                raise
        else:
            break
    fast = timed_spline(limits, "spline", points, max(0.6 * duration, 1.0))
    return [slow, slow.reversed("spline"), fast, fast.reversed("spline")]


def _shrink(limits: MotionLimits, rng: np.random.Generator, make: Make) -> list[ReferenceMotion]:
    """The largest of ever smaller motions about random poses that stays within limits."""
    for attempt in range(ATTEMPTS):
        share = 0.9**attempt
        aside = rng.uniform(-1.0, 1.0, limits.arm.n)
        motion = make(limits.centre + 0.4 * share * limits.span * aside, share)
        if limits.stays_within(motion):
            return [motion]
    what = f"no motion found in {ATTEMPTS} tries"
    raise RobotError(limits.arm.name, what, "check its limits and geometry")


def _fourier(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    base = max(0.1, 1.0 / duration)
    phases = rng.uniform(0.0, 2.0 * np.pi, (ORDERS, limits.arm.n))
    falling = np.arange(1, ORDERS + 1)[:, None]
    weight = rng.uniform(0.4, 1.0, (ORDERS, limits.arm.n)) / falling

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        swing = 0.8 * share * limits.span * weight / weight.sum(axis=0)
        sines = swing * np.sin(phases)
        cosines = swing * np.cos(phases)
        return fourier("fourier", centre, sines, cosines, base, duration)

    return _shrink(limits, rng, make)


def _chirp(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    phase = rng.uniform(0.0, 2.0 * np.pi, limits.arm.n)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        return chirp("chirp", centre, 0.35 * share * limits.span, BAND_HZ, phase, duration)

    return _shrink(limits, rng, make)


def _sweep(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    """Each joint goes to and fro between ever nearer turning points, at its own slow speed."""

    def path(middle: float, span: float, share: float) -> Float[Array, " K"]:
        turns = middle + share * 0.5 * span * TURNS
        travel = np.abs(np.diff(turns, prepend=middle)).sum()
        speed = travel / (0.8 * duration) * rng.uniform(0.9, 1.3)
        return ramps(middle, [(goal, speed) for goal in turns], 2.0, 0.1)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        spans = zip(centre, limits.span, strict=True)
        return together("sweep", [path(middle, span, share) for middle, span in spans])

    return _shrink(limits, rng, make)


def _ladder(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    """Every joint there and back at a ladder of speeds; which joint is fast when, differs."""

    def path(j: int, middle: float, share: float) -> Float[Array, " K"]:
        moves = []
        for speed in rng.permutation(RUNGS) * limits.speed[j]:
            # half of the time for each rung there, half back
            by_span = 0.8 * share * limits.span[j]
            by_speed = 0.5 * speed * duration / len(RUNGS)
            reach = min(by_span, by_speed)
            moves.append((middle + 0.5 * reach, speed))
            moves.append((middle - 0.5 * reach, speed))
        return ramps(middle, moves, 3.0 * share, 0.05)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        paths = [path(j, middle, share) for j, middle in enumerate(centre)]
        return together("ladder", paths)

    return _shrink(limits, rng, make)


def _jointwise(
    limits: MotionLimits, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    """One joint after the other there and back at two speeds, the others at rest."""
    time = duration / limits.arm.n

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        paths = []
        clock = 0.0
        for j, middle in enumerate(centre):
            by_span = 0.6 * share * limits.span[j]
            by_speed = 0.18 * time * limits.speed[j]
            side = min(by_span, by_speed)
            moves = []
            for way, factor in THERE_AND_BACK:
                moves.append((middle + side * way, 3.0 * side / time * factor))
            path = ramps(middle, moves, 5.0 * share, 0.05)
            wait = np.full(max(round(clock / TICK_S), 1), middle)
            paths.append(np.concatenate([wait, path]))
            clock += len(path) * TICK_S
        return together("jointwise", paths)

    return _shrink(limits, rng, make)


def _hold(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Poses approached from below and from above, with standstill at each arrival.

    Moves of four phases a pose, each phase on the clock of all joints; what time is left is
    standstill.
    """
    poses = max(int(duration / POSE_S), 1)
    slots = SLOTS * (duration / poses)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        aside = rng.uniform(-1.0, 1.0, (poses, limits.arm.n))
        stops = centre + share * 0.6 * limits.span * aside
        distances = np.minimum(0.15, 0.2 * limits.span)
        paths = []
        for start, goals, distance in zip(centre, stops.T, distances, strict=True):
            moves = []
            for goal in goals:
                moves += [
                    (goal - distance, 0.8),
                    (goal, 0.2),
                    (goal + distance, 0.4),
                    (goal, 0.2),
                ]
            paths.append(_on_the_clock(start, moves, slots, 6.0 * share))
        return together("hold", paths)

    return _shrink(limits, rng, make)


def _on_the_clock(
    start: float,
    moves: Sequence[tuple[float, float]],
    slots: Float[Array, " s"],
    acceleration: float,
) -> Float[Array, " K"]:
    """Moves of one joint, each within a slot of time; what is left of it is standstill.

    Args:
        start: First position [rad].
        moves: (goal [rad], least speed [rad/s]) of each move.
        slots: Time for each [s], again and again.
        acceleration: Of the corners [rad/s²].
    """
    pieces = []
    position = start
    for (goal, speed), slot in zip(moves, cycle(slots), strict=False):
        length = len(ticks(slot))
        # Arrive early enough to stand still for half of the slot.
        speed = max(speed, 2.5 * abs(goal - position) / slot)
        path = ramps(position, [(goal, speed)], acceleration, 0.01)[:length]
        rest = np.full(length - len(path), path[-1])
        pieces.append(np.concatenate([path, rest]))
        position = float(path[-1])
    return np.concatenate(pieces)


KINDS: dict[str, Callable[[MotionLimits, float, np.random.Generator], list[ReferenceMotion]]] = {
    "spline": _spline,
    "fourier": _fourier,
    "sweep": _sweep,
    "ladder": _ladder,
    "jointwise": _jointwise,
    "chirp": _chirp,
    "hold": _hold,
}
