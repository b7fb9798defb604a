"""By how much friction varies from stretch to stretch, and how much of that gathers as a random
walk: both at their likeliest (`ident.regression.level_likelihood`).
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.regression.gram import Evidence
from ident.regression.level_likelihood import walk_likelihood
from ident.regression.run_spread import SPREADS, levels_left, spread_prior

# Shares of the variance that are tried.
WALKING = (0.0, 0.3, 0.6, 0.9, 1.0)


def estimate_walk(
    evidence: Evidence, joint: int, weights: Float[Array, " P"]
) -> tuple[float, float]:
    """By how much a joint's friction varies, and which share of that gathers as a random walk.

    Args:
        evidence: Sums of the session.
        joint: Index of the joint.
        weights: As in `run_spread.estimate_run_spread`.

    Returns:
        The relative standard deviation, the usual one where a single stretch says nothing of it;
        and the share of the variance, between 0 and 1.
    """
    settings = evidence.settings
    levels, noise = levels_left(evidence, joint, weights)
    if len(levels) < 2:
        return settings.usual_spread, 0.0
    tried = np.geomspace(*SPREADS)
    spreads = np.tile(tried, len(WALKING))
    shares = np.repeat(WALKING, len(tried))
    likelihoods = walk_likelihood(levels, noise, spreads, shares)
    best = int(np.argmax(likelihoods + spread_prior(spreads, settings)))
    return float(spreads[best]), float(shares[best])
