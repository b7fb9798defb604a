"""What follows from an arm: whether two are the same one, whatever they are called; the rated torque of its joints."""

from __future__ import annotations

import hashlib

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel

# Descriptions that passed through xacro round their numbers: places that count.
DECIMALS = 9


def content_of(arm: ArmModel) -> str:
    """SHA-256 of an arm's joints, lengths, axes and inertias."""
    digest = hashlib.sha256("\0".join(arm.joint_names).encode())
    for part in (arm.chain.rotations[:, 0], *arm.chain[1:4], arm.inertial_parameters):
        digest.update((np.round(np.asarray(part, dtype=float), DECIMALS) + 0.0).tobytes())
    return digest.hexdigest()


def are_same(arm: ArmModel, other: ArmModel) -> bool:
    """Whether two arms are one where they have joints in common."""
    common = [name for name in arm.joint_names if name in other.joint_names]
    return bool(common) and content_of(arm.keeping(common)) == content_of(other.keeping(common))


def rated_torque(arm: ArmModel) -> Float[Array, " n"]:
    """Rated torque of each joint [N m]; a URDF without limits is given one by its gravity torque."""
    limit = np.array(arm.effort_limit)
    if np.all((limit > 0.0) & (limit < 1e5)):
        return limit
    gravity = np.abs(arm.gravity(np.random.default_rng(0).uniform(-1.5, 1.5, (64, arm.n)))).max(axis=0)
    return np.where((limit > 0.0) & (limit < 1e5), limit, np.maximum(4.0 * gravity, 0.1 * gravity.max()))
