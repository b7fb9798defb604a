"""What an arm is, whatever it is called: two files of one arm have one content, another arm of its name has not."""

from __future__ import annotations

import hashlib

import numpy as np

from ident.robot.arm import ArmModel

# Descriptions that passed through xacro round their numbers: places that count.
DECIMALS = 9


def content_of(arm: ArmModel) -> str:
    """SHA-256 of an arm's joints, lengths, axes and inertias."""
    digest = hashlib.sha256("\0".join(arm.joint_names).encode())
    for part in (*arm.chain[:4], arm.inertial_parameters):
        digest.update((np.round(np.asarray(part, dtype=float), DECIMALS) + 0.0).tobytes())
    return digest.hexdigest()


def are_same(arm: ArmModel, other: ArmModel) -> bool:
    """Whether two arms are one where they have joints in common."""
    common = [name for name in arm.joint_names if name in other.joint_names]
    return bool(common) and content_of(arm.keeping(common)) == content_of(other.keeping(common))
