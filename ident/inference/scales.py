"""Scales on which evidence of few nats and of thousands can be compared."""

from __future__ import annotations

import numpy as np


def signed_log(nats: float) -> float:
    """Logarithm of one and a number's size, with its sign."""
    return float(np.sign(nats) * np.log1p(abs(nats)))


def squashed(gain: float, error: float) -> float:
    """A gain in its standard errors, on a scale where thirty are twice as much as three."""
    return float(np.arcsinh(gain / max(error, 1e-12)))
