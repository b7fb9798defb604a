"""Where the three-joint lumped model breaks: its figures against the exact reduction, wrist posture by posture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel
from ident.robot.lumped import build_lumped_arm

# Wrist postures of the vendor's motion-planning set-up, joints 4 to 6 [deg].
POSTURES = {"zero": (0, 0, 0), "ready 1": (0, 90, 0), "ready 2": (-90, 90, 0), "ready 3": (90, -90, 0)}


@dataclass(frozen=True)
class Breakage:
    """What lumping gets wrong in one wrist posture, the largest over joints 2 and 3.

    Attributes:
        posture: Name of the wrist posture.
        gravity: Gravity torque left out, joints 2 and 3 [N m].
        m11_ratio: Exact over lumped M11.
        m11_at_deg: Joints 2 and 3 where that is so [deg].
        m12, m13: Couplings that the lumped model puts to zero [kg m²].
    """

    posture: str
    gravity: float
    m11_ratio: float
    m11_at_deg: tuple[float, float]
    m12: float
    m13: float


def mass_matrix_row(arm: ArmModel, q: Float[Array, "T n"], joint: int) -> Float[Array, "T n"]:
    """Torques that accelerate one joint by 1 rad/s² from rest, gravity taken off [kg m²]."""
    unit = np.zeros_like(q)
    unit[:, joint] = 1.0
    return arm.inverse_dynamics(q, np.zeros_like(q), unit) - arm.gravity(q)


def lumping_table(arm: ArmModel, step_deg: float = 5.0) -> list[Breakage]:
    """One row a wrist posture, over a grid of joints 2 and 3 within their limits."""
    two, three = np.meshgrid(np.arange(-180, 181, step_deg), np.arange(-155, 156, step_deg))
    q = np.deg2rad(np.stack([np.zeros(two.size), two.ravel(), three.ravel()], axis=1))
    lumped, rows = build_lumped_arm(arm), []
    for name, wrist in POSTURES.items():
        exact = arm.locked(arm.joint_names[3:], np.deg2rad(wrist))
        first = mass_matrix_row(exact, q, 0)
        ratio = first[:, 0] / mass_matrix_row(lumped, q, 0)[:, 0]
        worst = int(np.argmax(ratio))
        rows.append(
            Breakage(
                posture=name,
                gravity=float(np.abs(exact.gravity(q) - lumped.gravity(q)).max()),
                m11_ratio=float(ratio[worst]),
                m11_at_deg=(float(two.ravel()[worst]), float(three.ravel()[worst])),
                m12=float(np.abs(first[:, 1]).max()),
                m13=float(np.abs(first[:, 2]).max()),
            )
        )
    return rows
