"""Sets of runs made to fit an arm, of families of motions that an experimenter knows, and random
ones.

Each family has a few figures, for one joint of an arm in some pose.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions, timed_spline
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import (
    TICK_S,
    ReferenceMotion,
    chirp,
    fourier,
    ramps,
    sampled,
    ticks,
    via_spline,
    window,
)
from plan.experiment.feasible import Feasibility

# Acceleration of corners between steady speeds [rad/s²], and standstill after each move [s].
CORNER = 3.0
DWELL = 0.05
HARMONICS = 5
# Steady speeds of a ladder.
STEADY_SPEEDS = 5
# Time in which a Fourier series fades in, and out [s].
FADE_S = 1.5
# Random paths that are drawn until one touches nothing.
ATTEMPTS = 40

SPREAD = "pose_spread"
"""The figure of all families that says how far a run's pose lies from home.

As a share of the usual span.
"""
Figures = dict[str, tuple[float, float]]
"""The ends of each figure's range, by its name."""

FAMILIES: dict[str, Figures] = tomllib.loads(
    Path(__file__).with_name("families.toml").read_text(encoding="utf-8")
)
"""Each family, as in `ident.effects.effect_info`, with ranges of the numbers that are searched."""
# Ends of the names of figures that are searched on a logarithmic scale.
LOGARITHMIC = ("_rad", "_rad_s", "_hz", "leg_s", "period_s", "speed_share")
# Rough duration of a run, and standstill at both of its ends [s].
RUN_S = 10.0
STILL_S = 0.3
# Mean speed of the moves from home to a run's own pose and back, as a share of the speed limits.
TRANSFER_SHARE = 0.3
# Shortest of these moves, and of a run's own part [s].
SHORTEST_TRANSFER = 0.2
SHORTEST_PART = 4.0
# Top speed of a move of continuous acceleration, over its mean: 15/8, and a little.
FASTEST_OF_MEAN = 1.9
# Sizes that are tried until a run fits.
SIZES = (1.0, 0.8, 0.6, 0.45, 0.3, 0.2, 0.1)
# Every so many runs all joints move, if they don't in all: that keeps the inertias known, and
# rivals elsewhere at bay. The diagnosis leaves out run by run, so that no joint may move in a
# single one.
WIDE_EVERY = 2
WIDE_FAMILIES = ("wide", "vias", "random", "fourier")
WIDE_FIGURES = {"base_hz": 0.12, "swing": 0.9, SPREAD: 0.0}
# What the textbook proposes where nothing is optimised: a Fourier series of eight seconds about the
# arm's middle.
TEXTBOOK = {"period_s": 8.0, "slope": 1.0, "swing": 1.0, "draw": 0.0, SPREAD: 0.0}
# Homes, and at most the poses of runs about them, lie within this share of the usual span.
HOME_SHARE = 0.8
# For arms whose limits leave little room: half of the span at the least, two seconds from point to
# point.
CAREFUL = {"swing": 0.5, "leg_s": 2.0, "draw": 0.0, SPREAD: 0.0}


def figure_at(name: str, bounds: tuple[float, float], share: float) -> float:
    """A family's figure at a share of its range.

    Args:
        name: The figure's; one that ends as `LOGARITHMIC` lists goes by ratios, others evenly.
        bounds: Its least and its largest value.
        share: 0 to 1; clipped to that.
    """
    share = float(np.clip(share, 0.0, 1.0))
    (low, high) = bounds
    if name.endswith(LOGARITHMIC):
        return float(low * (high / low) ** share)
    return float(low + share * (high - low))


@dataclass(frozen=True, eq=False)
class Stage:
    """Where a run takes place.

    A method for each family gives its positions at the controller's ticks, rest to rest.
    """

    limits: MotionLimits  # of the arm
    joint: int  # the joint that is asked about
    pose: Float[Array, " n"]  # the run's pose, in which the other joints stand [rad]
    size: float  # share of the family's reach that may be used: less where it would not fit
    duration: float  # time for the run's own part [s]
    rng: np.random.Generator  # source of chance

    @property
    def room(self) -> Float[Array, " n"]:
        """How far each joint may go to either side of the pose [rad]."""
        free = np.minimum(self.limits.upper - self.pose, self.pose - self.limits.lower)
        return np.minimum(free, self.limits.span)

    @property
    def reach(self) -> float:
        """How far the joint in question goes to either side of the pose in this run [rad].

        It is what the limits leave there (`room`) times the run's size; 0 where they leave nothing.
        """
        return self.size * max(float(self.room[self.joint]), 0.0)

    @property
    def middle(self) -> float:
        """Where that joint stands in the pose [rad]."""
        return float(self.pose[self.joint])

    def _alone(self, moves: list[tuple[float, float]], dwell: float = DWELL) -> Float[Array, "K n"]:
        """The joint by moves (goal [rad], steady speed [rad/s]), with standstill after each [s].

        The others stand.
        """
        path = ramps(self.middle, moves, CORNER, dwell)
        q = np.repeat(self.pose[None], len(path), axis=0)
        q[:, self.joint] = path
        return q

    def _there_and_back(self, speeds: Float[Array, " k"]) -> Float[Array, "K n"]:
        """At steady speeds, among which the time is dealt out evenly.

        Back to the middle after each.

        A slow one must not begin with a fast one's long way.
        """
        middle = self.middle
        moves = []
        for speed in speeds:
            half = min(self.reach, 0.25 * speed * self.duration / len(speeds))
            moves += [(middle + half, speed), (middle - half, speed), (middle, speed)]
        return self._alone(moves)

    def ladder(self, slowest_rad_s: float, fastest_share: float) -> Float[Array, "K n"]:
        """There and back at five steady speeds, in an order of chance.

        Args:
            slowest_rad_s: The lowest speed.
            fastest_share: The highest, as a share of the joint's limit; the others lie between at
                equal ratios.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        top = fastest_share * float(self.limits.speed[self.joint])
        speeds = np.geomspace(min(slowest_rad_s, top), top, STEADY_SPEEDS)
        return self._there_and_back(self.rng.permutation(speeds))

    def slow(self, slowest_rad_s: float, ratio: float) -> Float[Array, "K n"]:
        """There and back at a slow steady speed, and at `ratio` times that.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        return self._there_and_back(slowest_rad_s * np.array([1.0, ratio]))

    def poses(self, speed_share: float, reach: float) -> Float[Array, "K n"]:
        """One path, both ways, at one speed, as often as the time allows.

        The pose of the others is what differs.

        Args:
            speed_share: The speed as a share of the joint's limit.
            reach: Half the path's length as a share of what the joint has room for, `self.reach`.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        speed = speed_share * float(self.limits.speed[self.joint])
        half = self.reach * reach
        count = max(1, int(self.duration * speed / max(4.0 * half, 1e-6)))
        moves = [(self.middle + half, speed), (self.middle - half, speed)] * count
        return self._alone([*moves, (self.middle, speed)])

    def reversals(
        self, first_rad: float, last_rad: float, ratio: float, speed_rad_s: float
    ) -> Float[Array, "K n"]:
        """Nested reversals.

        To and fro between turning points that draw together by a ratio, then anew.

        Args:
            first_rad: Half the first swing; less where room or time asks for it.
            last_rad: Where half the swing is smaller than that, it begins anew.
            ratio: Of one half swing to the one before.
            speed_rad_s: Speed between the turning points.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        speed = speed_rad_s
        middle = self.middle
        first = min(first_rad, self.reach, 0.25 * speed * self.duration)
        moves = []
        left = self.duration
        position = middle
        side = 1.0
        half = first
        while left > 0.0:
            goal = middle + side * half
            moves.append((goal, speed))
            left -= abs(goal - position) / speed + speed / CORNER + DWELL
            position = goal
            side = -side
            half = half * ratio
            if half < last_rad:
                half = first
        return self._alone([*moves, (middle, speed)])

    def chirp(
        self, lowest_hz: float, highest_hz: float, swing_rad: float, neighbours: float
    ) -> Float[Array, "K n"]:
        """The joint, and to a share its neighbours, swept in frequency about the pose.

        Args:
            lowest_hz: Where the sweep begins.
            highest_hz: Where it ends.
            swing_rad: The joint's amplitude, before the run's size.
            neighbours: Amplitude of the joints beside it, as a share of that.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        n = len(self.pose)
        j = self.joint
        swing = np.zeros(n)
        swing[max(j - 1, 0) : j + 2] = neighbours * (self.size * swing_rad)
        swing[j] = self.size * swing_rad
        phase = self.rng.uniform(0.0, 2.0 * np.pi, n)
        return chirp("", self.pose, swing, (lowest_hz, highest_hz), phase, self.duration).q

    def holds(self, dwell_s: float, speed_rad_s: float) -> Float[Array, "K n"]:
        """Stops on the way there and back, each approached from both sides, with standstill after
        each approach.

        Args:
            dwell_s: Standstill after each approach.
            speed_rad_s: Speed of the approaches; the way to them is three times as fast.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        middle = self.middle
        speed = speed_rad_s
        aside = min(0.12, 0.3 * self.reach)
        each = 2.0 * (dwell_s + 1.0) + 4.0 * aside / speed
        stops = max(1, round(self.duration / (each + 1.0)))
        moves = []
        for stop in middle + 0.8 * self.reach * self.rng.uniform(-1.0, 1.0, stops):
            moves += [
                (stop - aside, 3.0 * speed),
                (stop, speed),
                (stop + aside, speed),
                (stop, speed),
            ]
        return self._alone([*moves, (middle, 3.0 * speed)], dwell_s)

    def wide(self, base_hz: float, swing: float) -> Float[Array, "K n"]:
        """All joints by a Fourier series about the pose.

        Args:
            base_hz: Frequency of its first order.
            swing: Its farthest as a share of each joint's room, before the run's size.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        order = np.arange(1, HARMONICS + 1)[:, None]
        weight = self.rng.uniform(0.4, 1.0, (HARMONICS, len(self.pose))) / order
        phase = self.rng.uniform(0.0, 2.0 * np.pi, weight.shape)
        far = self.size * swing * self.room * weight / weight.sum(axis=0)
        sines = far * np.sin(phase)
        cosines = far * np.cos(phase)
        return fourier("", self.pose, sines, cosines, base_hz, self.duration).q

    def fourier(
        self, period_s: float, slope: float, swing: float, draw: float
    ) -> Float[Array, "K n"]:
        """All joints by a Fourier series about the pose, each as far as its room and its speed let
        it go.

        The harmonics are weighed by their number to the power of minus the slope. Which phases is a
        figure, too.

        Source: Swevers et al., Optimal robot excitation and identification, IEEE Trans. Rob. Autom.
        13 (1997) 730.
        """
        rng = np.random.default_rng([int(draw), int(self.rng.integers(2**31))])
        order = np.arange(1, HARMONICS + 1)
        weight = rng.uniform(0.4, 1.0, (HARMONICS, len(self.pose))) * order[:, None] ** -slope
        phase = rng.uniform(0.0, 2.0 * np.pi, weight.shape)
        t = ticks(self.duration)
        angle = 2.0 * np.pi / period_s * np.outer(t, order)
        wave = np.sin(angle) @ (weight * np.sin(phase)) + np.cos(angle) @ (weight * np.cos(phase))
        wave *= window(t, self.duration, min(FADE_S, 0.5 * self.duration))[:, None]
        far = self.room / np.abs(wave).max(axis=0)
        fast = self.limits.speed / np.abs(np.gradient(wave, TICK_S, axis=0)).max(axis=0)
        return np.asarray(self.pose + self.size * swing * np.minimum(far, fast) * wave)

    def vias(self, swing: float, leg_s: float, draw: float) -> Float[Array, "K n"]:
        """All joints by a clamped spline through via points of chance, at equal times.

        Which points is a figure too.

        Args:
            swing: Farthest way from the pose as a share of each joint's room, before the run's
                size.
            leg_s: Time from point to point, about.
            draw: A whole number; another one gives other points.

        Returns:
            Joint positions [rad], one row a tick of the reference.
        """
        rng = np.random.default_rng([int(draw), int(self.rng.integers(2**31))])
        count = max(2, round(self.duration / leg_s) - 1)
        away = self.size * swing * self.room * rng.uniform(-1.0, 1.0, (count, len(self.pose)))
        points = np.clip(self.pose + away, self.limits.lower, self.limits.upper)
        path = np.concatenate([self.pose[None], points, self.pose[None]])
        return via_spline("", path, self.duration).q

    def random(
        self, swing: float, leg_s: float, fast_share: float, draw: float
    ) -> Float[Array, "K n"]:
        """All joints through random points anywhere and the same way back, slower where the limits
        need it.

        The simulator's usual motion, with which every proposal is compared; here it is a start like
        any other.
        """
        limits = self.limits
        rng = np.random.default_rng([int(draw), int(self.rng.integers(2**31))])
        half = 0.5 * self.duration * (1.0 if rng.uniform() < 0.5 else fast_share)
        count = max(2, round(0.5 * self.duration / leg_s))
        for attempt in range(ATTEMPTS):
            reach = 0.97**attempt * self.size * swing * limits.span
            points = limits.centre + reach * rng.uniform(-1.0, 1.0, (count, len(self.pose)))
            points = np.concatenate([self.pose[None], points])
            path = via_spline("", points, 1.0)
            inside = (path.q >= limits.lower).all() and (path.q <= limits.upper).all()
            if inside and not limits.touches(path.q):
                break
        # In one second the path has the speeds that it has in any other time, times that.
        needed = float((np.abs(path.dq) / limits.speed).max())
        there = timed_spline(limits, "", points, max(half, needed))
        return np.concatenate([there.q, there.q[::-1]])


@dataclass(frozen=True, eq=False)
class RunSet:
    """Runs of one family.

    Each starts and ends at home, so that they can be run one after the other.

    The other joints stand in a pose of each run's own, which changes what the joint in question
    carries.
    """

    family: str  # name of the family
    figures: Mapping[str, float]  # its figures
    home: Float[Array, " n"]  # start and end of every run [rad]
    joint: int  # the joint that moves most
    seed: int  # of poses, phases and orders

    @classmethod
    def decode(
        cls, family: str, shares: Float[Array, " d"], joint: int, limits: MotionLimits, seed: int
    ) -> RunSet:
        """A set of runs from shares in [0, 1]; what lies outside is clipped.

        Args:
            family: A name of `FAMILIES`.
            shares: One for each joint of the home pose, then one a figure in the family's order; as
                many as `freedom` says.
            joint: Number of the joint in question.
            limits: What the arm's motion may be.
            seed: Of what the runs leave to chance.
        """
        n = limits.arm.n
        away = 2.0 * np.clip(shares[:n], 0.0, 1.0) - 1.0
        home = limits.centre + HOME_SHARE * limits.span * away
        figures = {}
        for (name, (low, high)), share in zip(FAMILIES[family].items(), shares[n:], strict=True):
            figures[name] = figure_at(name, (low, high), share)
        return cls(family, figures, home, joint, seed)

    @staticmethod
    def freedom(family: str, n: int) -> int:
        """Number of shares that make a set of a family for an arm of n joints."""
        return n + len(FAMILIES[family])

    def run(self, number: int, feasible: Feasibility) -> ReferenceMotion | None:
        """Run of a number, from 0, at the largest size that fits; None if it fits at none."""
        for size in SIZES:
            try:
                motion = self._sized(number, size, feasible.limits)
            except RobotError:  # these points can't be followed however slowly
                continue
            if feasible.allows(motion):
                return motion
        return None

    def _sized(self, number: int, size: float, limits: MotionLimits) -> ReferenceMotion:
        """From home to the run's own pose, the family's motion there, and back home.

        Args:
            number: Of the run.
            size: Share of the family's reach and spread, 1 for all of it.
            limits: Of the arm.
        """
        wide = self.family not in WIDE_FAMILIES and number % WIDE_EVERY == WIDE_EVERY - 1
        family = "wide" if wide else self.family
        figures = dict(WIDE_FIGURES if wide else self.figures)
        rng = np.random.default_rng([self.seed, number])
        home = self.home
        spread = size * figures.pop(SPREAD) * HOME_SHARE * limits.span
        away = spread * rng.uniform(-1.0, 1.0, len(home))
        pose = np.clip(home + away, limits.lower, limits.upper)
        steady = np.max(np.abs(pose - home) / (TRANSFER_SHARE * limits.speed))
        duration = max(SHORTEST_TRANSFER, FASTEST_OF_MEAN * float(steady))
        s = ticks(duration)[:, None] / duration
        # Its acceleration is continuous.
        there = home + (pose - home) * s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
        left = max(RUN_S - 2.0 * len(there) * TICK_S - 2.0 * STILL_S, SHORTEST_PART)
        stage = Stage(limits, self.joint, pose, size, left, rng)
        path = getattr(stage, family)(**figures)
        whole = np.concatenate([there, path, there[::-1]])
        return sampled(family, whole).held(STILL_S, STILL_S)

    def runs(self, count: int, feasible: Feasibility) -> list[ReferenceMotion]:
        """The first runs; none at all if one of them can't be made to fit."""
        runs: list[ReferenceMotion] = []
        for number in range(count):
            motion = self.run(number, feasible)
            if motion is None:
                return []
            runs.append(motion)
        return runs


def duration_of(runs: Sequence[ReferenceMotion]) -> float:
    """Length of all runs together [s]."""
    return float(sum(run.duration for run in runs))


def random_runs(
    arm: ArmModel, count: int, duration: float, rng: np.random.Generator
) -> list[ReferenceMotion]:
    """Runs through random via points, there and back at several speeds.

    Careful ones where these don't fit the arm.

    Args:
        arm: The arm.
        count: Number of runs.
        duration: Rough duration of a run [s].
        rng: Source of chance.

    Raises:
        RobotError: None fit at all.
    """
    try:
        return list(plan_motions(arm, ("spline",), count, duration, rng))
    except RobotError:
        feasible = Feasibility(arm, "capsules")  # to compare with, never to be run
        centre = np.array(feasible.limits.centre)
        careful = RunSet("vias", CAREFUL, centre, 0, int(rng.integers(2**31)))
        runs = careful.runs(count, feasible)
        if not runs:
            raise
        return runs
