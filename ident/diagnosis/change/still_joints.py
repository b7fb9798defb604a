"""Joints that stand still in one of two sets of recordings: nothing is told of them, the rest of the arm is compared.

At rest dry friction holds any torque up to its level, so of a joint's own torque nothing that one set lacks can be held
against the other. Its rows are left out of both: in one set alone, whatever the model lacks there would look like a
change. The joint's angle stays part of the motion, and what shows at other joints is asked for as ever.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.diagnosis.regression.design import NotTestable
from ident.effects.base import Effect
from ident.effects.typical_sizes import LEAST_TRAVEL
from ident.model.loss import LEAST_MOVING
from ident.motion.motion import Motion

WHEN = {(True, False): "before", (False, True): "after", (True, True): "before and after"}


@dataclass(frozen=True)
class StillJoint:
    """A joint of whose torque nothing is told.

    Attributes:
        joint: Its number.
        name: Its name.
        when: `before`, `after`, or `before and after`.
        crept: Whether it moved, but no faster than its encoder's noise.
    """

    joint: int
    name: str
    when: str
    crept: bool

    @property
    def reason(self) -> str:
        """Why, and what would tell."""
        how = "moved no faster than its encoder's noise" if self.crept else "stood still"
        return f"it {how} {self.when}; record runs that move it faster"

    def to_dict(self) -> dict[str, str]:
        return {"joint": self.name, "when": self.when, "reason": self.reason}


def find_still_joints(before: Sequence[Motion], after: Sequence[Motion]) -> tuple[StillJoint, ...]:
    """Joints that hardly move in one of two sets of runs."""
    still = np.array([sum(motion.moving.sum(axis=0) for motion in side) < LEAST_MOVING for side in (before, after)])
    found = []
    for j in np.flatnonzero(still.any(axis=0)):
        sides = [side for side, at_rest in zip((before, after), still[:, j], strict=True) if at_rest]
        travel = min(_travel(side, int(j)) for side in sides)
        when = WHEN[bool(still[0, j]), bool(still[1, j])]
        found.append(StillJoint(int(j), before[0].joints[j], when, travel >= LEAST_TRAVEL))
    return tuple(found)


def _travel(side: Sequence[Motion], joint: int) -> float:
    """How far a joint goes in a set of runs [rad or m]."""
    q = np.concatenate([motion.q[:, joint] for motion in side])
    return float(q.max() - q.min())


def silent_of(still: Sequence[StillJoint], asked: Sequence[Effect]) -> list[NotTestable]:
    """Changes that the own torque of joints at rest would have to show."""
    own = [effect for effect in asked if effect.scope == "joint" and effect.rows == "own"]
    return [NotTestable(effect, one.joint, one.reason) for one in still for effect in own]
