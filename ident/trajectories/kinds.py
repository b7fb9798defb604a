"""Motions that an experimenter would record, random but within limits and free of self-collision.

Kinds: `spline` (via points; both directions at several speeds), `fourier`, `sweep` (slow, with nested reversals),
`ladder` (constant speeds, both ways), `jointwise` (one joint after the other), `chirp` (up to 10 Hz), `hold`
(standstill approached from both sides).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from itertools import combinations, cycle

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.reference import ReferenceMotion, chirp, fourier, ramps, ticks, together, via_spline

ATTEMPTS = 60
# Share of the joints' spans by which the middle of a random path strays; paths that are tried for a spline.
STRAY = 0.15
PATHS = 12
# Paces at which a spline is tried, as shares of the one asked for.
PACES = 1.12 ** -np.arange(40.0)
# Standstill before and after every motion [s].
REST_S = 0.25


def plan_motions(
    arm: ArmModel, kinds: Sequence[str], runs: int, duration: float, rng: np.random.Generator
) -> tuple[ReferenceMotion, ...]:
    """Plans the runs of a session: the kinds in turn; splines in groups of path, way back, and other speeds.

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


def random_path(limits: MotionLimits, vias: int, rng: np.random.Generator, span: float = 0.8) -> Float[Array, "m n"]:
    """Start, via points and goal of a path that touches nothing and covers a share of the joints' spans [rad]."""
    for attempt in range(ATTEMPTS):
        share = 0.97**attempt
        middle = limits.centre + share * STRAY * limits.span * rng.uniform(-1.0, 1.0, limits.arm.n)
        points = middle + share * span * limits.span * rng.uniform(-1.0, 1.0, (vias + 2, limits.arm.n))
        path = via_spline("", points, 1.0)
        inside = (path.q >= limits.lower).all() and (path.q <= limits.upper).all()
        if inside and not limits.touches(path.q):
            return points
    raise RobotError(limits.arm.name, f"no free path found in {ATTEMPTS} tries", "check its joint limits and geometry")


def timed_spline(limits: MotionLimits, name: str, points: Float[Array, "m n"], duration: float) -> ReferenceMotion:
    """A spline through points, slower than asked where the limits need it."""
    motion = via_spline(name, points, duration)
    pace = limits.first_pace(motion, PACES)
    if pace is None:
        what = "a path can't be followed within limits"
        raise RobotError(limits.arm.name, what, "check its effort and velocity limits")
    return motion if pace == 1.0 else via_spline(name, points, duration / pace)


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
        if limits.stays_within(motion):
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


# Shares of the limits that motions may use: friction, payloads and tracking errors need the rest.
SPEED_SHARE = 0.85
TORQUE_SHARE = 0.55
POSITION_MARGIN = 0.05
CLEARANCE_M = 0.01
# Largest move of a joint between two collision checks [rad].
CHECK_STEP = 0.04
# One of how many ticks is held against the torque limits.
STRIDE = 10


class MotionLimits:
    """Limits of one arm, for motion planning.

    Args:
        arm: The nominal model.
    """

    def __init__(self, arm: ArmModel) -> None:
        self.arm = arm
        limits = arm.known_limits
        bounded = limits.upper - limits.lower < 20.0
        self.lower = np.where(bounded, limits.lower + POSITION_MARGIN, -np.pi)
        self.upper = np.where(bounded, limits.upper - POSITION_MARGIN, np.pi)
        self.speed = SPEED_SHARE * np.where(limits.speed < 50.0, limits.speed, 3.0)
        self.torque = arm.rated_torque

    @cached_property
    def centre(self) -> Float[Array, " n"]:
        """Where motions centre: zero if that is well inside the limits, else the middle [rad]."""
        middle, half = 0.5 * (self.lower + self.upper), 0.5 * (self.upper - self.lower)
        return np.where(np.abs(middle) < 0.5 * half, 0.0, middle)

    @cached_property
    def span(self) -> Float[Array, " n"]:
        """How far motions go from the centre: the joints that carry much move much [rad]."""
        room = np.minimum(self.upper - self.centre, self.centre - self.lower)
        strong = self.torque > 0.5 * self.torque.max()
        return np.minimum(0.8 * room, np.where(strong, 1.5, 1.0))

    def stays_within(self, motion: ReferenceMotion) -> bool:
        """Whether a motion keeps all limits and touches nothing."""
        inside = (motion.q >= self.lower).all() and (motion.q <= self.upper).all()
        return bool(inside) and self.first_pace(motion) is not None and not self.touches(motion.q)

    def first_pace(self, motion: ReferenceMotion, paces: Sequence[float] | Float[Array, " k"] = (1.0,)) -> float | None:
        """The first of some paces at which a motion uses no more of the speed and torque limits than motions may.

        Torque beyond what holds the arm grows with the square of the pace, so one look at the motion tells of all.
        """
        q, dq, ddq = (part[::STRIDE] for part in (motion.q, motion.dq, motion.ddq))
        held = self.arm.gravity(q)
        moving = self.arm.inverse_dynamics(q, dq, ddq) - held
        # A guess of the rotor, as the controller's maker would have: it takes half of the torque in fast motion.
        rotor = (self.torque / 157.0) ** 1.55 * np.abs(ddq)
        fastest = (np.abs(motion.dq) / self.speed).max()
        for pace in map(float, paces):
            torque = np.abs(held + pace**2 * moving) + pace**2 * rotor
            if pace * fastest <= 1.0 and (torque <= TORQUE_SHARE * self.torque).all():
                return pace
        return None

    def touches(self, q: Float[Array, "K n"]) -> bool:
        """Whether the arm comes nearer than the clearance to itself anywhere on a path."""
        if self._geometry is None:
            return False
        model, data, geometry, geometry_data = self._geometry
        return any(
            pin.computeCollisions(model, data, geometry, geometry_data, state, True) for state in thin(q, CHECK_STEP)
        )

    @cached_property
    def _geometry(self) -> tuple[pin.Model, pin.Data, pin.GeometryModel, pin.GeometryData] | None:
        """Collision pairs of links that are not neighbours; none where the URDF's meshes are not there."""
        try:
            geometry = self.arm.geometry.copy()
        except RobotError:
            return None
        geometry.removeAllCollisionPairs()
        for (i, one), (k, other) in combinations(enumerate(geometry.geometryObjects), 2):
            if abs(one.parentJoint - other.parentJoint) > 1:
                geometry.addCollisionPair(pin.CollisionPair(i, k))
        model = self.arm.model
        data, geometry_data = model.createData(), geometry.createData()
        for request in geometry_data.collisionRequests:
            request.security_margin = CLEARANCE_M
        # Pairs that touch in nearly every pose are coarse boxes of links that share a housing.
        poses = self.centre + self.span * np.random.default_rng(0).uniform(-1.0, 1.0, (40, self.arm.n))
        hits = np.zeros(len(geometry.collisionPairs))
        for pose in poses:
            pin.computeCollisions(model, data, geometry, geometry_data, pose, False)
            hits += [result.isCollision() for result in geometry_data.collisionResults]
        for pair in np.flatnonzero(hits > 0.9 * len(poses)):
            geometry_data.deactivateCollisionPair(int(pair))
        return model, data, geometry, geometry_data


def thin(q: Float[Array, "K n"], step: float) -> Float[Array, "m n"]:
    """Poses of a path at most about a step apart."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q, axis=0)).max(axis=1))])
    marks = np.arange(0.0, travel[-1] + step, step)
    return q[np.minimum(np.searchsorted(travel, marks), len(q) - 1)]
