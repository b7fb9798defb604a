"""Bodies, gravity and angles that are not where the model has them: torque on all joints, together.

A payload hangs under the gravity and at the angles that are there, so that these effects are one change of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence

from ident.export.standalone.chain import Array, link_change, payload_parameters, rigid_torque, turned_gravity
from ident.export.standalone.log import Effect
from ident.export.standalone.motion import MovingArm

MASSES = ("payload", "link_inertial_error", "gravity_misalignment", "encoder_offset")


def changed_arm(effects: Sequence[Effect], m: MovingArm) -> Array:
    """Rigid torque of the arm as it is, less that of the model [N m]."""
    q, links, gravity = m.q.copy(), m.arm.links.copy(), m.arm.gravity
    for name, joint, figures in effects:
        if name == "payload":
            links[-1] += payload_parameters(figures)
        elif name == "link_inertial_error":
            links[joint] += link_change(m.arm.links[joint], figures)
        elif name == "gravity_misalignment":
            gravity = turned_gravity(gravity, figures)
        elif name == "encoder_offset":
            q[:, joint] += figures["offset_rad"]
    return rigid_torque(m.arm, q, m.dq, m.ddq, gravity, links) - m.rigid
