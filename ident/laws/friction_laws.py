"""Laws of friction, springs and teeth.

Those of one joint's speed, load and angle are columns that are linear in their coefficients; what
bends them (a speed, an exponent, an order) is their shape. They are named as their effects and
written with +, *, ** and what `at.xp` has, so that NumPy's arrays and other arrays go through the
same lines. The others take motion, joint and parameters.

Source: Bittencourt and Gunnarsson 2010 (Stribeck); Carreau 1972 (a lubricant whose viscosity falls
with its shear beyond a knee); Hamon, Gautier and Garrec 2010 (load).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.laws.motion import Array, MovingArm, stop


@dataclass(frozen=True, eq=False)
class JointStates:
    """One joint's states at T times, as laws of friction see them."""

    q: Any  # position [rad] and speed [rad/s]
    dq: Any
    load: Any  # torque that the joint transmits: rigid torque, without rotor and friction [N m]
    slip: Any  # direction of sliding in [-1, 1]
    xp: Any = np  # where exp, cos and sin of such states come from

    @property
    def speed(self) -> Any:
        """|dq| [rad/s]."""
        return abs(self.dq)

    @property
    def burden(self) -> Any:
        """|load| [N m]."""
        return abs(self.load)


def stribeck_friction(states: JointStates, shape: Mapping[str, float]) -> list[Any]:
    """One column s exp(−(|v| / v_s)^δ).

    The shape has v_s as `stribeck_velocity_rad_s` and δ as `exponent`.
    """
    share = states.speed / shape["stribeck_velocity_rad_s"]
    return [states.slip * states.xp.exp(-(share ** shape["exponent"]))]


def nonlinear_viscous_friction(states: JointStates, shape: Mapping[str, float]) -> list[Any]:
    """One column s |v|^α; with a knee v_k straight below it, s |v| (v² + v_k²)^((α − 1) / 2).

    The shape has α as `exponent` and, where there is a knee, v_k as `knee_rad_s`.
    """
    knee = shape.get("knee_rad_s", 0.0)
    return [states.slip * bent(states.speed, shape["exponent"], knee)]


def bent(speed: Any, exponent: float, knee: float = 0.0) -> Any:
    """A power of speeds, none of them negative.

    Args:
        speed: The speeds [rad/s].
        exponent: The power above the knee.
        knee: Speed below which it is straight [rad/s]; 0 for none.
    """
    if not knee:
        return speed**exponent
    return speed * (speed * speed + knee * knee) ** (0.5 * exponent - 0.5)


def load_dependent_friction(states: JointStates, shape: Mapping[str, float]) -> list[Any]:
    """Columns of driving and half of backdriving, and of the reverse.

    With four `terms` in the shape, s τ_l² over a typical load (`load_Nm`) and v |τ_l| too.
    """
    both = states.slip * states.burden
    gain = states.slip**2 * states.load
    columns = [0.75 * both + 0.25 * gain, 0.75 * both - 0.25 * gain]
    if shape["terms"] == 4:
        columns.append(states.slip * states.load**2 / shape["load_Nm"])
        columns.append(states.dq * states.burden)
    return columns


def position_dependent_friction(states: JointStates, shape: Mapping[str, float]) -> list[Any]:
    """Two columns s cos kq, s sin kq; the shape has k, waves a turn, as `order`."""
    angle = shape["order"] * states.q
    cosine = states.xp.cos(angle)
    sine = states.xp.sin(angle)
    return [states.slip * cosine, states.slip * sine]


def asymmetric_friction(states: JointStates, shape: Mapping[str, float]) -> list[Any]:
    """Two columns s² / 2, |v| / 2; no shape."""
    return [0.5 * states.slip**2, 0.5 * states.speed]


def thermal(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """The losses are those of the cold joint; both changes are shares of them."""
    viscous = p["viscous_change"] * m.losses.viscous[j] * m.dq[:, j]
    coulomb = p["coulomb_change"] * m.losses.coulomb[j] * m.direction[:, j]
    return m.at(j, m.warmth_of(j) * (viscous + coulomb))


def hysteresis(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Stop operators of several ranges side by side, Σ k_i stop_i[q] / r_i."""
    m.sampled("presliding hysteresis")
    parts = [name.split("_")[1] for name in p if name.startswith("part_")]
    stops = []
    for i in parts:
        bent = stop(m.q[:, j], p[f"range_{i}_rad"])
        stops.append(p[f"part_{i}_Nm"] * bent)
    return m.at(j, np.sum(stops, axis=0))


def coupling(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """Friction and inertia of another joint's motion, or friction of the sum or difference (`mix`)
    of both.
    """
    other = int(p["other_joint"]) - 1
    mix = p["mix"]
    slip = m.direction[:, other]
    if mix:
        mixed = m.dq[:, j] + mix * m.dq[:, other]
        slip = np.tanh(mixed / p["width_rad_s"])
    speed = m.dq[:, other] + mix * m.dq[:, j]
    viscous = p["viscous_Nms_rad"] * speed
    steady = p["coulomb_Nm"] * slip + viscous
    return m.at(j, steady + p["inertia_kgm2"] * m.ddq[:, other])


def ripple(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """A wave a turn of the motor, as it is or as a share of the load."""
    turns = p["turns"]
    if not turns and m.arm.gears is None:
        raise ValueError("torque ripple needs gear ratios: set gears of ARM")
    if not turns and m.arm.gears is not None:
        turns = p["order"] * m.arm.gears[j]
    share = m.rigid[:, j] / p["load_Nm"] if p["loaded"] else 1.0
    wave = np.cos(turns * m.q[:, j] - p["phase_rad"])
    return m.at(j, share * p["amplitude_Nm"] * wave)


def spring(m: MovingArm, j: int, p: dict[str, float]) -> Array:
    """A cubic about an angle, or a wave with two rests a turn."""
    q = m.q[:, j]
    x = q - p["centre_rad"]
    quadratic = p["square_Nm_rad2"] + x * p["cube_Nm_rad3"]
    slope = p["linear_Nm_rad"] + x * quadratic
    cubic = p["constant_Nm"] + x * slope
    cosine = p["cosine_Nm"] * np.cos(2.0 * q)
    sine = p["sine_Nm"] * np.sin(2.0 * q)
    return m.at(j, cubic + cosine + sine)
