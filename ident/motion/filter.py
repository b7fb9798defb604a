"""The common filter: a Butterworth low-pass in sections, both ways over many columns at once.

The numbers of scipy.signal's `butter`, `sosfilt_zi` and `sosfiltfilt`, whose import costs a second
that a command has not: odd extension at both ends, sections started at the steady state of the
first value. What differs is the order of the loops: all columns of a sample go side by side, so
that the processor works on several at a time.

Source: Oppenheim and Schafer, Discrete-Time Signal Processing, section 7.1 (bilinear transform);
Gustafsson 1996 for filtering both ways; direct form II transposed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.errors import RecordingError
from ident.motion.settings import USUAL_MOTION, MotionSettings

FILTER_ORDER = 4
# Arms' motions last seconds: a filter that leaves only what is slower leaves nothing of them [Hz].
LEAST_CUTOFF_HZ = 0.1


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
        a1 = 2 * (corner**2 - 1) / lead
        a2 = (1 - damping * corner + corner**2) / lead
        sections.append([gain, 2 * gain, gain, 1.0, a1, a2])
    return np.array(sections[::-1])


def resting_states(sections: Float[Array, "s 6"]) -> Float[Array, "s 2"]:
    """States of second-order sections that a constant input of one keeps as they are.

    Args:
        sections: b₀ b₁ b₂ 1 a₁ a₂ of each, as `design_lowpass` gives them.

    Returns:
        Both states of each section (transposed direct form II).
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
    """Filters several arrays along the first axis, without delay, as `filter_both_ways`.

    Args:
        sections: Second-order sections of the filter.
        parts: Arrays of T samples each.
        padding: Samples by which both ends are extended; fewer than T.

    Returns:
        All of their columns side by side.
    """
    length = len(parts[0])
    # One signal after the other, then all of a sample side by side: each of the two copies reads or
    # writes in order.
    signals = np.concatenate([np.reshape(signal, (length, -1)).T for signal in parts])
    columns = np.empty((length + 2 * padding, len(signals)))
    # At both ends extended by what turns a signal about its first and last value.
    before = signals[:, padding:0:-1]
    columns[:padding] = 2.0 * signals[:, 0] - before.T
    columns[padding : padding + length] = signals.T
    after = signals[:, -2 : -padding - 2 : -1]
    columns[padding + length :] = 2.0 * signals[:, -1] - after.T
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
        """The filter for a sampling rate.

        At least `settings.oversampling` samples a period of the corner are kept.

        Args:
            rate: Sampling rate [Hz].
            cutoff: Corner [Hz]; that of the settings, as far as the rate allows, if None.
            settings: Usual corner, its largest share of the rate, and samples that are kept.

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
        """Filters several signals along the first axis and decimates them.

        Returns:
            All of their columns side by side, every `factor`-th sample.
        """
        settling = int(3 * self.rate / self.cutoff)
        padding = min(len(parts[0]) - 1, settling)
        sections = design_lowpass(FILTER_ORDER, self.cutoff, self.rate)
        return filter_together(sections, parts, padding)[:: self.factor]
