"""Rotations as URDFs write them: about an axis, and by fixed-axis roll, pitch and yaw."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array, Float

# Cosine of a pitch below which roll and yaw turn about the same axis.
GIMBAL_LOCK = 1e-12


def rotation_about(axis: Float[Array, " 3"], angle: float) -> Float[Array, "3 3"]:
    """Rotation matrix by Rodrigues' formula.

    Args:
        axis: Of any length but zero.
        angle: To turn by [rad].
    """
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    sine = np.sin(angle) * cross
    versine = (1 - np.cos(angle)) * cross @ cross
    return np.asarray(np.eye(3) + sine + versine)


def rpy_to_matrix(rpy: Float[Array, " 3"]) -> Float[Array, "3 3"]:
    """Rotation matrix of URDF's roll, pitch and yaw [rad] about fixed axes: yaw · pitch · roll."""
    unit = np.eye(3)
    roll = rotation_about(unit[0], rpy[0])
    pitch = rotation_about(unit[1], rpy[1])
    yaw = rotation_about(unit[2], rpy[2])
    return np.asarray(yaw @ pitch @ roll)


def matrix_to_rpy(rotation: Float[Array, "3 3"]) -> Float[Array, " 3"]:
    """Inverse of `rpy_to_matrix` [rad]; in gimbal lock yaw is free, and zero."""
    cosine = np.hypot(rotation[0, 0], rotation[1, 0])
    pitch = np.arctan2(-rotation[2, 0], cosine)
    if cosine < GIMBAL_LOCK:
        roll = np.arctan2(-rotation[1, 2], rotation[1, 1])
        return np.array([roll, pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    yaw = np.arctan2(rotation[1, 0], rotation[0, 0])
    return np.array([roll, pitch, yaw])
