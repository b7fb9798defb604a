"""Scales on which evidence of few nats and of thousands can be compared."""

from __future__ import annotations

import numpy as np


def signed_log(nats: float) -> float:
    """sign(x) log(1 + |x|): a number of nats on a logarithmic scale that keeps its sign."""
    return float(np.sign(nats) * np.log1p(abs(nats)))


def squashed(gain: float, error: float) -> float:
    """arsinh of a gain over its standard error: linear for small ratios, logarithmic for large
    ones.
    """
    return float(np.arcsinh(gain / max(error, 1e-12)))
