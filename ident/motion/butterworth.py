"""Butterworth low-pass filters as second-order sections, and the state in which they rest.

The same numbers as scipy.signal's `butter` and `sosfilt_zi`, whose import costs a second that a command has not.

Source: Oppenheim and Schafer, Discrete-Time Signal Processing, section 7.1 (bilinear transform).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float


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
        sections.append(
            [gain, 2 * gain, gain, 1.0, 2 * (corner**2 - 1) / lead, (1 - damping * corner + corner**2) / lead]
        )
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
