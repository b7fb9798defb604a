"""Gears that give way: what a joint's link does behind its motor, and what all joints feel of it.

The measured position is the motor's; the link lags by a deflection δ. With the motor's motion given, the link's own
equation of motion is one of a single unknown, linear in small δ:

    M δ'' + V δ' + P δ + τ_gear(δ, δ') = τ_rigid,

M, V, P the derivatives of the rigid torque by acceleration, velocity and position of the joint. It is integrated over
the recording, which holds near the resonance too, where a series in 1/K does not. What all joints feel of it is
−(M δ'' + V δ' + P δ), with the whole column of each derivative.

Source: Spong 1987, for the elastic joint; integration by Newmark's method (1959) with some numerical damping.
"""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.effects.base import RunContext, SessionContext
from ident.effects.typical_sizes import sampled_states
from ident.laws.elastic import LONGEST_STEP, integrate_twist

# The link's equation is linear in small deflections. Where velocity torques, or an inertia that tuning made negative,
# swing it up without bound, it says nothing of any arm [rad].
LARGEST_TWIST = 1.0
# Factors of the finer grids around the best stiffness or gap.
FINE_FACTORS = (0.5, 0.6, 0.7, 0.84, 1.0, 1.2, 1.4, 1.7, 2.0)


_integrate = compiled("f1 f1 f1 f1 f f f f i f1 f1")(integrate_twist)


def mean_inertia(session: SessionContext, joint: int) -> float:
    """Mean inertia of the link side about a joint [kg m²]."""
    mass_matrix = session.runs[0].arm.derivatives(*sampled_states(session))[2]
    return max(float(np.mean(mass_matrix[:, joint, joint])), 1e-6)


def deflect(
    run: RunContext, joint: int, stiffness: float, damping: float, gap: float
) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    """Deflection of the joint and its rate [rad, rad/s]; none where the law doesn't hold."""
    position, velocity, inertia = (np.ascontiguousarray(part[:, joint, joint]) for part in run.derivatives)
    load = np.ascontiguousarray(run.link[:, joint])
    steps = max(1, int(np.ceil(run.interval / LONGEST_STEP)))
    twist, rate = np.empty(len(load)), np.empty(len(load))
    _integrate(load, inertia, velocity, position, stiffness, damping, gap / 2, run.interval, steps, twist, rate)
    if not np.abs(twist).max() < LARGEST_TWIST:
        return np.zeros(len(load)), np.zeros(len(load))
    return twist, rate


def felt_torque(
    run: RunContext, joint: int, twist: Array, rate: Array, rows: slice = slice(None), unit: float = 1.0
) -> Float[Array, "T k"]:
    """What all joints, or some of them, feel of a deflection, divided by a unit of it [N m]."""
    position, velocity, inertia = (np.ascontiguousarray(np.moveaxis(part, 0, -1)) for part in run.derivatives)
    chosen = range(run.n)[rows]
    felt = np.empty((len(chosen), len(twist)))
    change = np.gradient(rate, run.interval)
    _feel(position, velocity, inertia, joint, chosen.start, twist, rate, change, unit, felt)
    return felt.T


@compiled("f3 f3 f3 i i f1 f1 f1 f f2")
def _feel(
    position: Array,
    velocity: Array,
    inertia: Array,
    joint: int,
    first: int,
    twist: Array,
    rate: Array,
    change: Array,
    unit: float,
    felt: Array,
) -> None:
    """Torque of one joint after the other, sample by sample; of a derivative the samples come last."""
    for k in range(len(felt)):
        i = first + k
        for t in range(len(twist)):
            torque = inertia[i, joint, t] * change[t] + velocity[i, joint, t] * rate[t]
            felt[k, t] = -(torque + position[i, joint, t] * twist[t]) / unit
