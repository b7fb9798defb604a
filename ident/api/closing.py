"""Closes the gap of an arm: what `ident close` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from ident.closed_loop.exciting import Exciter, KindsExciter
from ident.closed_loop.loop import close_gap
from ident.closed_loop.recorder import CommandRecorder
from ident.closed_loop.result import Closing, close_simulated, keep
from ident.errors import InputError
from ident.options import CloseOptions
from ident.outputs import begin_folder
from ident.provenance import Provenance
from ident.sessions import Robot, load_robot

CLOSE_KIND = "close"


def close(
    robot: Robot = "tm5-900",
    out: str | Path = "out/close",
    *,
    exciter: Exciter | None = None,
    say: Callable[[str], None] = lambda line: None,
    **options: Any,
) -> Closing:
    """From a URDF and an arm to a model that leaves hardly more than noise on recordings that it never saw.

    Args:
        robot: URDF path, name or arm.
        out: Folder for `close.json` and, for each arm, its last diagnosis and patch.
        exciter: Who chooses the motions, where it is not the kinds of `ident.trajectories`; for a given recorder.
        say: Called with each line that says what happens.
        options: Fields of `ident.options.CloseOptions`: `recorder` (a command, or an object with `record(motions)`; of
            simulated arms none), `arms`, `seed`, `rounds`, `effects`, `compared`.

    Raises:
        InputError: A robot, recordings or numbers that can't be used.
    """
    chosen = CloseOptions.of("close", options)
    folder = Path(out)
    begin_folder(folder, CLOSE_KIND)
    recorder, seed, rounds = chosen.recorder, chosen.seed, chosen.rounds
    if recorder is not None:
        arm = load_robot(robot, ())
        who = CommandRecorder(recorder, folder / "recorded", arm) if isinstance(recorder, str) else recorder
        loop = close_gap(arm, who, exciter or KindsExciter(arm, seed), rounds, say)
        found = [keep(loop, arm, folder / "arm_00")]
    else:
        if not isinstance(robot, str | Path):
            raise InputError("robot", "an arm in memory can't be simulated", "give its URDF's path, or its name")
        from ident.simulation.request import parse_effect

        for one in chosen.effects or ():
            parse_effect(one)  # before anything is simulated
        found = [
            close_simulated(str(robot), seed + k, folder / f"arm_{k:02d}", rounds, chosen.effects, chosen.compared, say)
            for k in range(chosen.arms)
        ]
    settings = {"robot": str(getattr(robot, "name", robot)), "arms": chosen.arms, "seed": seed, "rounds": rounds}
    result = Closing(tuple(found)).with_provenance(Provenance("ident close", settings=settings))
    result.save(folder / "close.json")
    return result
