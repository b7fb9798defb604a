"""The common filter, and the numbers by which recordings become motions."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.settings import Settings, read_group


class MotionSettings(Settings, table="motion"):
    """What of a recording is motion, what is noise, and where friction is known; the usual ones are those of a fit."""


USUAL_MOTION = MotionSettings()
FOR_DIAGNOSIS = MotionSettings(**vars(read_group(__file__, "diagnosis")))
ENCODER = read_group(__file__, "encoder")


# The common filter: second-order sections of a Butterworth low-pass, forwards and backwards over many columns at
# once.
# The numbers of scipy.signal's `butter`, `sosfilt_zi` and `sosfiltfilt`, whose import costs a second that a command
# has not: odd extension at both ends, sections started at the steady state of the first value. What differs is the
# order of the loops: all columns of a sample go side by side through two sections in one go, so that the processor
# works on several of them at a time and stores half as much between.
# Source: Oppenheim and Schafer, Discrete-Time Signal Processing, section 7.1 (bilinear transform); Gustafsson 1996
# for filtering both ways; direct form II transposed.


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
        # A pair of poles at angles ± (π/2 + (2 k + 1) π / 2 n) on the circle of the pre-warped corner.
        damping = 2.0 * np.sin((2 * k + 1) * np.pi / (2 * order))
        lead = 1.0 + damping * corner + corner**2
        gain = corner**2 / lead
        poles = 2 * (corner**2 - 1) / lead, (1 - damping * corner + corner**2) / lead
        sections.append([gain, 2 * gain, gain, 1.0, *poles])
    return np.array(sections[::-1])


def resting_states(sections: Float[Array, "s 6"]) -> Float[Array, "s 2"]:
    """States of the sections (transposed direct form II) that a constant input of one keeps as they are."""
    states, level = np.zeros((len(sections), 2)), 1.0
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
    # One signal after the other, then all of a sample side by side: each of the two copies reads or writes in order.
    rows = [np.reshape(part, (length, -1)).T for part in parts]
    signals = np.empty((sum(map(len, rows)), length))
    np.concatenate(rows, out=signals)
    columns = np.empty((length + 2 * padding, len(signals)))
    _extend(signals, padding, columns)
    pairs, steady = _in_pairs(np.asarray(sections, dtype=float).tobytes())
    state = np.empty((len(pairs), 2, columns.shape[1]))
    _filter(columns, pairs, steady, state)
    return columns[padding : padding + length]


@lru_cache(maxsize=64)
def _in_pairs(content: bytes) -> tuple[Float[Array, "s 6"], Float[Array, "s 2"]]:
    """Sections, an even number of them, and the states in which they rest: a session asks for few filters, often."""
    sections = np.frombuffer(content).reshape(-1, 6).copy()
    steady = resting_states(sections)
    if len(sections) % 2:  # one more that changes nothing
        sections = np.vstack([sections, [1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
        steady = np.vstack([steady, [0.0, 0.0]])
    return sections, steady


@compiled("f2 i f2")
def _extend(signals: Array, padding: int, columns: Array) -> None:
    """Signals as columns, extended at both ends by what turns them about their first and last value, tile by tile."""
    count, length = signals.shape
    for first in range(0, count, 8):
        end = min(first + 8, count)
        for start in range(0, length, 8):
            for t in range(start, min(start + 8, length)):
                for c in range(first, end):
                    columns[padding + t, c] = signals[c, t]
        for t in range(padding):
            for c in range(first, end):
                columns[t, c] = 2.0 * signals[c, 0] - signals[c, padding - t]
                columns[padding + length + t, c] = 2.0 * signals[c, length - 1] - signals[c, length - 2 - t]


@compiled("f2 f2 f2 f3")
def _filter(values: Array, sections: Array, steady: Array, state: Array) -> None:
    """Filters columns in place, first forwards, then backwards; `state` is room to work in."""
    length, columns = values.shape
    for way in range(2):
        first = 0 if way == 0 else length - 1
        for s in range(len(sections)):
            for c in range(columns):
                state[s, 0, c] = steady[s, 0] * values[first, c]
                state[s, 1, c] = steady[s, 1] * values[first, c]
        for s in range(0, len(sections), 2):
            b0, b1, b2 = sections[s, 0], sections[s, 1], sections[s, 2]
            a1, a2 = sections[s, 4], sections[s, 5]
            e0, e1, e2 = sections[s + 1, 0], sections[s + 1, 1], sections[s + 1, 2]
            d1, d2 = sections[s + 1, 4], sections[s + 1, 5]
            for k in range(length):
                t = k if way == 0 else length - 1 - k
                for c in range(columns):
                    x = values[t, c]
                    y = b0 * x + state[s, 0, c]
                    state[s, 0, c] = b1 * x - a1 * y + state[s, 1, c]
                    state[s, 1, c] = b2 * x - a2 * y
                    z = e0 * y + state[s + 1, 0, c]
                    state[s + 1, 0, c] = e1 * y - d1 * z + state[s + 1, 1, c]
                    state[s + 1, 1, c] = e2 * y - d2 * z
                    values[t, c] = z
