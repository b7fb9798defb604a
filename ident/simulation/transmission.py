"""What lies between motor and link: rotor, spring, gap, tooth ripple, and the dress pack around the joint.

Source: Spong 1987 (two bodies and a spring); Hunt and Crossley 1975 (contact in the gap).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.simulation.laws import Law, make_law

# The drive train of each joint, referred to the link side.
DRIVE: dict[str, float | bool] = {
    "elastic": False,  # whether motor and link are two bodies; else they move as one
    "rotor_inertia": 0.0,  # motor and gear inertia times the gear ratio squared [kg m²]
    "stiffness": 1e4,  # spring between the two [N m/rad], [N m s/rad]
    "damping": 1.0,
    "gap": 0.0,  # full width of the free play in the spring [rad]
    "ripple": 0.0,  # tooth ripple [N m], cycles a joint turn, angle [rad]
    "ripple_order": 200.0,
    "ripple_phase": 0.0,
    "ripple_load": 0.0,  # growth of the ripple with the transmitted torque, relative, at rated torque
    "hose_stiffness": 0.0,  # dress pack: stiffness at rest [N m/rad], rest angle [rad]
    "hose_rest": 0.0,
    "hose_span": 1.5,  # deflection beyond which it stiffens [rad]
    "effort_limit": 0.0,  # rated peak torque [N m]
}


def rigid_drive(rotor_inertia: Float[Array, " n"], effort_limit: Float[Array, " n"]) -> Law:
    """A healthy drive: rigid, without play, ripple or dress pack."""
    return make_law(DRIVE, len(rotor_inertia), rotor_inertia=rotor_inertia, effort_limit=effort_limit)


@njit(cache=True)
def spring_torque(joint: Any, twist: float, rate: float) -> float:
    """Torque that the spring carries from motor to link [N m].

    Args:
        joint: The drive, a record of the law.
        twist: Motor angle less link angle [rad].
        rate: Its rate [rad/s].
    """
    half = 0.5 * joint.gap
    if half <= 0.0:
        return joint.stiffness * twist + joint.damping * rate
    if abs(twist) <= half:
        return 0.0
    depth = abs(twist) - half
    side = 1.0 if twist > 0.0 else -1.0
    # Contact damping grows from zero with the depth, and a contact never pulls.
    share = min(depth / half, 1.0)
    return side * max(joint.stiffness * depth + side * joint.damping * share * rate, 0.0)


@njit(cache=True)
def ripple_torque(joint: Any, angle: float, transmitted: float) -> float:
    """Torque by which the teeth help or hinder at a motor angle [N m]: main order, and a little of half and double."""
    if joint.ripple == 0.0:
        return 0.0
    phase = joint.ripple_order * angle + joint.ripple_phase
    wave = np.cos(phase) + 0.12 * np.cos(0.5 * phase) + 0.08 * np.cos(2.0 * phase)
    return joint.ripple * (1.0 + joint.ripple_load * abs(transmitted) / joint.effort_limit) * wave


@njit(cache=True)
def hose_torque(joint: Any, angle: float) -> float:
    """Torque of the dress pack on the link [N m], against the deflection and stiffening with it."""
    if joint.hose_stiffness == 0.0:
        return 0.0
    span = joint.hose_span
    return -joint.hose_stiffness * span * np.sinh((angle - joint.hose_rest) / span)
