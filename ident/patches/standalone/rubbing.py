"""Laws of friction, springs and teeth: torque on one joint. Each takes the motion, the joint's index, the figures."""

from __future__ import annotations

import numpy as np

from ident.patches.standalone.chain import Array
from ident.patches.standalone.motion import MovingArm, stop


def stribeck(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    v = np.abs(m.dq[:, j]) / p["stribeck_velocity_rad_s"]
    return m.at(j, p["amplitude_Nm"] * m.direction[:, j] * np.exp(-(v ** p["exponent"])))


def nonlinear_viscous(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """A power of speed; straight below its knee, where it has one."""
    speed, knee = np.abs(m.dq[:, j]), p.get("knee_rad_s", 0.0)
    bent = speed * np.hypot(speed, knee) ** (p["exponent"] - 1.0) if knee else speed ** p["exponent"]
    return m.at(j, p["coefficient"] * m.direction[:, j] * bent)


def load_dependent(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """More while driving than while backdriving; with curvature over the load, and a share that grows with speed."""
    load, slip = m.rigid[:, j], m.direction[:, j]
    torque = p["level"] * slip * np.abs(load) + p["driving"] * slip**2 * load
    torque = torque + p["curvature_1_Nm"] * slip * load**2 + p["viscous_s_rad"] * m.dq[:, j] * np.abs(load)
    return m.at(j, torque)


def thermal(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """The losses are those of the cold joint; both changes are shares of them."""
    viscous = p["viscous_change"] * m.losses.viscous[j] * m.dq[:, j]
    return m.at(j, m.warmth_of(j) * (viscous + p["coulomb_change"] * m.losses.coulomb[j] * m.direction[:, j]))


def hysteresis(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Stop operators of several ranges side by side, Σ k_i stop_i[q] / r_i."""
    m.sampled("presliding hysteresis")
    parts = [name.split("_")[1] for name in p if name.startswith("part_")]
    stops = [p[f"part_{i}_Nm"] * stop(m.q[:, j], p[f"range_{i}_rad"]) for i in parts]
    return m.at(j, np.sum(stops, axis=0))


def position_dependent(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    return m.at(j, p["amplitude_Nm"] * m.direction[:, j] * np.cos(p["order"] * m.q[:, j] - p["phase_rad"]))


def asymmetric(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    constant = p["coulomb_difference_Nm"] * m.direction[:, j] ** 2
    return m.at(j, 0.5 * (constant + p["viscous_difference_Nms_rad"] * np.abs(m.dq[:, j])))


def coupling(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Friction and inertia of another joint's motion, or friction of the sum or difference (`mix`) of both."""
    other, mix = int(p["other_joint"]) - 1, p["mix"]
    slip = np.tanh((m.dq[:, j] + mix * m.dq[:, other]) / p["width_rad_s"]) if mix else m.direction[:, other]
    steady = p["coulomb_Nm"] * slip + p["viscous_Nms_rad"] * (m.dq[:, other] + mix * m.dq[:, j])
    return m.at(j, steady + p["inertia_kgm2"] * m.ddq[:, other])


def ripple(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """A wave a turn of the motor, as it is or as a share of the load."""
    turns = p["turns"]
    if not turns and m.arm.gears is None:
        raise ValueError("torque ripple needs gear ratios: set gears of ARM")
    if not turns and m.arm.gears is not None:
        turns = p["order"] * m.arm.gears[j]
    share = m.rigid[:, j] / p["load_Nm"] if p["loaded"] else 1.0
    return m.at(j, share * p["amplitude_Nm"] * np.cos(turns * m.q[:, j] - p["phase_rad"]))


def spring(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """A cubic about an angle, or a wave with two rests a turn."""
    q = m.q[:, j]
    x = q - p["centre_rad"]
    cubic = p["constant_Nm"] + x * (p["linear_Nm_rad"] + x * (p["square_Nm_rad2"] + x * p["cube_Nm_rad3"]))
    return m.at(j, cubic + p["cosine_Nm"] * np.cos(2.0 * q) + p["sine_Nm"] * np.sin(2.0 * q))
