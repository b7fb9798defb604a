"""What `ident close` tells of each arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.closed_loop.loop import Closed, Round
from ident.results import Result

SCHEMA = "ident.close/1"
# Models beside the closed one, and their keys in the record.
RIVALS = ("tuned", "net", "randomised")


@dataclass(frozen=True, eq=False)
class ArmClosed:
    """One arm and how far it came.

    Attributes:
        seed: Of the arm; None for a real one.
        effects: What was wrong with it, ID:JOINT:SIZE; empty where nobody knows.
        loop: How the loop ended.
        heldout: Gap of each model on motions that served nothing else [noise floors]; empty for a real arm.
        tracking: Tracking error of one controller designed with each model [rad]; empty for a real arm.
        patch: Folder of the patch; empty where no effect was named.
    """

    seed: int | None
    effects: tuple[str, ...]
    loop: Closed
    heldout: Mapping[str, float]
    tracking: Mapping[str, float]
    patch: str = ""

    def to_dict(self) -> dict[str, Any]:
        loop, joints = self.loop, list(self.loop.record["joints"])
        found = {
            "seed": self.seed,
            "robot": loop.record["robot"],
            "joints": joints,
            "effects": list(self.effects),
            "closed": loop.closed,
            "reason": loop.reason,
            "minutes": loop.minutes,
            "rounds": len(loop.rounds),
            "by_round": [_round_record(one, joints) for one in loop.rounds],
            "named": [f"{one['effect']} {', '.join(one['joints'])}" for one in loop.record["findings"]],
            "gap_floors_before": loop.before.together,
            "gap_floors_after": loop.after.together,
            "gap_floors_by_joint": dict(zip(joints, map(float, loop.after.joints), strict=True)),
            "heldout_floors": dict(self.heldout),
            "patch": self.patch,
        }
        if self.tracking:
            found |= {"tracking_before_rad": self.tracking["urdf"], "tracking_after_rad": self.tracking["closed"]}
            found |= {f"{name}_after_rad": self.tracking[name] for name in RIVALS if name in self.tracking}
        return found


def _round_record(one: Round, joints: Sequence[str]) -> dict[str, Any]:
    gap = None if one.gap is None else dict(zip(joints, map(float, one.gap.joints), strict=True))
    upper = None if one.gap is None else one.gap.upper
    return {
        "minutes": one.minutes,
        "gap_floors": gap,
        "gap_upper": upper,
        "verdict": one.verdict,
        "named": list(one.named),
    }


@dataclass(frozen=True, eq=False)
class Closing(Result):
    """All arms.

    Attributes:
        arms: Each of them.
    """

    arms: tuple[ArmClosed, ...]

    def to_dict(self) -> dict[str, Any]:
        arms = [one.to_dict() for one in self.arms]
        return {"schema": SCHEMA, "arms": arms, "provenance": self.provenance.to_dict()}

    def summary(self) -> str:
        """One line an arm, and the medians where there are several."""
        lines = [tell_arm(one) for one in self.arms]
        if len(self.arms) > 1:
            lines.append(tell_all(self.arms))
        return "\n".join(lines)


def tell_arm(one: ArmClosed) -> str:
    """One arm in a line."""
    loop = one.loop
    end = "closed" if loop.closed else f"not closed ({loop.reason})"
    who = "arm" if one.seed is None else f"arm {one.seed}"
    line = f"{who}: {end} after {loop.minutes:.1f} min of motion in {len(loop.rounds)} rounds; torque gap "
    line += f"{loop.before.together:.1f} -> {loop.after.together:.2f} x the noise"
    if one.tracking:
        before, after = (1e3 * one.tracking[name] for name in ("urdf", "closed"))
        line += f"; the same controller misses by {before:.1f} -> {after:.2f} mrad"
    return line


def tell_all(arms: Sequence[ArmClosed]) -> str:
    """Medians and worst of several arms."""
    minutes = [one.loop.minutes for one in arms]
    after = [one.loop.after.together for one in arms]
    closed = sum(one.loop.closed for one in arms)
    line = f"{closed} of {len(arms)} closed; median {np.median(minutes):.1f} min (most {max(minutes):.1f}), "
    return line + f"gap {np.median(after):.2f} x the noise (largest {max(after):.2f})"
