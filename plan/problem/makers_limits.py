"""Limits that makers publish for their arms.

Of acceleration and jerk, for which a URDF has no place, and of speed.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.robot.arm import ArmModel

TABLE = Path(__file__).with_suffix(".toml")


@dataclass(frozen=True, eq=False)
class MakersLimits:
    """What a maker says of an arm."""

    source: str  # where
    speed: Float[Array, " n"] | None  # of each joint [rad/s]; None where it is the URDF's
    # Of each joint [rad/s²]; None where the maker publishes none.
    acceleration: Float[Array, " n"] | None
    jerk: Float[Array, " n"] | None  # of each joint [rad/s³]; None likewise
    # Whether the arm's controller stops beyond the last two; else they are advice, and limit
    # nothing.
    binding: bool


def find_makers_limits(arm: ArmModel) -> MakersLimits | None:
    """The row of the table for an arm, by name or file, and number of joints.

    None for one unknown there.
    """
    names = (arm.name, "" if arm.source is None else arm.source.stem)
    for row in tomllib.loads(TABLE.read_text(encoding="utf-8"))["arm"]:
        if row["joints"] == arm.n and any(
            re.fullmatch(row["name"], name.lower()) for name in names
        ):
            return MakersLimits(
                row["source"],
                _limits(row, "speed_rad_s"),
                _limits(row, "acceleration_rad_s2"),
                _limits(row, "jerk_rad_s3"),
                row["binding"],
            )
    return None


def _limits(row: Mapping[str, Any], key: str) -> Array | None:
    """A limit of each joint; None where the maker says nothing."""
    return np.array(row[key]) if key in row else None


def say_limits(
    makers: MakersLimits | None, asked: bool, acceleration: bool, jerk: bool
) -> tuple[str, ...]:
    """What results say of the limits that no URDF has: whose they are, or that they are missing.

    Args:
        makers: What the maker says; None where that is not known here.
        asked: Whether the task takes the maker's limits.
        acceleration, jerk: Whether there is such a limit, the task's or the maker's.
    """
    said = []
    if makers is not None and (makers.binding or makers.speed is not None):
        taken = "kept where the task gives none" if asked else "not kept, as the task asks"
        said.append(f"limits by the maker ({makers.source}): {taken}")
    missing = [
        name for name, known in (("acceleration", acceleration), ("jerk", jerk)) if not known
    ]
    if missing:
        advice = "" if makers is None or said or makers.binding else f"; {makers.source}"
        keys = ", ".join(f"limits.{name}_deg_s{3 if name == 'jerk' else 2}" for name in missing)
        what = f"no limit of {' and '.join(missing)} ({keys})"
        said.append(f"{what}: the motion may ask for more than the arm can do{advice}")
    return tuple(said)
