"""Positions to q, dq, ddq by a Kalman (Rauch-Tung-Striebel) smoother on a white-jerk model.

State x = (q, dq, ddq) of each joint by itself. Between samples Δt apart

    x⁺ = F x + w,  F = [[1, Δt, Δt²/2], [0, 1, Δt], [0, 0, 1]],
    cov w = s [[Δt⁵/20, Δt⁴/8, Δt³/6], [Δt⁴/8, Δt³/3, Δt²/2], [Δt³/6, Δt²/2, Δt]],

and z = q + v with var v = r. Only the ratio s/r shapes the smoother; it is found by maximum likelihood of the
innovations, with r concentrated out. The compiled path computes the covariances only until they settle where the
sampling is regular, and sample by sample where it is not; filterpy is the reference that it equals.

Source: Rauch, Tung and Striebel 1965; Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3 (white-jerk model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from scipy.optimize import minimize_scalar

from ident.arrays import Array, Float, freeze

# Prior standard deviations of the first velocity and acceleration: wide for any arm [rad/s, rad/s²].
FIRST_VELOCITY_STD, FIRST_ACCELERATION_STD = 3.0, 30.0
# A joint that moves less than this is at rest: its noise levels can't be told and its derivatives are zero [rad].
LEAST_TRAVEL = 1e-6
# No encoder of an arm is better than this [rad]; keeps noise-free data from making the covariances singular.
LEAST_NOISE = 1e-9
# Sampling counts as regular when no interval is off by more than this share of the median.
REGULARITY = 1e-6
# Covariances have settled when a step changes them by less than this share. Rounding keeps some from ever coming
# closer than 1e-15; what is left after 1e-13 moves no state by 1e-9.
SETTLED = 1e-13
# Samples of a session that the likelihood is evaluated on: more changes nothing but the time.
LIKELIHOOD_SAMPLES = 20_000


@dataclass(frozen=True, eq=False)
class NoiseLevels:
    """Noise of n joints.

    Attributes:
        jerk: Spectral density s of the jerk [rad²/s⁵].
        position: Variance r of a measured position [rad²].
    """

    jerk: Float[Array, " n"]
    position: Float[Array, " n"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "jerk", freeze(self.jerk))
        object.__setattr__(self, "position", freeze(self.position))

    def bandwidth(self, interval: float) -> Float[Array, " n"]:
        """Corner frequency (s / (r Δt))^(1/6) / 2π of the smoother at a sampling interval [Hz]."""
        return (self.jerk / (self.position * interval)) ** (1 / 6) / (2 * np.pi)


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Smoothed motion of one run, shapes (T, n).

    Attributes:
        q, dq, ddq: Position, velocity, acceleration [rad, rad/s, rad/s²].
        std: Standard deviation of q, dq and ddq in the middle of the run, shape (3, n).
    """

    q: Float[Array, "T n"]
    dq: Float[Array, "T n"]
    ddq: Float[Array, "T n"]
    std: Float[Array, "3 n"]


@njit(cache=True)
def _predict_covariance(p: Array, dt: float, s: float, out: Array) -> None:
    """out = F p Fᵀ + Q for a symmetric 3×3 matrix."""
    h = 0.5 * dt * dt
    fp = np.empty((3, 3))
    for j in range(3):
        fp[0, j] = p[0, j] + dt * p[1, j] + h * p[2, j]
        fp[1, j] = p[1, j] + dt * p[2, j]
        fp[2, j] = p[2, j]
    for i in range(3):
        out[i, 0] = fp[i, 0] + dt * fp[i, 1] + h * fp[i, 2]
        out[i, 1] = fp[i, 1] + dt * fp[i, 2]
        out[i, 2] = fp[i, 2]
    out[0, 0] += s * dt**5 / 20
    out[0, 1] += s * dt**4 / 8
    out[1, 0] += s * dt**4 / 8
    out[0, 2] += s * dt**3 / 6
    out[2, 0] += s * dt**3 / 6
    out[1, 1] += s * dt**3 / 3
    out[1, 2] += s * dt**2 / 2
    out[2, 1] += s * dt**2 / 2
    out[2, 2] += s * dt


@njit(cache=True)
def _update_covariance(predicted: Array, r: float, gain: Array, out: Array) -> float:
    """Joseph form of the measurement update; returns the innovation's variance."""
    variance = predicted[0, 0] + r
    for i in range(3):
        gain[i] = predicted[i, 0] / variance
    left = np.eye(3)
    for i in range(3):
        left[i, 0] -= gain[i]
    for i in range(3):
        for j in range(3):
            total = r * gain[i] * gain[j]
            for k in range(3):
                for m in range(3):
                    total += left[i, k] * predicted[k, m] * left[j, m]
            out[i, j] = total
    return variance


@njit(cache=True)
def _settled(new: Array, old: Array) -> bool:
    for i in range(3):
        for j in range(3):
            if abs(new[i, j] - old[i, j]) > SETTLED * np.sqrt(new[i, i] * new[j, j]):
                return False
    return True


@njit(cache=True)
def _first_covariance(r: float, velocity_std: float, acceleration_std: float) -> Array:
    return np.diag(np.array([r, velocity_std**2, acceleration_std**2]))


@njit(cache=True)
def _log_likelihood(z: Array, dt: Array, regular: bool, s: float, first: Array) -> tuple[float, float]:
    """Sums of log innovation variance and of normalised squared innovations, for r = 1."""
    p, pp, gain, old = first.copy(), np.empty((3, 3)), np.empty(3), np.zeros((3, 3))
    x0, x1, x2 = z[0], 0.0, 0.0
    variance, settled, log_sum, square_sum = 1.0, False, 0.0, 0.0
    for k in range(1, len(z)):
        h = dt[k - 1]
        if not settled:
            _predict_covariance(p, h, s, pp)
            old[:] = p
            variance = _update_covariance(pp, 1.0, gain, p)
            settled = regular and _settled(p, old)
        x0 += h * x1 + 0.5 * h * h * x2
        x1 += h * x2
        innovation = z[k] - x0
        log_sum += np.log(variance)
        square_sum += innovation * innovation / variance
        x0 += gain[0] * innovation
        x1 += gain[1] * innovation
        x2 += gain[2] * innovation
    return log_sum, square_sum


@njit(cache=True)
def _smoother_gain(p: Array, dt: float, s: float, predicted: Array, out: Array) -> None:
    """out = p Fᵀ (F p Fᵀ + Q)⁻¹."""
    _predict_covariance(p, dt, s, predicted)
    h = 0.5 * dt * dt
    right = np.empty((3, 3))
    for i in range(3):
        right[i, 0] = p[i, 0] + dt * p[i, 1] + h * p[i, 2]
        right[i, 1] = p[i, 1] + dt * p[i, 2]
        right[i, 2] = p[i, 2]
    out[:] = np.linalg.solve(predicted.T, right.T).T


@njit(cache=True, nogil=True)
def _smooth(z: Array, dt: Array, regular: bool, s: float, r: float, first: Array) -> tuple[Array, Array]:
    """States of one joint, shape (T, 3), and the smoothed covariance in the middle of the run."""
    samples = len(z)
    states = np.empty((samples, 3))
    history = np.empty((samples if not regular else min(samples, 4096), 3, 3))
    gain, pp = np.empty(3), np.empty((3, 3))
    kept, settled = 1, False
    history[0] = first
    states[0, 0], states[0, 1], states[0, 2] = z[0], 0.0, 0.0
    for k in range(1, samples):
        h = dt[k - 1]
        if not settled:
            if kept == len(history):
                history = np.concatenate((history, np.empty_like(history)))
            _predict_covariance(history[k - 1], h, s, pp)
            _update_covariance(pp, r, gain, history[k])
            kept = k + 1
            settled = regular and _settled(history[k], history[k - 1])
        x0 = states[k - 1, 0] + h * states[k - 1, 1] + 0.5 * h * h * states[k - 1, 2]
        x1 = states[k - 1, 1] + h * states[k - 1, 2]
        innovation = z[k] - x0
        states[k, 0] = x0 + gain[0] * innovation
        states[k, 1] = x1 + gain[1] * innovation
        states[k, 2] = states[k - 1, 2] + gain[2] * innovation
    c, smoothed = np.zeros((3, 3)), history[kept - 1].copy()
    middle = smoothed.copy()
    settled = False
    for k in range(samples - 2, -1, -1):
        h = dt[k]
        if not (settled and k >= kept - 1):
            _smoother_gain(history[min(k, kept - 1)], h, s, pp, c)
            new = history[min(k, kept - 1)] + c @ (smoothed - pp) @ c.T
            settled = regular and _settled(new, smoothed)
            smoothed = new
        if k == samples // 2:
            middle = smoothed.copy()
        e0 = states[k + 1, 0] - (states[k, 0] + h * states[k, 1] + 0.5 * h * h * states[k, 2])
        e1 = states[k + 1, 1] - (states[k, 1] + h * states[k, 2])
        e2 = states[k + 1, 2] - states[k, 2]
        for i in range(3):
            states[k, i] += c[i, 0] * e0 + c[i, 1] * e1 + c[i, 2] * e2
    return states, middle


def _intervals(time: Float[Array, " T"]) -> tuple[Float[Array, " T-1"], bool]:
    """Sampling intervals [s], all set to the median where the sampling is regular."""
    dt = np.diff(time)
    median = float(np.median(dt))
    # Clock readings of 10³ s carry 10⁻¹³ s of rounding: that is not jitter.
    if np.max(np.abs(dt - median)) <= REGULARITY * median:
        return np.full(len(dt), (time[-1] - time[0]) / len(dt)), True
    return dt, False


def _evenly(runs: Sequence[Array], most: int) -> list[slice]:
    """The middle part of each run, so that together they hold at most `most` samples."""
    share = min(1.0, most / max(1, sum(len(run) for run in runs)))
    slices = []
    for run in runs:
        kept = max(min(len(run), 50), int(len(run) * share))
        start = (len(run) - kept) // 2
        slices.append(slice(start, start + kept))
    return slices


def fit_noise_levels(times: Sequence[Float[Array, " T"]], positions: Sequence[Float[Array, "T n"]]) -> NoiseLevels:
    """Maximum-likelihood noise levels, per joint, over several runs.

    The likelihood is profiled over r; what is searched is the corner frequency of the smoother, between 0.2 Hz and
    0.45 of the sampling rate. A joint at rest gets the noise of its readings and no jerk.

    Args:
        times: Sample times of each run [s].
        positions: Measured positions of each run [rad].
    """
    cuts = _evenly(times, LIKELIHOOD_SAMPLES)
    parts = [(np.asarray(t[cut]), np.asarray(z[cut])) for t, z, cut in zip(times, positions, cuts, strict=True)]
    steps = [_intervals(t) for t, _ in parts]
    interval = float(np.median(np.concatenate([dt for dt, _ in steps])))
    n = positions[0].shape[1]
    jerk, position = np.zeros(n), np.zeros(n)
    for j in range(n):
        columns = [np.ascontiguousarray(z[:, j]) for _, z in parts]
        if max(np.ptp(np.concatenate(columns)), 0.0) < LEAST_TRAVEL:
            position[j] = max(np.var(np.concatenate([z - z.mean() for z in columns])), LEAST_NOISE**2)
            continue
        jerk[j], position[j] = _fit_one_joint(columns, steps, interval)
    return NoiseLevels(jerk, position)


def _fit_one_joint(
    columns: list[Float[Array, " T"]], steps: list[tuple[Float[Array, " T"], bool]], interval: float
) -> tuple[float, float]:
    count = sum(len(z) - 1 for z in columns)

    def ratio(log_frequency: float) -> float:
        return float((2 * np.pi * np.exp(log_frequency)) ** 6 * interval)

    def profile(log_frequency: float) -> tuple[float, float]:
        s, log_sum, square_sum = ratio(log_frequency), 0.0, 0.0
        for z, (dt, regular) in zip(columns, steps, strict=True):
            # With r = 1 the prior is in units of the (unknown) position noise; 1e-4 rad is its usual size.
            first = _first_covariance(1.0, FIRST_VELOCITY_STD / 1e-4, FIRST_ACCELERATION_STD / 1e-4)
            logs, squares = _log_likelihood(z, dt, regular, s, first)
            log_sum, square_sum = log_sum + logs, square_sum + squares
        noise = max(square_sum / count, LEAST_NOISE**2)
        return count * np.log(noise) + log_sum, noise

    bounds = (np.log(0.2), np.log(0.45 / interval))
    best = minimize_scalar(lambda f: profile(f)[0], bounds=bounds, method="bounded", options={"xatol": 0.02})
    noise = profile(best.x)[1]
    return ratio(best.x) * noise, noise


def smooth(
    time: Float[Array, " T"],
    position: Float[Array, "T n"],
    levels: NoiseLevels,
    method: Literal["fast", "filterpy"] = "fast",
) -> Smoothed:
    """Smooths one run.

    Args:
        time: Sample times [s], strictly increasing; any spacing.
        position: Measured positions [rad].
        levels: Noise of the joints, from `fit_noise_levels`.
        method: `fast`, or `filterpy`, the reference: the same numbers at some hundred times the time.
    """
    time = np.asarray(time, dtype=float)
    dt, regular = _intervals(time)
    samples, n = position.shape
    states, std = np.zeros((3, samples, n)), np.zeros((3, n))
    run = _smooth if method == "fast" else _smooth_filterpy
    for j in range(n):
        z = np.ascontiguousarray(position[:, j], dtype=float)
        if levels.jerk[j] == 0.0:
            states[0, :, j] = z.mean()
            std[0, j] = np.sqrt(levels.position[j] / samples)
            continue
        r = float(levels.position[j])
        first = _first_covariance(r, FIRST_VELOCITY_STD, FIRST_ACCELERATION_STD)
        track, covariance = run(z, dt, regular, float(levels.jerk[j]), r, first)
        states[:, :, j] = track.T
        std[:, j] = np.sqrt(np.diag(covariance))
    return Smoothed(freeze(states[0]), freeze(states[1]), freeze(states[2]), freeze(std))


def _transition(dt: float, s: float) -> tuple[Float[Array, "3 3"], Float[Array, "3 3"]]:
    step = np.array([[1, dt, dt**2 / 2], [0, 1, dt], [0, 0, 1]])
    noise = s * np.array(
        [[dt**5 / 20, dt**4 / 8, dt**3 / 6], [dt**4 / 8, dt**3 / 3, dt**2 / 2], [dt**3 / 6, dt**2 / 2, dt]]
    )
    return step, noise


def _smooth_filterpy(z: Array, dt: Array, regular: bool, s: float, r: float, first: Array) -> tuple[Array, Array]:
    """The same as `_smooth` through filterpy's general Kalman filter and smoother."""
    from filterpy.kalman import KalmanFilter  # slow to load, and only the reference needs it

    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.H, kalman.R = np.array([[1.0, 0.0, 0.0]]), np.array([[r]])
    kalman.x, kalman.P = np.array([[z[0]], [0.0], [0.0]]), first.copy()
    pairs = [_transition(float(h), s) for h in dt]
    steps, noises = [pair[0] for pair in pairs], [pair[1] for pair in pairs]
    means, covariances, _, _ = kalman.batch_filter(z[1:], Fs=steps, Qs=noises)
    means = np.concatenate([[[[z[0]], [0.0], [0.0]]], means])
    covariances = np.concatenate([[first], covariances])
    # Entry k of filterpy's lists belongs to the step that arrives at sample k.
    states, smoothed, _, _ = kalman.rts_smoother(means, covariances, [steps[0], *steps], [noises[0], *noises])
    return states[:, :, 0], smoothed[len(z) // 2]
