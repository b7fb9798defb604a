"""Positions to q, dq, ddq by a Kalman (Rauch-Tung-Striebel) smoother on a white-jerk model.

Each joint is smoothed by itself (`ident.motion.kalman`). Only the ratio of the jerk's density s to
the position's variance r shapes the smoother; it is found by maximum likelihood of the innovations,
with r concentrated out. filterpy is the reference that the compiled path equals.

Source: Rauch, Tung and Striebel 1965; Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3
(white-jerk model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ident.arrays import Array, Float, freeze, read_only
from ident.motion.kalman import filter_joint, smooth_joint
from ident.motion.kalman_reference import smooth_by_filterpy
from ident.motion.settings import USUAL_MOTION, MotionSettings

# Prior standard deviations of the first velocity and acceleration: wide for any arm [rad/s,
# rad/s²].
FIRST_VELOCITY_STD = 3.0
FIRST_ACCELERATION_STD = 30.0
# A joint that moves less than this is at rest: its noise levels can't be determined and its
# derivatives are zero [rad].
LEAST_TRAVEL = 1e-6
# No encoder of an arm is better than this [rad]; keeps noise-free data from making the covariances
# singular.
LEAST_NOISE = 1e-9
# Usual size of the position's noise [rad].
USUAL_NOISE = 1e-4
# Sampling counts as regular when no interval is off by more than this share of the median.
REGULARITY = 1e-6
# Samples of a session that the likelihood is evaluated on: more changes nothing but the time.
LIKELIHOOD_SAMPLES = 20_000
# Of each run at least so many of them.
LEAST_SAMPLES = 50
# Width of the logarithm of the corner frequency within which its search stops.
WIDTH = 0.02


@dataclass(frozen=True, eq=False)
class NoiseLevels:
    """Noise of n joints."""

    jerk: Float[Array, " n"]  # process noise: spectral density s of the jerk [rad²/s⁵]
    position: Float[Array, " n"]  # variance r of a measured position [rad²]

    def __post_init__(self) -> None:
        object.__setattr__(self, "jerk", freeze(self.jerk))
        object.__setattr__(self, "position", freeze(self.position))

    def bandwidth(self, interval: float) -> Float[Array, " n"]:
        """Corner frequency (s / (r Δt))^(1/6) / 2π of the smoother at a sampling interval [Hz]."""
        return (self.jerk / (self.position * interval)) ** (1 / 6) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Smoothed motion of one run, shapes (T, n)."""

    q: Float[Array, "T n"]  # position, velocity, acceleration [rad, rad/s, rad/s²]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    # standard deviation of q, dq and ddq in the middle of the run, shape (3, n)
    std: Float[Array, "3 n"]


@dataclass(frozen=True, eq=False)
class _Sampling:
    """When a run was sampled."""

    intervals: Float[Array, " T-1"]  # all set to their mean where the sampling is regular [s]
    regular: bool

    @classmethod
    def of(cls, time: Float[Array, " T"]) -> _Sampling:
        intervals = np.diff(time)
        median = float(np.median(intervals))
        # Clock readings of 10³ s carry 10⁻¹³ s of rounding: that is not jitter.
        if np.max(np.abs(intervals - median)) > REGULARITY * median:
            return cls(intervals, regular=False)
        mean = (time[-1] - time[0]) / len(intervals)
        return cls(np.full(len(intervals), mean), regular=True)


def fit_noise_levels(
    times: Sequence[Float[Array, " T"]],
    positions: Sequence[Float[Array, "T n"]],
    settings: MotionSettings = USUAL_MOTION,
) -> NoiseLevels:
    """Maximum-likelihood noise levels, per joint, over several runs.

    The likelihood is profiled over r; what is searched is the corner frequency of the smoother. A
    joint at rest gets the noise of its readings and no jerk.

    Args:
        times: Sample times of each run [s].
        positions: Measured positions of each run [rad].
        settings: Between which corners it is searched.

    Returns:
        Levels s of the jerk and r of the position for each joint.
    """
    # The middle of each run, so that together they hold no more samples than change anything.
    share = min(1.0, LIKELIHOOD_SAMPLES / max(1, sum(map(len, times))))
    middles = [_middle(len(time), share) for time in times]
    samplings = []
    cuts = []
    for time, position, middle in zip(times, positions, middles, strict=True):
        samplings.append(_Sampling.of(np.asarray(time[middle])))
        cuts.append(np.asarray(position[middle]))
    n = positions[0].shape[1]
    jerk = np.zeros(n)
    variance = np.zeros(n)
    for j in range(n):
        columns = [read_only(cut[:, j]) for cut in cuts]
        if max(np.ptp(np.concatenate(columns)), 0.0) < LEAST_TRAVEL:
            noise = np.concatenate([column - column.mean() for column in columns])
            variance[j] = max(np.var(noise), LEAST_NOISE**2)
        else:
            jerk[j], variance[j] = _fit_joint(columns, samplings, settings)
    return NoiseLevels(jerk, variance)


def _middle(samples: int, share: float) -> slice:
    """The middle of a run, by a share of its samples."""
    length = max(min(samples, LEAST_SAMPLES), int(samples * share))
    start = (samples - length) // 2
    return slice(start, start + length)


@dataclass(frozen=True, eq=False)
class _Profile:
    """The likelihood of one joint's innovations, with the position's variance concentrated out."""

    columns: Sequence[Float[Array, " T"]]  # positions of each run [rad]
    samplings: Sequence[_Sampling]
    interval: float  # median of all intervals [s]

    def ratio(self, log_frequency: float) -> float:
        """s / r of a smoother with a corner frequency, of which the logarithm is given."""
        return float((2 * np.pi * np.exp(log_frequency)) ** 6 * self.interval)

    def evaluate(self, log_frequency: float) -> tuple[float, float]:
        """Minus twice the log likelihood, but for a constant, and r [rad²]."""
        longest = max(map(len, self.columns))
        states = np.empty((longest, 3))
        history = np.empty((longest, 7))
        sums = np.zeros(6)
        # With r = 1 the prior is in units of the position's noise, which is not known yet.
        first = (FIRST_VELOCITY_STD / USUAL_NOISE, FIRST_ACCELERATION_STD / USUAL_NOISE)
        ratio = self.ratio(log_frequency)
        for column, sampling in zip(self.columns, self.samplings, strict=True):
            noise = np.array([ratio, 1.0, *first, sampling.regular])
            filter_joint(column, sampling.intervals, noise, states, history, sums)
        count = sum(len(column) - 1 for column in self.columns)
        variance = max(float(sums[1]) / count, LEAST_NOISE**2)
        return count * np.log(variance) + float(sums[0]), variance


def _fit_joint(
    columns: Sequence[Float[Array, " T"]],
    samplings: Sequence[_Sampling],
    settings: MotionSettings,
) -> tuple[float, float]:
    """Density s of the jerk and variance r of a position of one joint."""
    intervals = np.concatenate([sampling.intervals for sampling in samplings])
    profile = _Profile(columns, samplings, float(np.median(intervals)))
    slowest = np.log(settings.slowest_corner_hz)
    fastest = np.log(settings.fastest_corner_share / profile.interval)
    optimum = minimize_scalar(
        lambda log_frequency: profile.evaluate(log_frequency)[0],
        bounds=(slowest, fastest),
        method="bounded",
        options={"xatol": WIDTH},
    )
    log_frequency = float(optimum.x)
    variance = profile.evaluate(log_frequency)[1]
    return profile.ratio(log_frequency) * variance, variance


def smooth(
    time: Float[Array, " T"],
    position: Float[Array, "T n"],
    levels: NoiseLevels,
    method: str = "fast",
) -> Smoothed:
    """Smooths one run.

    Args:
        time: Sample times [s], strictly increasing; any spacing.
        position: Measured positions [rad].
        levels: Noise of the joints, from `fit_noise_levels`.
        method: `fast`, or `filterpy`, the reference: the same numbers at some hundred times the
            time.

    Returns:
        States at the same times, and their standard deviations in the middle of the run.
    """
    sampling = _Sampling.of(np.asarray(time, dtype=float))
    dt = sampling.intervals
    samples, n = position.shape
    states = np.zeros((3, samples, n))
    std = np.zeros((3, n))
    # Pages of the history that a settled filter never reaches cost nothing.
    track = np.empty((samples, 3))
    history = np.empty((samples, 7))
    sums = np.zeros(6)
    for j in range(n):
        z = read_only(position[:, j])
        jerk = levels.jerk[j]
        variance = levels.position[j]
        if jerk == 0.0:
            states[0, :, j] = z.mean()
            std[0, j] = np.sqrt(variance / samples)
            continue
        first = (FIRST_VELOCITY_STD, FIRST_ACCELERATION_STD)
        noise = np.array([jerk, variance, *first, sampling.regular])
        if method == "fast":
            filter_joint(z, dt, noise, track, history, sums)
            smooth_joint(z, dt, noise, track, history, sums)
        else:
            smooth_by_filterpy(z, dt, noise, track, sums[3:])
        states[:, :, j] = track.T
        std[:, j] = np.sqrt(sums[3:])
    return Smoothed(freeze(states[0]), freeze(states[1]), freeze(states[2]), freeze(std))
