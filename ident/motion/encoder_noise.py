"""What encoders add to positions, and up to which frequency a motion stands clear of it.

A smoother of one bandwidth lets encoder noise through wherever a motion is slower. Such noise
stands in every column that is made of the motion: it makes coefficients too small, and other
columns made of the same noise (a delayed torque, another joint's acceleration) take some of it
away, which looks like an effect. That of the smoothed acceleration is

    N(f) = 2 r Δt (2π f)⁴ / (1 + (f / f_s)⁶)²,

with r the variance of a measured position and f_s the smoother's corner. With P(f) the
acceleration's spectrum, keeping all up to a frequency b costs the noise below b and the motion
above b, ∫_{f<b} N + ∫_{f>b} (P − N). The states are cut off at the b where that is least, noise
counted more than once (`caution`): within a run a motion is slower most times than its mean
spectrum says. What is lost is motion that the encoder hardly saw; it doesn't bias the other
parameters.

Source: Wiener 1949; Carroll, Ruppert, Stefanski and Crainiceanu 2006, chapter 4 (regression
calibration); Welch 1967.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.motion.filter import design_lowpass, filter_both_ways
from ident.motion.settings import ENCODER, USUAL_MOTION, MotionSettings
from ident.motion.smoothing import NoiseLevels


def mean_spectrum(
    values: Float[Array, "T n"], rate: float, length: int
) -> tuple[Float[Array, " f"], Float[Array, "f n"]]:
    """One-sided power density; as scipy.signal's `welch` without detrending, whose import takes a
    second.

    Args:
        values: Signals, evenly sampled.
        rate: Sampling rate [Hz].
        length: Samples of a stretch, no more than there are.

    Returns:
        Frequencies [Hz] and density [unit² / Hz].
    """
    window = np.sin(np.pi * np.arange(length) / length) ** 2
    step = length - length // 2
    starts = range(0, len(values) - length + 1, step)
    total = np.zeros((length // 2 + 1, values.shape[1]))
    for start in starts:
        piece = values[start : start + length]
        spectrum = np.fft.rfft(window[:, None] * piece, axis=0)
        total += np.abs(spectrum) ** 2
    total /= len(starts) * rate * np.sum(window**2)
    # All frequencies but the first, and the last of an even length, stand for two.
    last = -1 if length % 2 == 0 else None
    total[1:last] *= 2.0
    return np.fft.rfftfreq(length, 1.0 / rate), total


def find_signal_band(
    ddq: Float[Array, "T n"],
    rate: float,
    levels: NoiseLevels,
    settings: MotionSettings = USUAL_MOTION,
) -> Float[Array, " n"]:
    """Frequency at which each joint's states are best cut off; the Nyquist frequency if nowhere
    [Hz].

    Args:
        ddq: Smoothed acceleration, evenly sampled [rad/s²].
        rate: Sampling rate [Hz].
        levels: Noise of the joints' positions.
        settings: How much motion must outweigh noise, and where both are known.

    Returns:
        By joint; half the sampling rate where nothing is to be cut off.
    """
    known = settings.noise_known_to * rate
    length = min(len(ddq), max(16, round(settings.band_stretch_s * rate)))
    f, power = mean_spectrum(ddq, rate, length)
    frequency = f[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = levels.bandwidth(1.0 / rate)
        position = 2 * levels.position / rate
        smoothing = (1 + (frequency / corner) ** 6) ** 2
        noise = position * (2 * np.pi * frequency) ** 4 / smoothing
        gain = power - (1.0 + settings.caution) * noise
        saved = np.cumsum(np.where(frequency <= known, gain, 0.0), axis=0)
    band = np.maximum(f[np.argmax(saved, axis=0)], settings.slowest_band_hz)
    is_banded = (levels.jerk > 0.0) & (band < known - f[1])
    return np.where(is_banded, band, rate / 2)


def keep_band(
    states: Float[Array, "T n 3"], rate: float, band: Float[Array, " n"], highest: float
) -> Float[Array, "T n 3"]:
    """Speed and acceleration of each joint up to its band; as they are where that reaches all that
    is looked at.

    Noise of the position itself is small in any torque, and stays.

    Args:
        states: q, dq, ddq, evenly sampled.
        rate: Sampling rate [Hz].
        band: Of each joint [Hz].
        highest: Frequency above which nobody looks [Hz].
    """
    banded = states.copy()
    for j in np.flatnonzero(band < min(highest, 0.45 * rate)):
        corner = float(band[j])
        column = states[:, j]
        reach = min(len(states) - 1, round(ENCODER.padding_periods * rate / corner))
        sections = design_lowpass(ENCODER.filter_order, corner, rate)
        time = np.arange(1, reach + 1) / rate
        before = _coasted(column[0], -time[::-1])
        after = _coasted(column[-1], time)
        longer = np.concatenate([before, column, after])
        cut = filter_both_ways(sections, longer, reach)[reach : reach + len(column)]
        # The smoother knows the ends of a run better than a filter does: there its states fade in.
        sample = np.arange(len(column))
        periods_to_end = np.minimum(sample, sample[::-1]) * corner / rate
        faded = np.clip(periods_to_end / ENCODER.fading_periods, 0.0, 1.0)
        trust = np.sin(0.5 * np.pi * faded)[:, None] ** 2
        mixed = trust * cut + (1.0 - trust) * column
        banded[:, j, 1:] = mixed[:, 1:]
    return banded


def _coasted(state: Float[Array, " 3"], time: Float[Array, " t"]) -> Float[Array, "t 3"]:
    """States before or after one, at constant acceleration: a low-pass leaves these as they are."""
    q, dq, ddq = state
    position = q + dq * time + 0.5 * ddq * time**2
    speed = dq + ddq * time
    return np.stack([position, speed, np.full_like(time, ddq)], axis=1)


def find_resolution(position: Float[Array, "T n"]) -> Float[Array, " n"]:
    """Step of each joint's encoder as logged; 0 where there is none to be seen [rad]."""
    steps = np.zeros(position.shape[1])
    changes = np.abs(np.diff(position, axis=0))
    for j, change in enumerate(changes.T):
        moved = change[change > 1e-9]
        if len(moved) < ENCODER.least_changes:
            continue
        smallest = moved[moved < 1.5 * moved.min()]
        step = float(np.median(smallest))
        multiples = moved[moved < ENCODER.most_steps * step] / step
        whole = np.abs(multiples - np.round(multiples)) < ENCODER.whole_within
        if len(multiples) >= ENCODER.least_changes and np.mean(whole) > ENCODER.steps_share:
            steps[j] = step
    return steps


def draw_errors(
    q: Float[Array, "T n"],
    levels: NoiseLevels,
    resolution: Float[Array, " n"],
    rng: np.random.Generator,
) -> Float[Array, "T n"]:
    """Errors of one more measurement of a smoothed motion by the same encoders; a resolution of 0
    is none [rad].

    Args:
        q: The smoothed motion [rad].
        levels: Noise of the joints' positions.
        resolution: Step of each encoder [rad]; 0 for none.
        rng: Generator of the draw.
    """
    std = np.sqrt(levels.position)
    coarse = resolution > ENCODER.least_step * std
    steps = np.where(coarse, resolution, 1.0)
    # Steps alone have a variance of a twelfth of their square; what is beyond that is noise before
    # the step.
    beyond_steps = np.maximum(levels.position - resolution**2 / 12, 0.0)
    before = np.where(coarse, np.sqrt(beyond_steps), std)
    error = before * rng.standard_normal(q.shape)
    shift = steps * rng.uniform(size=q.shape[1])
    logged = steps * np.round((q + error + shift) / steps) - shift
    return np.where(coarse, logged - q, error)
