"""Laws of friction, springs and teeth: torque on one joint. Each takes the motion, the joint's index, the figures."""

from __future__ import annotations

import numpy as np

from ident.patch.standalone.chain import Array
from ident.patch.standalone.motion import Motion


def stribeck(m: Motion, j: int, p: dict[str, float]) -> Array:
    v = np.abs(m.dq[:, j]) / p["stribeck_velocity_rad_s"]
    return m.at(j, p["amplitude_Nm"] * m.direction[:, j] * np.exp(-(v ** p["exponent"])))


def nonlinear_viscous(m: Motion, j: int, p: dict[str, float]) -> Array:
    return m.at(j, p["coefficient"] * m.direction[:, j] * np.abs(m.dq[:, j]) ** p["exponent"])


def load_dependent(m: Motion, j: int, p: dict[str, float]) -> Array:
    return m.at(j, p["mu"] * m.direction[:, j] * np.abs(m.rigid[:, j]))


def thermal(m: Motion, j: int, p: dict[str, float]) -> Array:
    """The losses are those of the cold joint; both changes are shares of them."""
    viscous = p["viscous_change"] * m.losses.viscous[j] * m.dq[:, j]
    return m.at(j, m.warmth * (viscous + p["coulomb_change"] * m.losses.coulomb[j] * m.direction[:, j]))


def hysteresis(m: Motion, j: int, p: dict[str, float]) -> Array:
    """Two stop operators, z⁺ = clip(z + Δq, −r, r), whose mean range is the displacement."""
    m.sampled("presliding hysteresis")
    small, large, where = p["small_rad"], p["large_rad"], p["displacement_rad"]
    share = min(1.0, max(0.0, (where - small) / (large - small)))
    torque = (1.0 - share) * _stop(m.q[:, j], small) + share * _stop(m.q[:, j], large)
    return m.at(j, p["amplitude_Nm"] * torque)


def _stop(q: Array, size: float) -> Array:
    out, state = np.zeros(len(q)), 0.0
    for k, step in enumerate(np.diff(q), start=1):
        state = min(size, max(-size, state + step))
        out[k] = state / size
    return out


def position_dependent(m: Motion, j: int, p: dict[str, float]) -> Array:
    return m.at(j, p["amplitude_Nm"] * m.direction[:, j] * np.cos(p["order"] * m.q[:, j] - p["phase_rad"]))


def asymmetric(m: Motion, j: int, p: dict[str, float]) -> Array:
    constant = p["coulomb_difference_Nm"] * m.direction[:, j] ** 2
    return m.at(j, 0.5 * (constant + p["viscous_difference_Nms_rad"] * np.abs(m.dq[:, j])))


def coupling(m: Motion, j: int, p: dict[str, float]) -> Array:
    """Friction and inertia of another joint's motion, or friction of the sum or difference (`mix`) of both."""
    other, mix = int(p["other_joint"]) - 1, p["mix"]
    slip = np.tanh((m.dq[:, j] + mix * m.dq[:, other]) / p["width_rad_s"]) if mix else m.direction[:, other]
    steady = p["coulomb_Nm"] * slip + p["viscous_Nms_rad"] * m.dq[:, other]
    return m.at(j, steady + p["inertia_kgm2"] * m.ddq[:, other])


def ripple(m: Motion, j: int, p: dict[str, float]) -> Array:
    if m.arm.gears is None:
        raise ValueError("torque ripple needs gear ratios: set gears of ARM")
    return m.at(j, p["amplitude_Nm"] * np.cos(p["order"] * m.arm.gears[j] * m.q[:, j] - p["phase_rad"]))


def spring(m: Motion, j: int, p: dict[str, float]) -> Array:
    return m.at(j, p["stiffness_Nm_rad"] * (m.q[:, j] - p["rest_rad"]))
