"""How far friction wanders from run to run, and what that does to a set's mean: a distribution, for runs are few.

Friction is not free from run to run: it wanders, as gears warm. What it goes from a run to the next, x ~ N(0, q + v)
with v by the noise of both, adds up, and a session of R runs that set out where the last one did has a mean that is off
by q R / 3. Five steps a set, in noise, leave q open by much: an estimate of zero says little. With a scaled inverse
chi² prior about what this arm's joints usually do, every q counts by how likely the steps are.

Source: DerSimonian and Laird 1986 on variance components; Gelman et al., Bayesian Data Analysis (scaled inverse chi²),
for why the estimate alone, zero as often as not, is too sure.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float

# Degrees of freedom that a variance from runs has beside those of the runs: arms of one kind differ by little.
PRIOR_DOF = 2.0
# Points of the grid over q, and how far it goes to either side of what is usual, as a factor on q.
POINTS, REACH = 61, 1e4


@dataclass(frozen=True)
class Wandering:
    """What the difference of both sets' means may be off by.

    Attributes:
        variance: Its variance at each of some points.
        weight: How likely each is; they sum to one.
    """

    variance: Float[Array, " m"]
    weight: Float[Array, " m"]


STILL = Wandering(np.zeros(1), np.ones(1))


def estimate_wandering(sets: Sequence[tuple[Float[Array, " R"], Float[Array, " R"], int]], usual: float) -> Wandering:
    """How likely it is that friction wanders how far.

    Args:
        sets: Of each set the sizes of the change in its runs, in their order, their variances by the noise, and the
            number of sessions that the runs come from.
        usual: Standard deviation of a step as this arm's joints have it; 0 for what does not wander.
    """
    if usual <= 0.0:
        return STILL
    steps = np.concatenate([np.diff(size) ** 2 for size, _, _ in sets])
    noise = np.concatenate([variance[1:] + variance[:-1] for _, variance, _ in sets])
    share = sum(len(size) / count / 3.0 / count for size, _, count in sets if len(size))
    q = usual**2 * np.geomspace(1.0 / REACH, REACH, POINTS)
    logs = -0.5 * PRIOR_DOF * (np.log(q) + usual**2 / q)
    of_steps = np.add.outer(q, noise)
    logs -= 0.5 * np.sum(np.log(of_steps) + steps / of_steps, axis=1)
    weight: Array = np.exp(logs - logs.max())
    return Wandering(q * share, weight / weight.sum())
