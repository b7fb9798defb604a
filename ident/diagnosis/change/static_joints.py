"""Use of each joint's samples in a comparison, and joints that stand still in one of two sets.

At rest dry friction balances any torque up to its level: of such a joint only torque beyond that is
evidence.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Int
from ident.effects.session_context import LEAST_TRAVEL
from ident.model.linearisation import LEAST_MOVING
from ident.motion.motion import Motion
from ident.records import JsonRecord
from ident.regression.dwells import Hold, find_holds, find_turns

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
        """Its record for JSON: `joint` (its name), `when`, and `reason` as a sentence."""
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
        """Share of the samples, from 0 to 1, that are not used."""
        return max(0.0, 1.0 - self.in_motion - self.at_rest - self.turning)

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: its fields, `left_out` (a share) and `why`."""
        return {**vars(self), "left_out": self.left_out, "why": LEFT_OUT}


def count_samples(motions: Sequence[Motion]) -> tuple[SamplesUsed, ...]:
    """Use of each joint's samples in a comparison.

    Args:
        motions: The runs of both sets.
    """
    total = sum(motion.filtered_length for motion in motions)
    moving = sum(motion.settled.sum(axis=0) for motion in motions) / total
    holds_of_runs = [find_holds(motion) for motion in motions]
    turns_of_runs = [find_turns(motion) for motion in motions]
    used = []
    for j, name in enumerate(motions[0].joints):
        holds = _of_joint(holds_of_runs, j)
        at_rest = _samples(holds) / total
        turning = _samples(_of_joint(turns_of_runs, j)) / total
        used.append(SamplesUsed(name, float(moving[j]), at_rest, len(holds), turning))
    return tuple(used)


def _of_joint(runs: Sequence[Sequence[Sequence[Hold]]], joint: int) -> list[Hold]:
    """A joint's stretches in all runs."""
    stretches: list[Hold] = []
    for of_joints in runs:
        stretches += of_joints[joint]
    return stretches


def _samples(stretches: Sequence[Hold]) -> int:
    """Samples of some stretches together."""
    return sum(stretch.stop - stretch.start for stretch in stretches)


def find_static_joints(
    before: Sequence[Motion], after: Sequence[Motion]
) -> tuple[StaticJoint, ...]:
    """Joints that hardly move in one of two sets of runs, or in both."""
    sides = (before, after)
    still = np.array([_moving_samples(side) < LEAST_MOVING for side in sides])
    static = []
    for j in np.flatnonzero(still.any(axis=0)).tolist():
        at_rest = [side for side, is_still in zip(sides, still[:, j], strict=True) if is_still]
        travel = min(_travel(side, j) for side in at_rest)
        earlier, later = (bool(side) for side in still[:, j])
        when = WHEN[earlier, later]
        static.append(StaticJoint(j, before[0].joints[j], when, travel >= LEAST_TRAVEL))
    return tuple(static)


def _moving_samples(motions: Sequence[Motion]) -> Int[Array, " n"]:
    """Samples of some runs in which each joint surely moves."""
    return np.sum([motion.moving.sum(axis=0) for motion in motions], axis=0)


def _travel(motions: Sequence[Motion], joint: int) -> float:
    """How far a joint moves in all of some runs [rad]."""
    angles = np.concatenate([motion.q[:, joint] for motion in motions])
    return float(np.ptp(angles))
