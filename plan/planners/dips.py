"""Where along a motion pairs of shapes come near each other."""

from __future__ import annotations

import numpy as np
from numba import njit

from ident.arrays import Array, Float, Int


def find_dips(
    shares: Float[Array, " T"], gaps: Float[Array, "T P"], bound: float
) -> tuple[Float[Array, " m"], Int[Array, " m"], Float[Array, " m"]]:
    """Where along the motion each pair's gap dips below a bound, with the neighbours; and the pairs, and the gaps."""
    places, pairs = np.nonzero(_near_dips(gaps, bound))
    return shares[places], pairs, gaps[places, pairs]


@njit(cache=True, nogil=True)
def _near_dips(gaps, bound):  # type: ignore[no-untyped-def]
    """Whether a gap lies below a bound and is a dip's bottom or beside one."""
    count, out = gaps.shape[0], np.zeros(gaps.shape, dtype=np.bool_)
    for t in range(count):
        for p in range(gaps.shape[1]):
            gap = gaps[t, p]
            if gap >= bound or (t > 0 and gaps[t - 1, p] < gap) or (t + 1 < count and gaps[t + 1, p] < gap):
                continue
            for beside in range(max(t - 1, 0), min(t + 2, count)):
                out[beside, p] = gaps[beside, p] < bound
    return out
