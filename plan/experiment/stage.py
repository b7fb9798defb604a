"""Motions of one run: for each family of motions that an experimenter knows, what it does in some
pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.trajectories.kinds import timed_spline
from ident.trajectories.motion_limits import MotionLimits
from ident.trajectories.reference import TICK_S, chirp, fourier, ramps, ticks, via_spline, window

# Acceleration of corners between steady speeds [rad/s²], and standstill after each move [s].
CORNER = 3.0
DWELL = 0.05
# Harmonics of a Fourier series.
HARMONICS = 5
# Steady speeds of a ladder.
STEADY_SPEEDS = 5
# Time in which a Fourier series fades in, and out [s].
FADE_S = 1.5
# Random paths that are drawn until one touches nothing.
ATTEMPTS = 40


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
