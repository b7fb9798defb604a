"""Use of each joint's samples in a comparison, and joints that stand still in one of two sets.

At rest dry friction balances any torque up to its level: of such a joint only torque beyond that is
evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.effects.session_context import LEAST_TRAVEL
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.regression.dwells import find_holds, find_turns

LEFT_OUT = "ends of runs and of holds, which filters blur"
WHEN = {(True, False): "before", (False, True): "after", (True, True): "before and after"}


@dataclass(frozen=True)
class StaticJoint:
    """A joint that stands still in one of the sets, so that only torque beyond its static friction
    is evidence.
    """

    joint: int  # its index
    name: str  # its name
    when: str  # `before`, `after`, or `before and after`
    crept: bool  # whether it moved, but no faster than its encoder's noise

    @property
    def reason(self) -> str:
        """The reason as a sentence, with the remedy."""
        how = "moved no faster than its encoder's noise" if self.crept else "stood still"
        return f"it {how} {self.when}; record runs that move it faster"

    def to_dict(self) -> dict[str, str]:
        """Its record, for JSON."""
        return {"joint": self.name, "when": self.when, "reason": self.reason}


@dataclass(frozen=True)
class SamplesUsed:
    """Use of a joint's samples in a comparison, as shares of all samples."""

    joint: str  # its name
    in_motion: float  # samples in steady motion: each is a row
    at_rest: float  # samples in holds: each hold is one observation within static friction
    holds: int  # number of holds
    # Samples near a stop or a reversal: each such stretch is one observation within static
    # friction.
    turning: float

    @property
    def left_out(self) -> float:
        """Share of the samples that are not used."""
        return max(0.0, 1.0 - self.in_motion - self.at_rest - self.turning)

    def to_dict(self) -> dict[str, Any]:
        """Its record, for JSON."""
        return {**vars(self), "left_out": self.left_out, "why": LEFT_OUT}


def count_samples(motions: Sequence[Motion]) -> tuple[SamplesUsed, ...]:
    """Use of each joint's samples in a comparison.

    Args:
        motions: The runs of both sets.
    """
    total = sum(motion.filtered_length for motion in motions)
    moving = sum(motion.settled.sum(axis=0) for motion in motions) / total
    found = []
    for j, name in enumerate(motions[0].joints):
        holds, turns = (
            [one for motion in motions for one in find(motion)[j]]
            for find in (find_holds, find_turns)
        )
        rest, turning = (
            sum(one.stop - one.start for one in some) / total for some in (holds, turns)
        )
        found.append(SamplesUsed(name, float(moving[j]), rest, len(holds), turning))
    return tuple(found)


def find_static_joints(
    before: Sequence[Motion], after: Sequence[Motion]
) -> tuple[StaticJoint, ...]:
    """Joints that hardly move in one of two sets of runs."""
    still = np.array(
        [
            sum(motion.moving.sum(axis=0) for motion in side) < LEAST_MOVING
            for side in (before, after)
        ]
    )
    found = []
    for j in np.flatnonzero(still.any(axis=0)):
        sides = [
            side for side, at_rest in zip((before, after), still[:, j], strict=True) if at_rest
        ]
        travel = min(
            float(np.ptp(np.concatenate([motion.q[:, j] for motion in side]))) for side in sides
        )
        when = WHEN[bool(still[0, j]), bool(still[1, j])]
        found.append(StaticJoint(int(j), before[0].joints[j], when, travel >= LEAST_TRAVEL))
    return tuple(found)
