"""Motions that an experimenter would record, random but within limits and free of self-collision.

Kinds: `spline` (via points; both directions at several speeds), `fourier`, `sweep` (slow, with nested reversals),
`ladder` (constant speeds, both ways), `jointwise` (one joint after the other), `chirp` (up to 10 Hz), `hold`
(standstill approached from both sides).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import cycle

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.limits import MotionLimits
from ident.trajectories.reference import ReferenceMotion, chirp, fourier, ramps, ticks, together, via_spline

ATTEMPTS = 60
# Paths that are tried for a spline.
PATHS = 12
# Standstill before and after every motion [s].
REST_S = 0.25


def plan_motions(
    arm: ArmModel, kinds: Sequence[str], runs: int, duration: float, rng: np.random.Generator
) -> tuple[ReferenceMotion, ...]:
    """Plans the runs of a session: the kinds in turn; splines in groups of path, way back, and other speeds.

    Args:
        arm: The nominal arm.
        kinds: Names of `KINDS`.
        runs: Number of runs.
        duration: Rough duration of a run [s].
        rng: Source of chance.

    Raises:
        InputError: Unknown kind, or a duration or number that makes no motion.
    """
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown or not kinds:
        wrong = f"unknown motion {unknown[0]!r}" if unknown else "no motion asked for"
        raise InputError("--motion", wrong, f"choose from: {', '.join(KINDS)}")
    if runs < 1:
        raise InputError("--runs", f"{runs} runs", "ask for one run or more")
    if not 1.0 <= duration <= 3600.0:
        raise InputError("--duration", f"{duration:g} s a run", "choose between 1 and 3600 s")
    limits, motions, turns = MotionLimits(arm), list[ReferenceMotion](), cycle(kinds)
    while len(motions) < runs:
        motions += KINDS[next(turns)](limits, duration, rng)
    return tuple(motion.held(REST_S, REST_S) for motion in motions[:runs])


def random_path(
    limits: MotionLimits, vias: int, rng: np.random.Generator, span: float = 0.8, roam: float = 0.15
) -> Float[Array, "m n"]:
    """Start, via points and goal of a path that touches nothing [rad].

    It covers a share of the joints' spans, and its middle strays (`roam`) by another.
    """
    for attempt in range(ATTEMPTS):
        share = 0.97**attempt
        middle = limits.centre + share * roam * limits.span * rng.uniform(-1.0, 1.0, limits.arm.n)
        points = middle + share * span * limits.span * rng.uniform(-1.0, 1.0, (vias + 2, limits.arm.n))
        path = via_spline("", points, 1.0)
        inside = (path.q >= limits.lower).all() and (path.q <= limits.upper).all()
        if inside and not limits.touches(path.q):
            return points
    raise RobotError(limits.arm.name, f"no free path found in {ATTEMPTS} tries", "check its joint limits and geometry")


def timed_spline(limits: MotionLimits, name: str, points: Float[Array, "m n"], duration: float) -> ReferenceMotion:
    """A spline through points, slower than asked where the limits need it."""
    for _ in range(40):
        motion = via_spline(name, points, duration)
        if limits.excess(motion.q, motion.dq, motion.ddq) <= 1.0:
            return motion
        duration *= 1.12
    raise RobotError(limits.arm.name, "a path can't be followed within limits", "check its effort and velocity limits")


def _spline(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    vias = int(np.clip(round(duration / 2.0), 2, 12))
    for attempt in range(PATHS):
        # Nearer to the centre where a weak arm can't hold itself up on the way, however slowly it goes.
        points = random_path(limits, vias, rng, 0.8 * 0.85**attempt)
        try:
            slow = timed_spline(limits, "spline", points, duration)
        except RobotError:
            if attempt == PATHS - 1:
                raise
        else:
            break
    fast = timed_spline(limits, "spline", points, max(0.6 * duration, 1.0))
    return [slow, slow.reversed("spline"), fast, fast.reversed("spline")]


def _shrink(
    limits: MotionLimits, rng: np.random.Generator, make: Callable[[Float[Array, " n"], float], ReferenceMotion]
) -> ReferenceMotion:
    """The largest of ever smaller motions about random poses that stays within limits."""
    for attempt in range(ATTEMPTS):
        share = 0.9**attempt
        centre = limits.centre + 0.4 * share * limits.span * rng.uniform(-1.0, 1.0, limits.arm.n)
        motion = make(centre, share)
        if limits.stays_within(motion.q, motion.dq, motion.ddq):
            return motion
    raise RobotError(limits.arm.name, f"no motion found in {ATTEMPTS} tries", "check its limits and geometry")


def _fourier(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    base, orders, n = max(0.1, 1.0 / duration), 5, limits.arm.n
    phases = rng.uniform(0.0, 2.0 * np.pi, (orders, n))
    weight = rng.uniform(0.4, 1.0, (orders, n)) / np.arange(1, orders + 1)[:, None]

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        swing = 0.8 * share * limits.span * weight / weight.sum(axis=0)
        return fourier("fourier", centre, swing * np.sin(phases), swing * np.cos(phases), base, duration)

    return [_shrink(limits, rng, make)]


def _chirp(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    phase = rng.uniform(0.0, 2.0 * np.pi, limits.arm.n)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        return chirp("chirp", centre, 0.35 * share * limits.span, (0.2, 10.0), phase, duration)

    return [_shrink(limits, rng, make)]


def _sweep(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Each joint goes to and fro between ever nearer turning points, at its own slow speed."""
    shares = np.array([1.0, -1.0, 0.7, -0.6, 0.4, -0.25, 0.15, 0.0])

    def path(at: float, span: float, share: float) -> Float[Array, " K"]:
        turns = at + share * 0.5 * span * shares
        travel = np.abs(np.diff(turns, prepend=at)).sum()
        speed = travel / (0.8 * duration) * rng.uniform(0.9, 1.3)
        return ramps(at, [(goal, speed) for goal in turns], 2.0, 0.1)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        return together("sweep", [path(at, span, share) for at, span in zip(centre, limits.span, strict=True)])

    return [_shrink(limits, rng, make)]


def _ladder(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Every joint there and back at a ladder of speeds; which joint is fast when, differs."""
    rungs = np.geomspace(0.03, 0.55, 6)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        paths = []
        for j in range(limits.arm.n):
            speeds = rng.permutation(rungs) * limits.speed[j]
            moves = []
            for speed in speeds:  # half of the time for each rung there, half back
                reach = min(0.8 * share * limits.span[j], 0.5 * speed * duration / len(rungs))
                moves += [(centre[j] + 0.5 * reach, speed), (centre[j] - 0.5 * reach, speed)]
            paths.append(ramps(centre[j], moves, 3.0 * share, 0.05))
        return together("ladder", paths)

    return [_shrink(limits, rng, make)]


def _jointwise(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """One joint after the other there and back at two speeds, the others at rest."""
    there_and_back = ((1.0, 1.0), (-1.0, 2.0), (0.0, 1.0))

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        n = limits.arm.n
        each = duration / n
        paths, clock = [], 0.0
        for j in range(n):
            side = min(0.6 * share * limits.span[j], 0.18 * each * limits.speed[j])
            moves = [(centre[j] + side * way, 3.0 * side / each * fast) for way, fast in there_and_back]
            path = ramps(centre[j], moves, 5.0 * share, 0.05)
            wait = np.full(max(round(clock / 1e-3), 1), centre[j])
            paths.append(np.concatenate([wait, path]))
            clock += len(path) * 1e-3
        return together("jointwise", paths)

    return [_shrink(limits, rng, make)]


def _hold(limits: MotionLimits, duration: float, rng: np.random.Generator) -> list[ReferenceMotion]:
    """Poses approached from below and from above, with standstill at each arrival.

    Moves of four phases a pose, each phase on the clock of all joints; what time is left is standstill.
    """
    poses, n = max(int(duration / 4.0), 1), limits.arm.n
    slots = np.array([0.3, 0.25, 0.2, 0.25]) * (duration / poses)

    def make(centre: Float[Array, " n"], share: float) -> ReferenceMotion:
        stops = centre + share * 0.6 * limits.span * rng.uniform(-1.0, 1.0, (poses, n))
        aside = np.minimum(0.15, 0.2 * limits.span)
        paths = []
        for at, here, away in zip(centre, stops.T, aside, strict=True):
            moves = [m for p in here for m in ((p - away, 0.8), (p, 0.2), (p + away, 0.4), (p, 0.2))]
            pieces = []
            for (goal, speed), slot in zip(moves, cycle(slots)):
                length = len(ticks(slot))
                # Arrive early enough to stand still for half of the slot.
                path = ramps(at, [(goal, max(speed, 2.5 * abs(goal - at) / slot))], 6.0 * share, 0.01)[:length]
                pieces.append(np.concatenate([path, np.full(length - len(path), path[-1])]))
                at = float(path[-1])
            paths.append(np.concatenate(pieces))
        return together("hold", paths)

    return [_shrink(limits, rng, make)]


KINDS: dict[str, Callable[[MotionLimits, float, np.random.Generator], list[ReferenceMotion]]] = {
    "spline": _spline,
    "fourier": _fourier,
    "sweep": _sweep,
    "ladder": _ladder,
    "jointwise": _jointwise,
    "chirp": _chirp,
    "hold": _hold,
}
