"""A gear that twists, or has play: the link's own motion behind a motor that moves as recorded.

With the twist θ between motor and link, M θ'' + D θ' + K z(θ) = τ, where τ is what the bodies would ask of the motor if
the gear were rigid, M the inertia that the joint moves, z(θ) = θ or what of it lies beyond the play.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from numba import njit

from ident.arrays import Array
from ident.simulation.real.moved_arm import MovedArm

# Share of an oscillation's phase that a step of the integration may take; fastest and slowest step [s].
PHASE, STEPS = 0.25, (5e-5, 1e-3)
States = tuple[Array, Array, Array]


def twist_of(arm: MovedArm, j: int, stiffness: float, ratio: float, gap: float = 0.0) -> tuple[States, float]:
    """Twist of a springy gear with play of full width `gap` [rad], its first two derivatives, and its damping
    [N m s/rad], a share `ratio` of the critical one.
    """
    # What the joint moves [kg m^2], every tenth sample and between.
    some, data = np.arange(0, len(arm.q), 10), arm.model.createData()
    inertia = np.interp(np.arange(len(arm.q)), some, [pin.crba(arm.model, data, arm.q[k])[j, j] for k in some])
    damping = 2.0 * ratio * float(np.sqrt(stiffness * np.median(inertia)))
    step = float(np.clip(PHASE * np.sqrt(inertia.min() / stiffness), *STEPS))
    states = np.zeros((3, len(arm.q)))
    gear = np.array([stiffness, damping, 0.5 * gap, step])
    _follow(np.ascontiguousarray(arm.rigid[:, j]), inertia, arm.steps, gear, states)
    return (states[0], states[1], states[2]), damping


@njit(cache=True)
def _follow(torque: Array, mass: Array, dt: Array, gear: Array, out: Array) -> None:
    """Semi-implicit Euler between the samples, torque and inertia linear between them."""
    stiffness, damping, half, step = gear
    x = v = 0.0
    for k in range(len(torque)):
        if not np.isfinite(dt[k]):
            x, v = torque[k] / stiffness + np.sign(torque[k]) * half, 0.0
            bend = torque[k]
        else:
            count = max(int(np.ceil(dt[k] / step)), 1)
            h = dt[k] / count
            for i in range(count):
                share = (i + 1) / count
                load = torque[k - 1] + share * (torque[k] - torque[k - 1])
                m = mass[k - 1] + share * (mass[k] - mass[k - 1])
                bend = stiffness * (np.sign(x) * max(abs(x) - half, 0.0))
                touching = 1.0 if abs(x) >= half else 0.05
                # The damping is taken at the step's end: no step is too long for it.
                v = (v + h * (load - bend) / m) / (1.0 + h * touching * damping / m)
                x += h * v
        bend = stiffness * (np.sign(x) * max(abs(x) - half, 0.0))
        out[0, k], out[1, k] = x, v
        out[2, k] = (torque[k] - bend - (damping if abs(x) >= half else 0.05 * damping) * v) / mass[k]
