"""A joint whose figures all changed by one factor: not its friction has changed but the scale of its torque.

For each figure that is in units of torque, r = log(mean after / mean before). Where these agree (their spread about the
weighted mean by χ²), several of them changed, and the common change is sure, it is the torque's scale: another current
gain, another firmware, another drive.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from scipy.special import chdtrc, ndtri

# Figures that follow the torque's scale.
SCALED = ("gain", "rotor", "viscous", "coulomb")
# They agree unless so improbable; one has changed beyond so many standard errors; so many of them must have.
AGREE, CHANGED, LEAST_CHANGED = 0.01, 3.0, 2


def common_scale(
    before: Mapping[str, Sequence[float]], after: Mapping[str, Sequence[float]]
) -> tuple[float, float, float] | None:
    """The factor on a joint's torque with its 95 % interval; None where its figures did not change alike.

    Args:
        before, after: Figure -> its values in the sessions before and after a change.
    """
    ratios, variances = [], []
    for figure in SCALED:
        early, late = (np.array(values.get(figure, ())) for values in (before, after))
        if len(early) < 2 or len(late) < 2 or early.mean() <= 0.0 or late.mean() <= 0.0:
            continue
        # Days differ as much after the change as before: both tell the spread.
        free = len(early) + len(late) - 2
        square = (((early - early.mean()) ** 2).sum() + ((late - late.mean()) ** 2).sum()) / free
        variance = square * (1 / len(early) / early.mean() ** 2 + 1 / len(late) / late.mean() ** 2)
        ratios.append(float(np.log(late.mean() / early.mean())))
        variances.append(max(float(variance), 1e-12))
    if len(ratios) < LEAST_CHANGED:
        return None
    r, v = np.array(ratios), np.array(variances)
    mean, error = float((r / v).sum() / (1 / v).sum()), float((1 / v).sum() ** -0.5)
    alike = chdtrc(len(r) - 1, float(((r - mean) ** 2 / v).sum())) > AGREE
    several = int((np.sign(mean) * r / np.sqrt(v) > CHANGED).sum()) >= LEAST_CHANGED
    if not (alike and several):
        return None
    reach = float(ndtri(0.975)) * error
    return float(np.exp(mean)), float(np.exp(mean - reach)), float(np.exp(mean + reach))
