"""Limits of an identified arm as ros2_control reads them: what the URDF says, and the acceleration that torque allows.

Source: ros2_control, joint_limits, `declare_parameters` and `get_joint_limits` (keys, types, shape of the file).
"""

from __future__ import annotations

import json

import numpy as np

from ident.arrays import Array, Float
from ident.export.identified import IdentifiedArm
from ident.laws.motion import Losses
from ident.robot.arm import ArmModel

# Poses over which the least acceleration is sought, at which a joint alone starts from rest.
POSES = 400
# A joint with less or more than this has no limit in its URDF [rad], [rad/s], [N m].
UNLIMITED = 1e6


def write_limits(identified: IdentifiedArm) -> str:
    """YAML text: a file of parameters for any node, `joint_limits` with one table a joint."""
    arm, losses = identified.whole, identified.losses
    acceleration = allowed_acceleration(arm, losses)
    lines = [
        "# Positions, speeds and efforts are the URDF's. The acceleration is what the identified arm's effort limit",
        "# leaves at its worst pose for this joint alone, from rest, after gravity and dry friction.",
        "# Start a node with --params-file; MoveIt and URDF macros take what lies below ros__parameters.",
        "/**:",
        "  ros__parameters:",
        "    joint_limits:",
    ]
    for j, name in enumerate(arm.joint_names):
        low, high = float(arm.lower[j]), float(arm.upper[j])
        figures: list[tuple[str, tuple[str, ...], tuple[float, ...]]] = [
            ("position", ("min_position", "max_position"), (low, high)),
            ("velocity", ("max_velocity",), (float(arm.velocity_limit[j]),)),
            ("acceleration", ("max_acceleration",), (float(acceleration[j]),)),
            ("effort", ("max_effort",), (float(arm.effort_limit[j]),)),
        ]
        # A JSON string is a YAML string, whatever a joint is called.
        lines.append(f"      {json.dumps(name)}:")
        for what, keys, values in figures:
            told = all(abs(value) < UNLIMITED for value in values) and (what == "position" or values[0] > 0.0)
            lines.append(f"        has_{what}_limits: {str(told).lower()}")
            lines += [f"        {key}: {value!r}" for key, value in zip(keys, values, strict=True) if told]
    return "\n".join(lines) + "\n"


def allowed_acceleration(arm: ArmModel, losses: Losses) -> Float[Array, " n"]:
    """Acceleration that every pose allows a joint that starts alone [rad/s²]; infinite without an effort limit."""
    rng = np.random.default_rng(0)
    q = rng.uniform(np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi), (POSES, arm.n))
    gravity, rest = arm.gravity(q), np.zeros_like(q)
    found = np.empty(arm.n)
    for j in range(arm.n):
        unit = np.zeros_like(q)
        unit[:, j] = 1.0
        inertia = (arm.inverse_dynamics(q, rest, unit) - gravity)[:, j] + losses.motor_inertia[j]
        spare = float(arm.effort_limit[j]) - np.abs(gravity[:, j]) - losses.coulomb[j]
        found[j] = np.min(np.maximum(spare, 0.0) / inertia) if 0.0 < arm.effort_limit[j] < UNLIMITED else np.inf
    return found
