"""The loop on one arm, simulated or real, and what `ident close` reports of each."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ident.closed_loop.exciting import KindsExciter
from ident.closed_loop.loop import MOST_ROUNDS, Closed, Say, close_gap
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.write import write_patch
from ident.files import atomic_write
from ident.results import Result
from ident.robot.arm import ArmModel

SCHEMA = "ident.close/1"
# Effects of a simulated arm.
EFFECTS = 3
# Tracking errors of the models, and their keys in the record.
TRACKED = {
    "tracking_before_rad": "urdf",
    "tracking_after_rad": "closed",
    "tuned_after_rad": "tuned",
    "net_after_rad": "net",
    "randomised_after_rad": "randomised",
}


@dataclass(frozen=True, eq=False)
class Closing(Result):
    """All arms.

    Attributes:
        arms: The record of each (`ident.close/1`).
    """

    arms: tuple[dict[str, Any], ...]

    def to_dict(self) -> dict[str, Any]:
        return {"schema": SCHEMA, "arms": list(self.arms), "provenance": self.provenance.to_dict()}

    def summary(self) -> str:
        """One line an arm, and the medians where there are several."""
        lines = []
        for one in self.arms:
            end = "closed" if one["closed"] else f"not closed ({one['reason']})"
            who = "arm" if one["seed"] is None else f"arm {one['seed']}"
            line = f"{who}: {end} after {one['minutes']:.1f} min of motion in {one['rounds']} rounds; torque gap "
            line += f"{one['gap_floors_before']:.1f} -> {one['gap_floors_after']:.2f} x the noise"
            if "tracking_before_rad" in one:
                before, last = (1e3 * one[f"tracking_{when}_rad"] for when in ("before", "after"))
                line += f"; the same controller misses by {before:.1f} -> {last:.2f} mrad"
            lines.append(line)
        if len(self.arms) > 1:
            minutes, after = ([one[key] for one in self.arms] for key in ("minutes", "gap_floors_after"))
            closed = sum(one["closed"] for one in self.arms)
            line = f"{closed} of {len(lines)} closed; median {np.median(minutes):.1f} min (most {max(minutes):.1f}), "
            lines.append(f"{line}gap {np.median(after):.2f} x the noise (largest {max(after):.2f})")
        return "\n".join(lines)


def close_simulated(
    robot: str,
    seed: int,
    folder: Path,
    most: int = MOST_ROUNDS,
    effects: Sequence[str] | None = None,
    compared: bool = True,
    say: Say = lambda line: None,
) -> dict[str, Any]:
    """One simulated arm: the loop, then the rivals on motions that served nothing else.

    Args:
        robot: URDF path or name.
        seed: Of the arm, its effects, motions and noise.
        folder: For diagnosis and patch.
        most: Most rounds.
        effects: What is wrong with it, each ID:JOINT:SIZE; three at random if None.
        compared: Whether rivals are made from the same recordings, and a controller is tried with each.
        say: Called with a line for each round.

    Returns:
        Its record, without what is only known of simulated arms where nothing was compared.
    """
    from ident.closed_loop.rivals import compare_models
    from ident.closed_loop.simulated import SimulatedArm, draw_effects
    from ident.simulation.simulate import SimulationOptions

    arm = ArmModel.load(robot)
    drawn = effects if effects is not None else draw_effects(arm.joint_names, EFFECTS, np.random.default_rng([seed, 3]))
    hidden = SimulatedArm(SimulationOptions(robot=robot, seed=seed, effects=tuple(drawn)))
    loop = close_gap(arm, hidden, KindsExciter(arm, seed), most, say)
    heldout, tracking = compare_models(arm, hidden, loop.last, seed) if compared else ({}, {})
    tracked = {key: tracking[name] for key, name in TRACKED.items() if name in tracking}
    truth = {"seed": seed, "effects": list(hidden.effects), "heldout_floors": heldout}
    return {**keep(loop, arm, folder), **truth, **tracked}


def keep(loop: Closed, arm: ArmModel, folder: Path) -> dict[str, Any]:
    """Writes the last diagnosis and, where an effect is identified, its patch; the arm's record (`ident.close/1`)."""
    diagnosis, patch = loop.last.record, ""
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / "diagnosis.json") as part:
        part.write_text(json.dumps(diagnosis, indent=1) + "\n", encoding="utf-8")
    if diagnosis["findings"]:
        with suppress(InputError):  # identified, but nothing that a file could hold
            write_patch(Diagnosed.of_record(diagnosis, path=folder / "diagnosis.json"), arm, folder / "patch")
            patch = "patch"
    joints = list(diagnosis["joints"])

    def by_joint(values: Any) -> dict[str, float]:
        return dict(zip(joints, map(float, values), strict=True))

    rounds = [
        {
            "minutes": one.minutes,
            "gap_floors": None if one.gap is None else by_joint(one.gap.joints),
            "gap_upper": None if one.gap is None else one.gap.upper,
            "verdict": one.verdict,
            "named": list(one.named),
        }
        for one in loop.rounds
    ]
    return {
        "seed": None,
        "robot": diagnosis["robot"],
        "joints": joints,
        "effects": [],
        "closed": loop.closed,
        "reason": loop.reason,
        "minutes": loop.minutes,
        "rounds": len(loop.rounds),
        "by_round": rounds,
        "named": list(loop.last.named),
        "gap_floors_before": loop.before.together,
        "gap_floors_after": loop.after.together,
        "gap_floors_by_joint": by_joint(loop.after.joints),
        "heldout_floors": {},
        "patch": patch,
    }
