"""A reported effect with its gain on held-out runs.

Base of a diagnosis's findings and of a comparison's changes.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ident.arrays import Array
from ident.inference.conclusion import EVEN_ODDS
from ident.inference.estimate import Estimate
from ident.records import JsonRecord
from ident.regression.design import Group
from ident.robot.arm import ArmModel
from ident.units import in_linear_units

# Placeholder for the joint's name, which must not be mistaken for a unit.
JOINT = "\0"


@dataclass(frozen=True, eq=False)
class ReportedEffect:
    """An accepted effect with its gain on held-out runs."""

    estimate: Estimate  # parameters, probability and rivals
    joints: tuple[str, ...]  # names of the joints that it affects
    # Held-out error without it and with it, by joint [N m].
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    shrink: float  # share of the mean square above the noise that it closes at these joints
    # Confounded effects elsewhere, each with its joint ("" for the whole arm).
    elsewhere: tuple[tuple[str, str], ...] = field(default=(), kw_only=True)
    # Whether its joint is prismatic: units are N and m then.
    slides: bool = field(default=False, kw_only=True)
    # An unmeasured assumption of its action; "" if there is none.
    caveat: str = field(default="", kw_only=True)

    @property
    def effect(self) -> str:
        """Its id in the catalogue."""
        return self.estimate.group.effect.id

    @property
    def probability(self) -> float:
        """Probability that it is the cause, and none of the effects of its class."""
        return self.estimate.probability

    @property
    def class_probability(self) -> float:
        """Probability that one of the effects of its class is the cause."""
        return self.estimate.class_probability

    @property
    def rivals(self) -> tuple[str, ...]:
        """Its class: ids of the effects that the recordings can't tell from it, itself first."""
        return self.estimate.rivals

    @property
    def parameters(self) -> JsonRecord:
        """Its parameters with their 95 % intervals, by name."""
        return self.estimate.parameters

    @property
    def closed(self) -> float:
        """Mean square that it closes, summed over its joints [N² m²]."""
        closed = [before**2 - self.rms_after[name] ** 2 for name, before in self.rms_before.items()]
        return sum(closed)

    @property
    def gain(self) -> float:
        """Root of the mean square that it closes over its joints [N m]; 0 where it closes none."""
        return float(np.sqrt(max(self.closed, 0.0)))

    @property
    def action(self) -> str:
        """What a person at the cell can do about it, in a sentence, wherever it may be.

        Of an effect that is less likely than not it says so first.
        """
        where = ", ".join(self.joints)
        others = [joint for effect, joint in self.elsewhere if effect == self.effect]
        if others:
            of_a_joint = self.estimate.refined.effect.scope == "joint"
            where = " or ".join([*self.joints, *others] if of_a_joint else self.joints)
        action = f"{self.action_at(where)}{self.caveat}"
        sure = self.estimate.probability
        if sure < EVEN_ODDS:
            return f"only {100.0 * sure:.0f} % sure, so act on it if it shows again: {action}"
        return action

    def action_at(self, where: str) -> str:
        """The action as a sentence, with `where` in place of the joint's name."""
        sentence = self.estimate.refined.effect.action(JOINT, self.estimate.parameters)
        if self.slides:
            sentence = in_linear_units(sentence)
        return sentence.replace(JOINT, where)

    def shared_record(self) -> JsonRecord:
        """The entries that findings and changes have in common.

        Returns:
            `effect`, `joints`, `probability`, `class` (ids, its own first), `class_probability`,
            `class_shares` (by id), `elsewhere` (`effect` and `joint`, None for the whole arm),
            `action`, and `parameters` (intervals by name).
        """
        estimate = self.estimate
        elsewhere = []
        for effect, joint in self.elsewhere:
            elsewhere.append({"effect": effect, "joint": joint or None})
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "probability": estimate.probability,
            "class": list(estimate.rivals),
            "class_probability": estimate.class_probability,
            "class_shares": estimate.shares,
            "elsewhere": elsewhere,
            "action": self.action,
            "parameters": {name: value.to_dict() for name, value in estimate.parameters.items()},
        }


def slides(group: Group, arm: ArmModel) -> bool:
    """Whether an effect belongs to a single joint that is prismatic."""
    return group.effect.scope == "joint" and bool(arm.sliding_joints[group.joint])


def measure_shrink(old: Array, new: Array, floor: Array) -> float:
    """Share of the reducible held-out mean square that is closed, from −1 to 1.

    Args:
        old, new: Root mean square error before and after, by joint [N m].
        floor: Floor of the error, by joint [N m].
    """
    reducible = float(np.sum(np.maximum(old**2 - floor**2, 0.0)))
    closed = np.sum(old**2 - new**2)
    return float(np.clip(closed / max(reducible, 1e-12), -1.0, 1.0))
