"""Rated torque of each joint: the URDF's limit, or what the arm's weight asks for."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel


def rated_torque(arm: ArmModel) -> Float[Array, " n"]:
    """Rated torque of each joint [N m]; a URDF without limits is given one by its gravity torque."""
    limit = np.array(arm.effort_limit)
    if np.all((limit > 0.0) & (limit < 1e5)):
        return limit
    gravity = np.abs(arm.gravity(np.random.default_rng(0).uniform(-1.5, 1.5, (64, arm.n)))).max(axis=0)
    return np.where((limit > 0.0) & (limit < 1e5), limit, np.maximum(4.0 * gravity, 0.1 * gravity.max()))
