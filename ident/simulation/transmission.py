"""What lies between motor and link: rotor, spring, gap, tooth ripple, and the dress pack around the joint.

Source: Spong 1987 (two bodies and a spring); Hunt and Crossley 1975 (contact in the gap).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ident.arrays import Array, Float


class DriveLaw(NamedTuple):
    """The drive train of each of n joints, referred to the link side; arrays of shape (n,).

    Attributes:
        elastic: Whether motor and link are two bodies; else they move as one.
        rotor_inertia: Motor and gear inertia times the gear ratio squared [kg m²].
        stiffness, damping: Spring between the two [N m/rad], [N m s/rad].
        gap: Full width of the free play in the spring [rad].
        ripple, ripple_order, ripple_phase: Tooth ripple [N m], cycles a joint turn, angle [rad].
        ripple_load: Growth of the ripple with the transmitted torque, relative, at rated torque.
        hose_stiffness, hose_rest, hose_span: Dress pack: stiffness at rest [N m/rad], rest angle [rad], deflection
            beyond which it stiffens [rad].
        effort_limit: Rated peak torque [N m].
    """

    elastic: Array
    rotor_inertia: Array
    stiffness: Array
    damping: Array
    gap: Array
    ripple: Array
    ripple_order: Array
    ripple_phase: Array
    ripple_load: Array
    hose_stiffness: Array
    hose_rest: Array
    hose_span: Array
    effort_limit: Array


def rigid_drive(rotor_inertia: Float[Array, " n"], effort_limit: Float[Array, " n"]) -> DriveLaw:
    """A healthy drive: rigid, without play, ripple or dress pack."""
    n = len(rotor_inertia)
    zero = np.zeros(n)
    return DriveLaw(
        elastic=np.zeros(n, dtype=np.bool_),
        rotor_inertia=np.array(rotor_inertia, dtype=float),
        stiffness=np.full(n, 1e4),
        damping=np.full(n, 1.0),
        gap=zero.copy(),
        ripple=zero.copy(),
        ripple_order=np.full(n, 200.0),
        ripple_phase=zero.copy(),
        ripple_load=zero.copy(),
        hose_stiffness=zero.copy(),
        hose_rest=zero.copy(),
        hose_span=np.full(n, 1.5),
        effort_limit=np.array(effort_limit, dtype=float),
    )


@njit(cache=True)
def spring_torque(joint: Any, twist: float, rate: float) -> float:
    """Torque that the spring carries from motor to link [N m].

    Args:
        joint: The drive, a record of `DriveLaw`.
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
