"""A push from outside for a while: a force on a point of a link, smooth at its start and end.

MuJoCo carries it to the joints; no Jacobian is written down here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from ident.arrays import Array


class Contact(NamedTuple):
    """One push."""

    body: int  # MuJoCo's number of the link's body; 0 for none
    start: float  # begin and end, since the start of the run [s]
    end: float
    force: Array  # in the base frame [N], shape (3,)
    point: Array  # where it acts, in the link's frame [m], shape (3,)


def no_contact() -> Contact:
    return Contact(0, 0.0, 0.0, np.zeros(3), np.zeros(3))


@njit(cache=True)
def push(contact: Contact, elapsed: float, position: Array, rotation: Array, centre: Array, wrench: Array) -> None:
    """Writes the wrench of the push on its body, about the body's centre of mass, in place.

    Args:
        contact: The push.
        elapsed: Time since the start of the run [s].
        position, rotation, centre: MuJoCo's xpos, xmat and xipos.
        wrench: MuJoCo's xfrc_applied, force then moment.
    """
    b = contact.body
    wrench[b] = 0.0
    if elapsed <= contact.start or elapsed >= contact.end:
        return
    ramp = min(0.05, 0.25 * (contact.end - contact.start))
    edge = min(elapsed - contact.start, contact.end - elapsed) / ramp
    scale = 1.0 if edge >= 1.0 else 0.5 - 0.5 * np.cos(np.pi * edge)
    lever = np.zeros(3)
    for i in range(3):
        lever[i] = position[b, i] - centre[b, i]
        for k in range(3):
            lever[i] += rotation[b, 3 * i + k] * contact.point[k]
    force = scale * contact.force
    wrench[b, :3] = force
    wrench[b, 3] = lever[1] * force[2] - lever[2] * force[1]
    wrench[b, 4] = lever[2] * force[0] - lever[0] * force[2]
    wrench[b, 5] = lever[0] * force[1] - lever[1] * force[0]
