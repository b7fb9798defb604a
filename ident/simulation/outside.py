"""Laws that no catalogue lists: causes that a diagnosis has to refuse to name. Never imported by it.

Cable drag, velocity-product drag and brake drag act here as torques in the loop; the sloshing load is a body
(`mjcf.Slosh`), the skidding friction a level of the bristles of `laws.toml`, and the supply's sag a
reading of the drive (`sensing.Sensing.sag`).

Laws with a memory or of the mesh act here too: a seal that relaxes (Maxwell's element), dry friction that grows while
the contact rests (rate and state), teeth whose friction turns round at the pitch point, and a gear's kinematic error,
which shakes the link the harder the nearer its order comes to the drive's resonance.

Source: Maxwell 1867; Dieterich 1979 and Ruina 1983 (rate and state); Velex and Cahouet 2000 (tooth friction); Tuttle
and Seering 1996 (kinematic error of a strain-wave gear and its resonance).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from ident.arrays import Array


@njit(cache=True)
def outside_torque(joint: Any, j: int, q: Array, v: Array, elapsed: float) -> float:
    """Torque on joint j [N m], given all positions, velocities and the time since the run began [s]."""
    torque = 0.0
    if joint.cable == 0.0 and joint.product == 0.0 and joint.brake == 0.0:
        return torque
    slide = np.tanh(v[j] / 0.01)
    if joint.cable != 0.0:
        centre = joint.cable_centre + joint.cable_share * q[joint.cable_other]
        # Angles wrap: the band lies on the circle.
        away = np.arctan2(np.sin(q[j] - centre), np.cos(q[j] - centre)) / joint.cable_width
        torque -= joint.cable * slide / (1.0 + away**6)
    if joint.product != 0.0:
        torque -= joint.product * v[j] * abs(v[joint.product_other])
    if joint.brake != 0.0:
        torque -= joint.brake * slide * np.exp(-elapsed / joint.brake_decay)
    return torque


# A contact younger than this has no more friction than a fresh one [s].
YOUNGEST_S = 0.02
# Damping ratio of the resonance that a kinematic error meets.
WOBBLE_DAMPING = 0.15


@njit(cache=True)
def remembered_torque(joint: Any, state: Any, angle: float, v: float, dt: float) -> float:
    """Torque on a joint [N m] of the laws that have a memory or live in the mesh; advances the memory in place.

    Args:
        joint: A record of the law.
        state: The joint's own, with `stretched` [N m], `age` [s] and `transmitted` [N m].
        angle, v: Of the joint [rad], [rad/s].
        dt: Step [s].
    """
    torque = 0.0
    if joint.seal != 0.0:  # d(stretched)/dt = k v - stretched / relaxation, implicit
        state.stretched = (state.stretched + joint.seal * v * dt) / (1.0 + dt / joint.seal_relaxation)
        torque -= state.stretched
    if joint.ageing != 0.0:  # d(age)/dt = 1 - |v| age / slip, implicit
        state.age = (state.age + dt) / (1.0 + dt * abs(v) / joint.ageing_slip)
        torque -= joint.ageing * np.log(1.0 + state.age / YOUNGEST_S) * np.tanh(v / 2e-3)
    if joint.tooth != 0.0:
        wave = np.sin(joint.tooth_order * angle)
        torque -= joint.tooth * abs(state.transmitted) * np.tanh(v / 0.01) * np.tanh(4.0 * wave)
    if joint.wobble != 0.0:
        pulse = joint.wobble_order * v
        share = pulse / joint.wobble_resonance
        growth = 1.0 / np.sqrt((1.0 - share**2) ** 2 + (2.0 * WOBBLE_DAMPING * share) ** 2)
        torque -= joint.wobble_inertia * joint.wobble * pulse**2 * growth * np.sin(joint.wobble_order * angle)
    return torque
