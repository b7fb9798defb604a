"""Dry and viscous friction of a geared joint: bristles that stick, not a function of velocity.

Every sliding contact is a LuGre bristle of deflection z,

    dz/dt = v - σ0 |v| z / g(v, …),    F = σ0 z + σ1(v) dz/dt,

which holds any torque below its level g at rest. The level carries the Stribeck fall, the mesh load, the seat's
eccentricity, the direction and the temperature; viscous drag is the lubricant's, with shear thinning after Eyring.

Source: Canudas de Wit et al. 1995 (LuGre); Eyring 1936 (shear thinning); Bittencourt and Gunnarsson 2010 (load,
temperature).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.simulation.laws import Law, change_law, make_law

# Presliding of the ordinary (stiff) bristles before they slip [rad]: a third of a degree at the motor, behind the gear.
STIFF_PRESLIDING = 5e-5


# Of each joint, units referred to the joint.
FRICTION: dict[str, float | int] = {
    "coulomb": 0.0,  # dry friction while sliding [N m]
    "viscous": 0.0,  # drag [N m s/rad]
    "bristle_stiffness": 0.0,  # σ0 of the ordinary contact [N m/rad]
    "bristle_damping": 0.0,  # σ1 of the ordinary contact at rest [N m s/rad]
    "stribeck": 0.0,  # excess at rest [N m], its velocity [rad/s], its shape
    "stribeck_velocity": 0.05,
    "stribeck_exponent": 1.3,
    "eyring": 0.0,  # shear-thinning drag A asinh(v / v_E): A [N m], v_E [rad/s]
    "eyring_velocity": 0.1,
    "load": 0.0,  # mesh friction per transmitted torque
    "load_floor": 1e-6,  # torque below which the mesh does not feel it [N m]
    "load_drive": 0.15,  # how much more a driving mesh rubs than a driven one
    "seat": 0.0,  # eccentric bearing seat: relative change of the level, lobes a turn, angle [rad]
    "seat_order": 1.0,
    "seat_phase": 0.0,
    "coulomb_skew": 0.0,  # difference between forward and backward motion [N m], [N m s/rad]
    "viscous_skew": 0.0,
    "soft": 0.0,  # a second, soft contact (presliding hysteresis): level [N m], stiffness [N m/rad]
    "soft_stiffness": 1.0,
    "thermal_viscous": 0.0,  # decay of viscosity and dry friction per kelvin [1/K]
    "thermal_coulomb": 0.0,
    "couple_to": -1,  # the other joint that also turns this joint's motor, and its ratio
    "couple_ratio": 0.0,
    "couple_coulomb": 0.0,  # friction in the motor's combined motion [N m], [N m s/rad]
    "couple_viscous": 0.0,
    "skid": 0.0,  # dry friction that grows with |acceleration| [N m], its scale [rad/s²] (outside the catalogue)
    "skid_scale": 1.0,
}


def plain_friction(coulomb: Float[Array, " n"], viscous: Float[Array, " n"], inertia: Float[Array, " n"]) -> Law:
    """Friction of a healthy joint: Coulomb that sticks, and viscous drag; none of either where they are zero.

    Args:
        coulomb: Sliding friction [N m].
        viscous: Viscous drag [N m s/rad].
        inertia: Least inertia that moves with the joint [kg m²]; sets the bristles' damping.
    """
    stiffness = coulomb / STIFF_PRESLIDING
    return make_law(
        FRICTION,
        len(coulomb),
        coulomb=coulomb,
        viscous=viscous,
        bristle_stiffness=stiffness,
        bristle_damping=0.6 * np.sqrt(stiffness * inertia),
        load_floor=0.02 * coulomb + 1e-6,
    )


def scale_friction(law: Law, coulomb: Array | float, viscous: Array | float) -> Law:
    """The same joints, rubbing more or less: dry friction with its bristles, and drag, times factors."""
    return change_law(
        law,
        coulomb=law.coulomb * coulomb,
        bristle_stiffness=law.bristle_stiffness * coulomb,
        viscous=law.viscous * viscous,
    )


@njit(cache=True)
def seat_shape(angle: float) -> float:
    """An eccentric seat rubs harder where it is tight: a bump a turn, of mean zero and amplitude about one."""
    return (np.exp(0.5 * np.cos(angle)) - 1.0634833707413236) / 0.51526


@njit(cache=True)
def sliding_level(joint: Any, v: float, angle: float, transmitted: float, acceleration: float, warm: float) -> float:
    """g: the dry friction that the ordinary contact of a joint would have if it slid steadily at v [N m]."""
    level = joint.coulomb
    if joint.seat != 0.0:
        level *= 1.0 + joint.seat * seat_shape(joint.seat_order * angle + joint.seat_phase)
    if joint.stribeck != 0.0:
        level += joint.stribeck * np.exp(-((abs(v) / joint.stribeck_velocity) ** joint.stribeck_exponent))
    if joint.load != 0.0:
        floor = joint.load_floor
        felt = np.sqrt(transmitted * transmitted + floor * floor) - floor
        level += joint.load * felt * (1.0 + joint.load_drive * np.tanh(v * transmitted / (0.05 * floor + 1e-9)))
    if joint.coulomb_skew != 0.0:
        level += 0.5 * joint.coulomb_skew * np.tanh(v / 1e-3)
    if joint.skid != 0.0:
        level += joint.skid * np.tanh(abs(acceleration) / joint.skid_scale)
    if joint.thermal_coulomb != 0.0:
        level *= np.exp(-joint.thermal_coulomb * warm)
    return max(level, 1e-6)


@njit(cache=True)
def bristle(z: float, v: float, level: float, stiffness: float, damping: float, dt: float) -> tuple[float, float]:
    """One step of a bristle: its new deflection [rad] and its torque [N m].

    Implicit in z, so that it is stable at any speed; the damping dies out above creeping speed, or it would add
    viscous drag.
    """
    if stiffness <= 0.0:
        return 0.0, 0.0
    bent = (z + dt * v) / (1.0 + dt * stiffness * abs(v) / level)
    creep = level / stiffness * 50.0
    rate = damping / (1.0 + (v / creep) ** 2)
    return bent, stiffness * bent + rate * (bent - z) / dt


@njit(cache=True)
def viscous_drag(joint: Any, v: float, warm: float) -> float:
    """Drag of the lubricant [N m]: Newtonian and shear-thinning part, thinner when warm."""
    drag = joint.viscous * v
    if joint.viscous_skew != 0.0:
        drag += 0.5 * joint.viscous_skew * abs(v)
    if joint.eyring != 0.0:
        drag += joint.eyring * np.arcsinh(v / joint.eyring_velocity)
    if joint.thermal_viscous != 0.0:
        drag *= np.exp(-joint.thermal_viscous * warm)
    return drag
