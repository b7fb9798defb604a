"""Whether states follow one another, and how soon: what has a past can be remembered."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float

# States follow one another where their speeds explain all but this share of the squares of their
# steps.
MOST_APART = 0.05


def sampling_interval(q: Float[Array, "T n"], dq: Float[Array, "T n"]) -> float | None:
    """Time between states that follow one another evenly [s]; None where they do not."""
    if len(q) < 3:
        return None
    steps = np.diff(q, axis=0)
    pace = 0.5 * (dq[1:] + dq[:-1])
    power = float(np.sum(pace**2))
    if power <= 0.0:
        return None
    interval = float(np.sum(steps * pace)) / power
    apart = float(np.sum((steps - interval * pace) ** 2))
    follows = interval > 0.0 and apart <= MOST_APART * float(np.sum(steps**2))
    return interval if follows else None
