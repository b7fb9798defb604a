"""Laws that no catalogue lists: causes that a diagnosis has to refuse to name. Never imported by it.

Cable drag, velocity-product drag and brake drag act here as torques in the loop; the sloshing load is a body
(`mjcf.Slosh`), the skidding friction a level of the bristles (`friction.FrictionLaw.skid`), and the supply's sag a
reading of the drive (`sensing.Sensing.sag`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from ident.arrays import Array


class OutsideLaw(NamedTuple):
    """Torques outside the catalogue on each of n joints; arrays of shape (n,).

    Attributes:
        cable: Drag of a cable that bears on the joint in a band of angles [N m].
        cable_other, cable_share: The joint that moves the band, and by how much.
        cable_centre, cable_width: The band's centre and half width [rad].
        product, product_other: Drag per product of two joints' speeds [N m s²/rad²], the other joint.
        brake, brake_decay: Drag of a brake that lets go late [N m], its decay time [s].
    """

    cable: Array
    cable_other: Array
    cable_share: Array
    cable_centre: Array
    cable_width: Array
    product: Array
    product_other: Array
    brake: Array
    brake_decay: Array


def nothing_outside(n: int) -> OutsideLaw:
    """No torque outside the catalogue."""
    zero = np.zeros(n)
    return OutsideLaw(
        cable=zero.copy(),
        cable_other=np.zeros(n, dtype=np.int64),
        cable_share=np.full(n, 0.7),
        cable_centre=zero.copy(),
        cable_width=np.full(n, 0.5),
        product=zero.copy(),
        product_other=np.zeros(n, dtype=np.int64),
        brake=zero.copy(),
        brake_decay=np.full(n, 1.0),
    )


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
