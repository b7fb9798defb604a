"""What is told of a position-only arm, in words and as a record."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.results import Result
from ident.servos.servo_fit import ServoJoint

SCHEMA = "ident.servo/1"
# Causes of a dead band that goal and position can't part, whatever the motion.
SAME_AS_DEAD_BAND = ("dead_band", "dry_friction", "backlash")
PARTED_BY = (
    "hold the joint by hand at standstill and turn it gently: play gives way without force, the controller's dead band "
    "without a change of current, dry friction with force"
)
WORDS = {
    "delay_s": "goals act {0:.0f} ms late [{1:.0f}, {2:.0f}]",
    "lag_s": "the joint trails by {0:.0f} ms of its speed [{1:.0f}, {2:.0f}]",
    "total_lag_s": "all in all {0:.0f} ms late [{1:.0f}, {2:.0f}]",
    "dead_band_rad": "it stops {0:.2f} mrad short of the goal, on the side that it comes from [{1:.2f}, {2:.2f}]",
    "zero_rad": "its zero is off by {0:.2f} mrad [{1:.2f}, {2:.2f}]",
    "droop_rad_Nm": "it droops by {0:.2f} mrad a newton metre [{1:.2f}, {2:.2f}]",
}


@dataclass(frozen=True, eq=False)
class ServoArm(Result):
    """All joints of a position-only arm.

    Attributes:
        robot: Its name, or of the session where nobody knows it.
        joints: What is told of each.
    """

    robot: str
    joints: tuple[ServoJoint, ...]

    def to_dict(self) -> dict[str, Any]:
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": {one.joint: _record(one) for one in self.joints},
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """A few lines a joint."""
        lines = []
        for one in self.joints:
            lines.append(f"{one.joint}: {_errors(one)}")
            for figure in (figure for figure in one.figures if figure.name in WORDS):
                ends = (1e3 * value for value in (figure.value, figure.low, figure.high))
                lines.append("  " + WORDS[figure.name].format(*ends))
            if any(figure.name == "dead_band_rad" for figure in one.figures):
                lines.append(f"    dead band, dry friction or backlash: {PARTED_BY}")
            lines += [f"  not told: {name}: {reason}" for name, reason in one.untold.items()]
        return "\n".join(lines)


def _errors(one: ServoJoint) -> str:
    if np.isnan(one.rms_before):
        return "nothing can be told"
    return f"follows within {1e3 * one.rms_before:.1f} mrad; {1e3 * one.rms_after:.2f} mrad of it are not explained"


def _record(one: ServoJoint) -> dict[str, Any]:
    told = {figure.name: figure.to_dict() for figure in one.figures}
    known = not np.isnan(one.rms_before)
    return {
        "figures": told,
        "class": {"dead_band_rad": list(SAME_AS_DEAD_BAND)} if "dead_band_rad" in told else {},
        "not_told": dict(one.untold),
        "heldout": {"rms_before_rad": one.rms_before, "rms_after_rad": one.rms_after} if known else None,
    }
