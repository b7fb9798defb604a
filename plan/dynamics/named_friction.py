"""Friction laws that a diagnosis named, as planners need them: their torque's slopes and extremes.

The laws themselves are `ident.laws`; here their torque is differentiated by the joint's position, speed and load.
Moduli have corners: there a derivative is the mean of both sides.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.laws.carried import JointStates, NamedLaw

# Step of the central differences, in the states' own units: laws are smooth on scales that are thousands of times it.
STEP = 1e-6


def law_slopes(
    law: NamedLaw, at: JointStates, turning: Float[Array, " T"]
) -> tuple[Float[Array, " T"], Float[Array, " T"], Float[Array, " T"]]:
    """Derivatives of a law's torque by its joint's position, speed and load.

    Args:
        law: Fitted.
        at: States of its joint.
        turning: Derivative of the direction by the speed [s/rad].
    """

    def slope(name: str) -> Float[Array, " T"]:
        up, down = (law.torque(replace(at, **{name: getattr(at, name) + step})) for step in (STEP, -STEP))
        return (up - down) / (2.0 * STEP)

    return slope("q"), slope("dq") + turning * slope("slip"), slope("load")


def law_range(
    law: NamedLaw, speeds: Float[Array, " v"], loads: Float[Array, " l"], width: float
) -> tuple[float, Float[Array, " v"]]:
    """Largest torque of a law, and the least power that it takes at each speed, over angles and loads.

    Args:
        law: Fitted.
        speeds: Speeds that are looked at [rad/s].
        loads: Loads that are looked at [N m].
        width: Of the turn of the joint's dry friction [rad/s].
    """
    angles = np.linspace(0.0, 2.0 * np.pi / law.shape["order"], 25)[:-1] if "order" in law.shape else np.zeros(1)
    v, angle, load = (part.reshape(-1) for part in np.meshgrid(speeds, angles, loads, indexing="ij"))
    slip = np.tanh(v / width) if width > 0.0 else np.sign(v)
    torque = law.torque(JointStates(angle, v, load, slip))
    return float(np.abs(torque).max()), (torque * v).reshape(len(speeds), -1).min(axis=1)
