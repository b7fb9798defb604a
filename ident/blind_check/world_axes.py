"""What the world of a case was like, in the properties by which scores are told, and what it makes true of the arm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

# Beyond these a URDF is wrong rather than imprecise: that links weigh something else is then true [1], [m].
WRONG_LINK_ERROR, WRONG_COM_M = 0.08, 0.008
# Names that are true of an arm whose URDF is wrong, whatever else was hidden in it.
EXCUSED_BY_URDF = ("link_inertial_error", "payload")
DECADES = ("encoder_noise_rad",)
NUMBERS = (
    *DECADES,
    "rate_hz",
    "run_spread",
    "friction_drift",
    "torque_noise",
    "jitter",
    "lost",
    "bandwidth_hz",
    "friction_scale",
    "rotor_scale",
    "runs",
    "duration_s",
    "link_error",
)
WORDS = ("world", "robot", "velocity", "encoder_at", "feed_forward", "reference")


def world_axes(world: Mapping[str, Any]) -> dict[str, float | str]:
    """What cases are sorted by; empty without a world."""
    if not world:
        return {}
    axes = {name: world[name] for name in (*NUMBERS, *WORDS) if name in world}
    counts = 2.0 ** world["encoder_bits"] * (100.0 if world["encoder_at"] == "motor" else 1.0)
    rounding = 2.0 * np.pi / counts / np.sqrt(12.0)
    own = {"encoder_noise_rad": float(np.hypot(world["encoder_noise_rad"], rounding)), "world": world["name"]}
    return {**axes, **own, "run_spread": world["friction_spread"]}


def urdf_is_wrong(world: Mapping[str, Any]) -> bool:
    """Whether links of a world's arms weigh something else than any tolerance allows."""
    if not world:
        return False
    return bool(world["link_error"] > WRONG_LINK_ERROR or world["com_error_m"] > WRONG_COM_M or world["copied_link"])
