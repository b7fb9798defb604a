"""Bodies, gravity and angles that are not where the model has them: torque on all joints, together.

A payload hangs under the gravity and at the angles that are there, so that these effects are one change of the arm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.laws.chain import Array, rigid_torque, rotation_about
from ident.laws.motion import MovingArm
from ident.laws.sensing import Effect

BODIES = ("payload", "link_inertial_error", "gravity_misalignment", "encoder_offset")


def changed_arm(effects: Sequence[Effect], m: MovingArm) -> Array:
    """Rigid torque of the arm as it is, less that of the model [N m]."""
    q, links, gravity = m.q.copy(), m.arm.links.copy(), m.arm.gravity
    for name, joint, p in effects:
        if name == "payload":
            links[-1] += payload_parameters(p)
        elif name == "link_inertial_error":
            links[joint] += link_change(m.arm.links[joint], p)
        elif name == "gravity_misalignment":
            gravity = turned_gravity(gravity, p)
        elif name == "encoder_offset":
            q[:, joint] += p["offset_rad"]
    return rigid_torque(m.arm, q, m.dq, m.ddq, gravity, links) - m.rigid


def point_mass(centre: Array) -> Array:
    """Ten inertial numbers of a unit point mass."""
    return np.concatenate([[1.0], centre, _six(centre @ centre * np.eye(3) - np.outer(centre, centre))])


def moment_change(centre: Array) -> Array:
    """Change of the ten numbers per change of the first moment, for a body that is shifted, shape (10, 3)."""
    columns = []
    for axis in np.eye(3):
        inertia = 2.0 * (centre @ axis) * np.eye(3) - np.outer(centre, axis) - np.outer(axis, centre)
        columns.append(np.concatenate([[0.0], axis, _six(inertia)]))
    return np.stack(columns, axis=1)


def _six(inertia: Array) -> Array:
    """Entries xx, xy, yy, xz, yz, zz of an inertia matrix."""
    return inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]


def payload_parameters(p: dict[str, float]) -> Array:
    """Ten numbers of a point mass at the payload's centre."""
    return p["mass_kg"] * point_mass(np.array([p[f"com_{axis}_m"] for axis in "xyz"]))


def link_change(link: Array, p: dict[str, float]) -> Array:
    """Change of a link's ten numbers: more of its own density, or a body at a place, then a shift of its first moment.

    What the parameters leave open, the second moments, follows as in the diagnosis: they grow with the mass, and with
    the shift of the first moment as those of a body near the link's centre or that place.
    """
    mass = link[0]
    centre, density = (link[1:4] / mass, link / mass) if mass > 0.0 else (np.zeros(3), np.eye(10)[0])
    if "x_m" in p:
        centre = np.array([p[f"{axis}_m"] for axis in "xyz"])
        density = point_mass(centre)
    shift = np.array([p[f"moment_change_{axis}_kgm"] for axis in "xyz"]) - p["mass_change_kg"] * centre
    return p["mass_change_kg"] * density + moment_change(centre) @ shift


def turned_gravity(gravity: Array, p: dict[str, float]) -> Array:
    """Gravity seen from a base that is turned by small angles about its own x and y axes [m/s²]."""
    tilt = np.array([p["tilt_x_rad"], p["tilt_y_rad"], 0.0])
    angle = float(np.linalg.norm(tilt))
    return gravity if angle == 0.0 else rotation_about(tilt / angle, np.array([-angle]))[0] @ gravity
