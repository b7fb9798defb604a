"""Positions to q, dq, ddq by a Kalman (Rauch-Tung-Striebel) smoother on a white-jerk model.

State x = (q, dq, ddq) of each joint by itself. Between samples Δt apart

    x⁺ = F x + w,  F = [[1, Δt, Δt²/2], [0, 1, Δt], [0, 0, 1]],
    cov w = s [[Δt⁵/20, Δt⁴/8, Δt³/6], [Δt⁴/8, Δt³/3, Δt²/2], [Δt³/6, Δt²/2, Δt]],

and z = q + v with var v = r. Only the ratio s/r shapes the smoother; it is found by maximum
likelihood of the innovations, with r concentrated out. The compiled path computes the covariances
only until they settle where the sampling is regular, and sample by sample where it is not; filterpy
is the reference that it equals.

Source: Rauch, Tung and Striebel 1965; Bar-Shalom, Li and Kirubarajan 2001, section 6.2.3
(white-jerk model).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from ident.arrays import Array, Float, freeze
from ident.compiled import compiled
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
# Sampling counts as regular when no interval is off by more than this share of the median.
REGULARITY = 1e-6
# Covariances have settled when a step changes them by less than this share. Rounding keeps some
# from ever coming closer than 1e-15; what is left after 1e-13 moves no state by 1e-9.
SETTLED = 1e-13
# On so many first samples the smoother's start, which is wide against all that is measured, is
# still felt.
ANCHORED = 8
# Samples of a session that the likelihood is evaluated on: more changes nothing but the time.
LIKELIHOOD_SAMPLES = 20_000


@dataclass(frozen=True, eq=False)
class NoiseLevels:
    """Noise of n joints."""

    jerk: Float[Array, " n"]  # spectral density s of the jerk [rad²/s⁵]
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


Covariance = tuple[float, float, float, float, float, float]
"""The numbers of a symmetric P = [[a, b, c], [b, d, e], [c, e, f]]."""


@compiled(error_model="numpy", nogil=True)
def _predict(p: Covariance, h: float, s: float) -> Covariance:
    """F P Fᵀ + Q, a step of h seconds on."""
    a, b, c, d, e, f = p
    g = 0.5 * h * h
    top = a + h * b + g * c
    right = b + h * d + g * e
    corner = c + h * e + g * f
    return (
        top + h * right + g * corner + s * h**5 / 20,
        right + h * corner + s * h**4 / 8,
        corner + s * h**3 / 6,
        d + h * e + h * (e + h * f) + s * h**3 / 3,
        e + h * f + s * h**2 / 2,
        f + s * h,
    )


@compiled(error_model="numpy", nogil=True)
def _update(p: Covariance, r: float) -> Covariance:
    """Joseph's form of the covariance after a measured position: (I − K H) P (I − K H)ᵀ + K
    r Kᵀ.
    """
    a, b, c, d, e, f = p
    v = a + r
    k0 = a / v
    k1 = b / v
    k2 = c / v
    return (
        a * (r / v) ** 2 + k0 * k0 * r,
        b - k1 * a - k0 * b + k0 * k1 * v,
        c - k2 * a - k0 * c + k0 * k2 * v,
        d - 2 * k1 * b + k1 * k1 * v,
        e - k1 * c - k2 * b + k1 * k2 * v,
        f - 2 * k2 * c + k2 * k2 * v,
    )


@compiled(error_model="numpy", nogil=True)
def _settled(new: Covariance, old: Covariance) -> bool:
    """Whether a step changed no entry by more than a share of the product of its two deviations."""
    (a, b, c, d, e, f) = new
    (oa, ob, oc, od, oe, of) = old
    return bool(
        abs(a - oa) <= SETTLED * np.sqrt(a * a)
        and abs(b - ob) <= SETTLED * np.sqrt(a * d)
        and abs(c - oc) <= SETTLED * np.sqrt(a * f)
        and abs(d - od) <= SETTLED * np.sqrt(d * d)
        and abs(e - oe) <= SETTLED * np.sqrt(d * f)
        and abs(f - of) <= SETTLED * np.sqrt(f * f)
    )


@compiled(error_model="numpy", nogil=True)
def _filter(z: Array, dt: Array, noise: Array, states: Array, history: Array, sums: Array) -> None:
    """Filtered states of one joint in one run, shape (T, 3), and what its likelihood is made of.

    `noise` holds s, r, the deviations of the first velocity and acceleration, and whether the
    sampling is regular; `history` keeps the six numbers of each covariance and 1 / S until they
    settle. To `sums` the logarithms of innovation variances and the squares of normalised
    innovations are added, and it gets the number of rows kept.
    """
    s = noise[0]
    r = noise[1]
    p = (r, 0.0, 0.0, noise[2] * noise[2], 0.0, noise[3] * noise[3])
    filtered = 1
    settled = False
    variance = 1.0
    k0 = 0.0
    k1 = 0.0
    k2 = 0.0
    history[0, 0], history[0, 1], history[0, 2], history[0, 3], history[0, 4], history[0, 5] = p
    x0 = z[0]
    x1 = 0.0
    x2 = 0.0
    states[0, 0] = x0
    states[0, 1] = x1
    states[0, 2] = x2
    for k in range(1, len(z)):
        h = dt[k - 1]
        if not settled:
            ahead = _predict(p, h, s)
            before = p
            variance = ahead[0] + r
            k0 = ahead[0] / variance
            k1 = ahead[1] / variance
            k2 = ahead[2] / variance
            p = _update(ahead, r)
            (
                history[k, 0],
                history[k, 1],
                history[k, 2],
                history[k, 3],
                history[k, 4],
                history[k, 5],
            ) = p
            history[k, 6] = 1.0 / variance
            filtered = k + 1
            settled = noise[4] > 0.0 and _settled(p, before)
        x0 += h * x1 + 0.5 * h * h * x2
        x1 += h * x2
        innovation = z[k] - x0
        sums[0] += np.log(variance)
        sums[1] += innovation * innovation / variance
        x0 = x0 + k0 * innovation
        x1 = x1 + k1 * innovation
        x2 = x2 + k2 * innovation
        states[k, 0] = x0
        states[k, 1] = x1
        states[k, 2] = x2
    sums[2] = filtered


@compiled(error_model="numpy", nogil=True)
def _smooth(z: Array, dt: Array, noise: Array, states: Array, history: Array, sums: Array) -> None:
    """Makes filtered states smoothed ones, in place; variances in the middle of the run are the
    last three of `sums`.

    Backwards by adjoints (Bryson and Frazier): x̂ = x − P λ with λ⁻ = Fᵀ ((I − K H)ᵀ λ − Hᵀ e / S),
    which inverts nothing and needs no smoothed covariance; Λ, that of λ, is carried to the middle
    only.
    """
    samples = len(z)
    s = noise[0]
    r = noise[1]
    filtered = int(sums[2])
    l0 = 0.0
    l1 = 0.0
    l2 = 0.0
    m00 = 0.0
    m01 = 0.0
    m02 = 0.0
    m11 = 0.0
    m12 = 0.0
    m22 = 0.0
    for k in range(samples - 1, -1, -1):
        i = min(k, filtered - 1)
        a = history[i, 0]
        b = history[i, 1]
        c = history[i, 2]
        d = history[i, 3]
        e = history[i, 4]
        f = history[i, 5]
        if k == samples // 2:
            w0 = m00 * a + m01 * b + m02 * c
            w1 = m01 * a + m11 * b + m12 * c
            w2 = m02 * a + m12 * b + m22 * c
            sums[3] = a - (a * w0 + b * w1 + c * w2)
            w0 = m00 * b + m01 * d + m02 * e
            w1 = m01 * b + m11 * d + m12 * e
            w2 = m02 * b + m12 * d + m22 * e
            sums[4] = d - (b * w0 + d * w1 + e * w2)
            w0 = m00 * c + m01 * e + m02 * f
            w1 = m01 * c + m11 * e + m12 * f
            w2 = m02 * c + m12 * e + m22 * f
            sums[5] = f - (c * w0 + e * w1 + f * w2)
        if k < samples - 1:
            states[k, 0] -= a * l0 + b * l1 + c * l2
            states[k, 1] -= b * l0 + d * l1 + e * l2
            states[k, 2] -= c * l0 + e * l1 + f * l2
        if k == 0:
            break
        h = dt[k - 1]
        g = 0.5 * h * h
        # 1 − K₀ is r / S: the difference would lose all its digits on a run's first samples.
        weight = history[i, 6]
        k0 = r * weight
        k1 = b / r
        k2 = c / r
        innovation = z[k] - (states[k - 1, 0] + h * states[k - 1, 1] + g * states[k - 1, 2])
        l0 = k0 * l0 - k1 * l1 - k2 * l2 - innovation * weight
        if k <= ANCHORED:
            # The same from what smoothing changed: λ⁻ = −(F P Fᵀ + Q)⁻¹ (x̂ − F x). A wide first P
            # times a small λ loses digits that this keeps.
            i = min(k - 1, filtered - 1)
            p = (
                history[i, 0],
                history[i, 1],
                history[i, 2],
                history[i, 3],
                history[i, 4],
                history[i, 5],
            )
            pa, pb, pc, pd, pe, pf = _predict(p, h, s)
            x1 = states[k - 1, 1] + h * states[k - 1, 2]
            x0 = states[k - 1, 0] + h * states[k - 1, 1] + g * states[k - 1, 2]
            y0 = states[k, 0] - x0
            y1 = states[k, 1] - x1
            y2 = states[k, 2] - states[k - 1, 2]
            f10 = pb / pa
            f20 = pc / pa
            d1 = pd - f10 * pb
            f21 = (pe - f20 * pb) / d1
            d2 = pf - f20 * pc - f21 * f21 * d1
            y1 -= f10 * y0
            y2 = (y2 - f20 * y0 - f21 * y1) / d2
            y1 = y1 / d1 - f21 * y2
            l0 = f10 * y1 + f20 * y2 - y0 / pa
            l1 = -y1
            l2 = -y2
        l2 += g * l0 + h * l1
        l1 += h * l0
        if k > samples // 2:
            # (I − K H)ᵀ Λ (I − K H) + Hᵀ H / S, then Fᵀ Λ F.
            w1 = k1 * m11 + k2 * m12
            w2 = k1 * m12 + k2 * m22
            m00 = k0 * (k0 * m00 - 2 * (k1 * m01 + k2 * m02)) + k1 * w1 + k2 * w2 + weight
            m01 = k0 * m01 - w1
            m02 = k0 * m02 - w2
            n00 = m00
            n01 = m01 + h * m00
            n02 = m02 + h * m01 + g * m00
            n11 = m11 + 2 * h * m01 + h * h * m00
            n12 = m12 + h * m02 + h * m11 + (h * h + g) * m01 + g * h * m00
            m22 += 2 * h * m12 + 2 * g * m02 + h * h * m11 + 2 * g * h * m01 + g * g * m00
            m00 = n00
            m01 = n01
            m02 = n02
            m11 = n11
            m12 = n12


def _intervals(time: Float[Array, " T"]) -> tuple[Float[Array, " T-1"], bool]:
    """Sampling intervals [s], all set to the median where the sampling is regular."""
    dt = np.diff(time)
    median = float(np.median(dt))
    # Clock readings of 10³ s carry 10⁻¹³ s of rounding: that is not jitter.
    if np.max(np.abs(dt - median)) <= REGULARITY * median:
        return np.full(len(dt), (time[-1] - time[0]) / len(dt)), True
    return dt, False


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
    """
    # The middle of each run, so that together they hold no more samples than change anything.
    share = min(1.0, LIKELIHOOD_SAMPLES / max(1, sum(map(len, times))))
    parts = []
    for t, z in zip(times, positions, strict=True):
        length = max(min(len(t), 50), int(len(t) * share))
        cut = slice((len(t) - length) // 2, (len(t) - length) // 2 + length)
        parts.append((np.asarray(t[cut]), np.asarray(z[cut])))
    steps = [_intervals(t) for t, _ in parts]
    interval = float(np.median(np.concatenate([dt for dt, _ in steps])))
    n = positions[0].shape[1]
    jerk = np.zeros(n)
    position = np.zeros(n)
    for j in range(n):
        columns = [np.ascontiguousarray(z[:, j]) for _, z in parts]
        if max(np.ptp(np.concatenate(columns)), 0.0) < LEAST_TRAVEL:
            position[j] = max(
                np.var(np.concatenate([z - z.mean() for z in columns])), LEAST_NOISE**2
            )
            continue
        jerk[j], position[j] = _fit_one_joint(columns, steps, interval, settings)
    return NoiseLevels(jerk, position)


def _fit_one_joint(
    columns: list[Float[Array, " T"]],
    steps: list[tuple[Float[Array, " T"], bool]],
    interval: float,
    settings: MotionSettings,
) -> tuple[float, float]:
    count = sum(len(column) - 1 for column in columns)
    longest = max(map(len, columns))
    states = np.empty((longest, 3))
    history = np.empty((longest, 7))
    sums = np.zeros(6)

    def ratio(log_frequency: float) -> float:
        return float((2 * np.pi * np.exp(log_frequency)) ** 6 * interval)

    def profile(log_frequency: float) -> tuple[float, float]:
        # With r = 1 the prior is in units of the (unknown) position noise; 1e-4 rad is its usual
        # size.
        first = (FIRST_VELOCITY_STD / 1e-4, FIRST_ACCELERATION_STD / 1e-4)
        sums[:2] = 0.0
        for z, (dt, regular) in zip(columns, steps, strict=True):
            _filter(
                z, dt, np.array([ratio(log_frequency), 1.0, *first, regular]), states, history, sums
            )
        variance = max(float(sums[1]) / count, LEAST_NOISE**2)
        return count * np.log(variance) + float(sums[0]), variance

    bounds = (np.log(settings.slowest_corner_hz), np.log(settings.fastest_corner_share / interval))
    optimum = minimize_scalar(
        lambda f: profile(f)[0], bounds=bounds, method="bounded", options={"xatol": 0.02}
    )
    best = float(optimum.x)
    noise = profile(float(optimum.x))[1]
    return ratio(best) * noise, noise


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
    """
    dt, regular = _intervals(np.asarray(time, dtype=float))
    samples, n = position.shape
    states = np.zeros((3, samples, n))
    std = np.zeros((3, n))
    # Pages of the history that a settled filter never reaches cost nothing.
    track = np.empty((samples, 3))
    history = np.empty((samples, 7))
    sums = np.zeros(6)
    for j in range(n):
        z = np.ascontiguousarray(position[:, j], dtype=float)
        if levels.jerk[j] == 0.0:
            states[0, :, j] = z.mean()
            std[0, j] = np.sqrt(levels.position[j] / samples)
            continue
        noise = np.array(
            [
                levels.jerk[j],
                levels.position[j],
                FIRST_VELOCITY_STD,
                FIRST_ACCELERATION_STD,
                regular,
            ]
        )
        if method == "fast":
            _filter(z, dt, noise, track, history, sums)
            _smooth(z, dt, noise, track, history, sums)
        else:
            _smooth_filterpy(z, dt, noise, track, sums[3:])
        states[:, :, j] = track.T
        std[:, j] = np.sqrt(sums[3:])
    return Smoothed(freeze(states[0]), freeze(states[1]), freeze(states[2]), freeze(std))


def _smooth_filterpy(z: Array, dt: Array, noise: Array, states: Array, middle: Array) -> None:
    """The same as `_filter` and `_smooth` through filterpy's general Kalman filter and smoother."""
    from filterpy.kalman import KalmanFilter  # slow to load, and only the reference needs it

    (s, r) = noise[:2]
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.R = np.array([[r]])
    first = np.diag([r, *noise[2:4] ** 2])
    start = np.array([[z[0]], [0.0], [0.0]])
    kalman.x = start.copy()
    kalman.P = first.copy()
    steps = [np.array([[1, h, h**2 / 2], [0, 1, h], [0, 0, 1]]) for h in dt]
    noises = [
        s
        * np.array(
            [
                [h**5 / 20, h**4 / 8, h**3 / 6],
                [h**4 / 8, h**3 / 3, h**2 / 2],
                [h**3 / 6, h**2 / 2, h],
            ]
        )
        for h in dt
    ]
    means, covariances, _, _ = kalman.batch_filter(z[1:], Fs=steps, Qs=noises)
    means = np.concatenate([[start], means])
    covariances = np.concatenate([[first], covariances])
    # Entry k of filterpy's lists belongs to the step that arrives at sample k.
    smoothed, spread, _, _ = kalman.rts_smoother(
        means, covariances, [steps[0], *steps], [noises[0], *noises]
    )
    states[:] = smoothed[:, :, 0]
    middle[:] = np.diag(spread[len(z) // 2])
