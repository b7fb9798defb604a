"""How far a URDF's inertias may be off, link by link."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.robot.arm import ArmModel

# How far a URDF's inertia may be off before we look for another cause, as a share of the link's own
# scale.
PRIOR_SHARE = {"base": 2.0, "consistent": 0.3}
# Links lighter and shorter than these shares of the arm's moving mass and reach have no scale of
# their own.
LEAST_MASS_SHARE = 0.01
LEAST_LENGTH_SHARE = 0.054


def parameter_scale(arm: ArmModel) -> Float[Array, " 10n"]:
    """Natural size of each inertial number: mass, mass × length and mass × length² of its link."""
    links = arm.inertial_parameters.reshape(arm.n, 10)
    least_mass = max(LEAST_MASS_SHARE * float(links[:, 0].sum()), 1e-9)
    mass = np.maximum(links[:, 0], least_mass)
    lever = np.linalg.norm(links[:, 1:4], axis=1) / mass
    # The moments of inertia about three axes add up to twice the polar one.
    polar = np.maximum(links[:, 4] + links[:, 6] + links[:, 9], 0.0)
    radius = np.sqrt(polar / (2 * mass))
    placements = list(arm.model.jointPlacements)[2:]
    steps = [float(np.linalg.norm(place.translation)) for place in placements]
    reach = max(sum(steps) + float(lever.max()), 1e-6)
    length = np.maximum(np.maximum(lever, radius), LEAST_LENGTH_SHARE * reach)
    moments = np.repeat((mass * length)[:, None], 3, 1)
    inertias = np.repeat((mass * length**2)[:, None], 6, 1)
    scale = np.concatenate([mass[:, None], moments, inertias], 1)
    return freeze(scale.ravel())
