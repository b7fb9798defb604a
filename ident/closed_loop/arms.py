"""The loop on one arm, simulated or real, and what becomes of it: files, and rivals to compare with."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from ident.checks import inspect_sessions
from ident.closed_loop.exciting import Exciter, KindsExciter
from ident.closed_loop.gap import measure_floors
from ident.closed_loop.loop import MOST_ROUNDS, Closed, Say, close_gap
from ident.closed_loop.models import as_randomised, as_tuned, as_urdf
from ident.closed_loop.recorder import Recorder
from ident.closed_loop.result import ArmClosed
from ident.effects.catalogue import CATALOGUE
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.law_model import SimulatorModel
from ident.export.write import write_patch
from ident.files import atomic_write
from ident.motion.motion import prepare
from ident.robot.arm import ArmModel
from ident.trajectories.kinds import plan_motions

# Effects of a simulated arm.
EFFECTS = 3
# Motions that are kept for the end: everyday ones, of other seeds than all that was recorded [s].
HELD_OUT_S, HELD_OUT_RUNS = 6.0, 4


def close_simulated(
    robot: str,
    seed: int,
    folder: Path,
    most: int = MOST_ROUNDS,
    effects: tuple[str, ...] | None = None,
    compared: bool = True,
    say: Say = lambda line: None,
) -> ArmClosed:
    """One simulated arm: the loop, then the rivals on motions that served nothing else.

    Args:
        robot: URDF path or name.
        seed: Of the arm, its effects, motions and noise.
        folder: For diagnosis and patch.
        most: Most rounds.
        effects: What is wrong with it, each ID:JOINT:SIZE; three at random if None.
        compared: Whether rivals are made from the same recordings, and a controller is tried with each.
        say: Told each round in a line.
    """
    from ident.closed_loop.simulated import SimulatedArm, draw_effects
    from ident.simulation.simulate import SimulationOptions

    arm = ArmModel.load(robot)
    drawn = effects if effects is not None else draw_effects(arm.joint_names, EFFECTS, np.random.default_rng([seed, 3]))
    hidden = SimulatedArm(SimulationOptions(robot=robot, seed=seed, effects=drawn))
    loop = close_gap(arm, hidden, KindsExciter(arm, CATALOGUE, seed), CATALOGUE, most, say)
    heldout, tracking = _compare(arm, hidden, loop, seed) if compared else ({}, {})
    return ArmClosed(seed, hidden.effects, loop, heldout, tracking, _write(loop, arm, folder))


def check_effects(effects: tuple[str, ...] | None) -> None:
    """Raises InputError for effects that can't be read, before anything is simulated."""
    from ident.simulation.request import parse_effect

    for one in effects or ():
        parse_effect(one)


def close_real(
    arm: ArmModel,
    recorder: Recorder,
    folder: Path,
    exciter: Exciter | None = None,
    most: int = MOST_ROUNDS,
    seed: int = 0,
    say: Say = lambda line: None,
) -> ArmClosed:
    """The loop on an arm of which nobody knows the truth."""
    loop = close_gap(arm, recorder, exciter or KindsExciter(arm, CATALOGUE, seed), CATALOGUE, most, say)
    return ArmClosed(None, (), loop, {}, {}, _write(loop, arm, folder))


def _compare(arm: ArmModel, hidden: Any, loop: Closed, seed: int) -> tuple[dict[str, float], dict[str, float]]:
    """Gap and tracking error of each model on the same motions of the same arm."""
    from ident.closed_loop.net_model import train_net
    from ident.closed_loop.simulated import track

    motions = plan_motions(arm, ("spline",), HELD_OUT_RUNS, HELD_OUT_S, np.random.default_rng([seed, 0, 1]))
    session = hidden.record(motions)
    fresh = prepare(inspect_sessions([session], arm)[0].session, loop.learned[0].lowpass.cutoff)
    models: dict[str, SimulatorModel] = {
        "urdf": as_urdf(arm),
        "tuned": as_tuned(arm, loop.record, CATALOGUE),
        "net": train_net(arm, loop.learned, seed),
        "randomised": as_randomised(arm),
        "closed": loop.model,
    }
    heldout = {name: measure_floors(model, fresh, loop.floors, loop.warmth).together for name, model in models.items()}
    found = track(hidden.hardware, models, motions, seed, loop.warmth)
    return heldout, {name: one.together for name, one in found.items()}


def _write(loop: Closed, arm: ArmModel, folder: Path) -> str:
    """The last diagnosis, and its patch where an effect is named; the patch's place below the folder."""
    folder.mkdir(parents=True, exist_ok=True)
    with atomic_write(folder / "diagnosis.json") as part:
        part.write_text(json.dumps(loop.record, indent=1) + "\n", encoding="utf-8")
    if not loop.record["findings"]:
        return ""
    diagnosed = Diagnosed.of_record(loop.record, CATALOGUE, folder / "diagnosis.json")
    try:
        write_patch(diagnosed, arm, folder / "patch")
    except InputError:  # named, but nothing that a file could hold
        return ""
    return "patch"
