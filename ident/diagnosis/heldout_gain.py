"""What a named effect explains on runs that the fit never saw: of a diagnosis and of a comparison alike."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.diagnosis.regression.design import Group
from ident.diagnosis.selection.name_probability import Estimate
from ident.robot.arm import ArmModel

# Units of a joint that turns, longest first, and those of one that slides.
LINEAR_UNITS = {
    "N m s/rad": "N s/m",
    "N m/rad": "N/m",
    "N m": "N",
    "kg m²": "kg",
    "mrad": "mm",
    "rad/s": "m/s",
    "rad": "m",
}
# Stands for the joint until units are settled.
JOINT = "\0"


@dataclass(frozen=True, eq=False)
class ReportedEffect:
    """An effect with what it explains."""

    estimate: Estimate  # what it is, its parameters, its rivals
    joints: tuple[str, ...]  # where it shows
    rms_before: dict[str, float]  # error on held-out runs without and with it, by joint [N m]
    rms_after: dict[str, float]
    shrink: float  # share of what lay above the noise that it closes there
    slides: bool = field(default=False, kw_only=True)  # whether its joint slides: of forces and metres then
    # What an action rests on that nobody has measured; empty where there is none.
    caveat: str = field(default="", kw_only=True)

    @property
    def effect(self) -> str:
        return self.estimate.group.effect.id

    @property
    def closed(self) -> float:
        """Mean square that it closes, its joints together [N² m²]."""
        return sum(self.rms_before[name] ** 2 - self.rms_after[name] ** 2 for name in self.rms_before)

    @property
    def gain(self) -> float:
        """Root mean square of the torque that it explains, its joints together [N m]."""
        return float(np.sqrt(max(self.closed, 0.0)))

    @property
    def action(self) -> str:
        """What a person at the cell can do about it."""
        return self.action_at(", ".join(self.joints)) + self.caveat

    def action_at(self, where: str) -> str:
        """The same of joints in these words."""
        sentence = self.estimate.refined.effect.action(JOINT, self.estimate.parameters)
        return (in_linear_units(sentence) if self.slides else sentence).replace(JOINT, where)

    def shared_record(self) -> dict[str, Any]:
        """What any record says of it first."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "probability": self.estimate.probability,
            "class": list(self.estimate.rivals),
            "class_probability": self.estimate.class_probability,
            "class_shares": self.estimate.shares,
            "action": self.action,
            "parameters": {name: value.to_dict() for name, value in self.estimate.parameters.items()},
        }


def slides(group: Group, arm: ArmModel) -> bool:
    """Whether an effect is of one joint, and that slides."""
    return group.effect.scope == "joint" and bool(arm.sliding_joints[group.joint])


def in_linear_units(sentence: str) -> str:
    """A sentence about a joint that turns, with the units of one that slides."""
    units = "|".join(re.escape(unit) for unit in LINEAR_UNITS)
    return re.sub(rf"(?<!\w)({units})(?!\w)", lambda found: LINEAR_UNITS[found[0]], sentence)


def measure_shrink(old: Array, new: Array, floor: Array) -> float:
    """Share of the reducible held-out mean square that is closed.

    Args:
        old, new: Root mean square before and after, by joint [N m].
        floor: What no model goes below [N m].
    """
    reducible = float(np.sum(np.maximum(old**2 - floor**2, 0.0)))
    return float(np.clip(np.sum(old**2 - new**2) / max(reducible, 1e-12), -1.0, 1.0))
