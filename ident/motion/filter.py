"""The common filter, the numbers by which recordings become motions, and what encoders add to
positions.

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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.errors import RecordingError
from ident.motion.settings import ENCODER, USUAL_MOTION, MotionSettings

if TYPE_CHECKING:
    from ident.motion.smoothing import NoiseLevels


FILTER_ORDER = 4
# Arms' motions last seconds: a filter that leaves only what is slower leaves nothing of them [Hz].
LEAST_CUTOFF_HZ = 0.1


# The common filter: second-order sections of a Butterworth low-pass, both ways over many columns at
# once. The numbers of scipy.signal's `butter`, `sosfilt_zi` and `sosfiltfilt`, whose import costs a
# second that a command has not: odd extension at both ends, sections started at the steady state of
# the first value. What differs is the order of the loops: all columns of a sample go side by side,
# so that the processor works on several at a time. Source: Oppenheim and Schafer, Discrete-Time
# Signal Processing, section 7.1 (bilinear transform); Gustafsson 1996 for filtering both ways;
# direct form II transposed.


@lru_cache(maxsize=64)
def design_lowpass(order: int, cutoff: float, rate: float) -> Float[Array, "s 6"]:
    """Sections b₀ b₁ b₂ 1 a₁ a₂ of a Butterworth low-pass, nearest poles to the unit circle last.

    Args:
        order: Even number of poles.
        cutoff: Corner, 3 dB down [Hz].
        rate: Sampling rate [Hz].

    Raises:
        ValueError: The order is odd, or the corner lies at or above half the sampling rate.
    """
    if order % 2 or not 0.0 < cutoff < 0.5 * rate:
        raise ValueError(f"no low-pass of order {order} at {cutoff:g} Hz of {rate:g} Hz")
    corner = np.tan(np.pi * cutoff / rate)
    sections = []
    for k in range(order // 2):
        # A pair of poles at angles ± (π/2 + (2 k + 1) π / 2 n) on the circle of the pre-warped
        # corner.
        damping = 2.0 * np.sin((2 * k + 1) * np.pi / (2 * order))
        lead = 1.0 + damping * corner + corner**2
        gain = corner**2 / lead
        poles = 2 * (corner**2 - 1) / lead, (1 - damping * corner + corner**2) / lead
        sections.append([gain, 2 * gain, gain, 1.0, *poles])
    return np.array(sections[::-1])


def resting_states(sections: Float[Array, "s 6"]) -> Float[Array, "s 2"]:
    """States of the sections (transposed direct form II) that a constant input of one keeps as they
    are.
    """
    states = np.zeros((len(sections), 2))
    level = 1.0
    for k, (b0, b1, b2, _, a1, a2) in enumerate(sections):
        out = level * (b0 + b1 + b2) / (1.0 + a1 + a2)
        states[k, 1] = b2 * level - a2 * out
        states[k, 0] = out - b0 * level
        level = out
    return states


def filter_both_ways(
    sections: Float[Array, "s 6"], values: Float[Array, "T ..."], padding: int
) -> Float[Array, "T ..."]:
    """Filters along the first axis, without delay.

    Args:
        sections: Second-order sections of the filter.
        values: Signals.
        padding: Samples by which both ends are extended; fewer than there are.
    """
    return filter_together(sections, [values], padding).reshape(np.shape(values))


def filter_together(
    sections: Float[Array, "s 6"], parts: Sequence[Float[Array, "T ..."]], padding: int
) -> Float[Array, "T k"]:
    """The same of several arrays: all of their columns side by side."""
    length = len(parts[0])
    # One signal after the other, then all of a sample side by side: each of the two copies reads or
    # writes in order.
    signals = np.concatenate([np.reshape(signal, (length, -1)).T for signal in parts])
    columns = np.empty((length + 2 * padding, len(signals)))
    # At both ends extended by what turns a signal about its first and last value.
    columns[:padding] = 2.0 * signals[:, 0] - signals[:, padding:0:-1].T
    columns[padding : padding + length] = signals.T
    columns[padding + length :] = 2.0 * signals[:, -1] - signals[:, -2 : -padding - 2 : -1].T
    _filter(columns, sections, resting_states(sections))
    return columns[padding : padding + length]


@compiled(error_model="numpy", nogil=True)
def _filter(values: Array, sections: Array, steady: Array) -> None:
    """Filters columns in place, first forwards, then backwards."""
    length, columns = values.shape
    state = np.empty((len(sections), 2, columns))
    for way in range(2):
        for s in range(len(sections)):
            for c in range(columns):
                first = values[0 if way == 0 else length - 1, c]
                state[s, 0, c] = steady[s, 0] * first
                state[s, 1, c] = steady[s, 1] * first
        for k in range(length):
            t = k if way == 0 else length - 1 - k
            for s in range(len(sections)):
                b0 = sections[s, 0]
                b1 = sections[s, 1]
                b2 = sections[s, 2]
                a1 = sections[s, 4]
                a2 = sections[s, 5]
                for c in range(columns):
                    x = values[t, c]
                    y = b0 * x + state[s, 0, c]
                    state[s, 0, c] = b1 * x - a1 * y + state[s, 1, c]
                    state[s, 1, c] = b2 * x - a2 * y
                    values[t, c] = y


@dataclass(frozen=True)
class Lowpass:
    """Zero-phase Butterworth low-pass and decimation."""

    rate: float  # sampling rate before [Hz]
    cutoff: float  # corner frequency [Hz]
    factor: int  # one of how many samples is kept

    @classmethod
    def design(
        cls, rate: float, cutoff: float | None = None, settings: MotionSettings = USUAL_MOTION
    ) -> Lowpass:
        """The filter for a rate; at least `settings.oversampling` samples a period of the corner
        are kept.

        Raises:
            RecordingError: The corner asked for is no frequency of a motion, or too high for the
                rate.
        """
        corner = min(cutoff or settings.cutoff_hz, settings.cutoff_share * rate)
        if cutoff is not None and not LEAST_CUTOFF_HZ <= cutoff <= 1.001 * corner:
            what = f"{cutoff:g} Hz is no corner of a filter at {rate:.4g} Hz"
            highest = settings.cutoff_share * rate
            raise RecordingError(
                "--cutoff", what, f"give {LEAST_CUTOFF_HZ:g} to {highest:.3g} Hz, or leave it out"
            )
        return cls(rate, corner, max(1, int(rate / (settings.oversampling * corner))))

    def __call__(self, values: Float[Array, "T ..."]) -> Float[Array, "t ..."]:
        """Filters along the first axis and decimates."""
        return self.together([values]).reshape(-1, *np.shape(values)[1:])

    def together(self, parts: Sequence[Float[Array, "T ..."]]) -> Float[Array, "t k"]:
        """The same of several signals, all of their columns side by side."""
        padding = min(len(parts[0]) - 1, int(3 * self.rate / self.cutoff))
        return filter_together(
            design_lowpass(FILTER_ORDER, self.cutoff, self.rate), parts, padding
        )[:: self.factor]


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
        total += np.abs(np.fft.rfft(window[:, None] * values[start : start + length], axis=0)) ** 2
    total /= len(starts) * rate * np.sum(window**2)
    total[1 : -1 if length % 2 == 0 else None] *= 2.0
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
    """
    known = settings.noise_known_to * rate
    length = min(len(ddq), max(16, round(settings.band_stretch_s * rate)))
    f, power = mean_spectrum(ddq, rate, length)
    with np.errstate(divide="ignore", invalid="ignore"):
        corner = levels.bandwidth(1.0 / rate)
        noise = (
            2
            * levels.position
            / rate
            * (2 * np.pi * f[:, None]) ** 4
            / (1 + (f[:, None] / corner) ** 6) ** 2
        )
        saved = np.cumsum(
            np.where(f[:, None] <= known, power - (1.0 + settings.caution) * noise, 0.0), axis=0
        )
    band = np.maximum(f[np.argmax(saved, axis=0)], settings.slowest_band_hz)
    return np.where((levels.jerk > 0.0) & (band < known - f[1]), band, rate / 2)


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
        reach = min(len(states) - 1, round(ENCODER.padding_periods * rate / float(band[j])))
        sections = design_lowpass(ENCODER.filter_order, float(band[j]), rate)
        column = states[:, j]
        time = np.arange(1, reach + 1) / rate
        longer = np.concatenate(
            [_coasted(column[0], -time[::-1]), column, _coasted(column[-1], time)]
        )
        cut = filter_both_ways(sections, longer, reach)[reach : reach + len(column)]
        # The smoother knows the ends of a run better than a filter does: there its states fade in.
        end = (
            np.minimum(np.arange(len(column)), np.arange(len(column))[::-1]) * float(band[j]) / rate
        )
        trust = np.sin(0.5 * np.pi * np.clip(end / ENCODER.fading_periods, 0.0, 1.0))[:, None] ** 2
        banded[:, j, 1:] = (trust * cut + (1.0 - trust) * column)[:, 1:]
    return banded


def _coasted(state: Float[Array, " 3"], time: Float[Array, " t"]) -> Float[Array, "t 3"]:
    """States before or after one, at constant acceleration: a low-pass leaves these as they are."""
    q, dq, ddq = state
    return np.stack(
        [q + dq * time + 0.5 * ddq * time**2, dq + ddq * time, np.full_like(time, ddq)], axis=1
    )


def find_resolution(position: Float[Array, "T n"]) -> Float[Array, " n"]:
    """Step of each joint's encoder as logged; 0 where there is none to be seen [rad]."""
    steps = np.zeros(position.shape[1])
    for j, change in enumerate(np.abs(np.diff(position, axis=0)).T):
        moved = change[change > 1e-9]
        if len(moved) < ENCODER.least_changes:
            continue
        step = float(np.median(moved[moved < 1.5 * moved.min()]))
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
    """
    std = np.sqrt(levels.position)
    coarse = resolution > ENCODER.least_step * std
    steps = np.where(coarse, resolution, 1.0)
    # Steps alone have a variance of a twelfth of their square; what is beyond that is noise before
    # the step.
    before = np.where(coarse, np.sqrt(np.maximum(levels.position - resolution**2 / 12, 0.0)), std)
    error = before * rng.standard_normal(q.shape)
    shift = steps * rng.uniform(size=q.shape[1])
    stepped = steps * np.round((q + error + shift) / steps) - shift - q
    return np.where(coarse, stepped, error)
