"""Laws of friction, springs and teeth: torque on one joint. Each takes motion, joint and parameters."""

from __future__ import annotations

import numpy as np

from ident.export.standalone.chain import Array
from ident.export.standalone.motion import MovingArm, stop


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
