"""How large the laws may be that both sets share: as large as they are on any arm, and some more.

The baseline holds every law in all runs alike, hundreds of columns, of which short or slow recordings tell a part. With
nothing known of the rest it takes any size, passes through every sample, and runs away on those that it has not seen:
then no change does better on them. No spring holds a multiple of what its joint can give.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.switched import Switched
from ident.diagnosis.regression.design import Group
from ident.effects.base import SessionContext
from ident.effects.typical_sizes import rated_torque

# Standard deviation of a shared law's coefficients, in their largest plausible size: twice what a diagnosis believes.
LOOSE = 1.0


def common_information(switched: Switched, session: SessionContext) -> Float[Array, " f"]:
    """Information on the scaled coefficient of each of the baseline's further columns."""
    layout, scale = switched.evidence.layout, switched.evidence.scale
    sizes = [_largest(group, session) for group in switched.common]
    first = layout.tuned - layout.further
    std = LOOSE * np.concatenate([*sizes, np.zeros(0)]) * scale[first : layout.tuned]
    return 1.0 / std**2


def _largest(group: Group, session: SessionContext) -> Float[Array, " k"]:
    """Largest plausible size of a law's coefficients; of one of which nothing is known, what its joint can give."""
    sizes = group.effect.prior_scale(group.effect.asked(session), group.joint, group.variant)
    if sizes is None:
        return np.full(len(group.columns), rated_torque(session, group.joint))
    return np.broadcast_to(sizes, len(group.columns))
