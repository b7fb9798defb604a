"""Closes the gap of an arm: what `ident close` does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ident.closed_loop.exciting import Exciter, KindsExciter
from ident.closed_loop.loop import MOST_ROUNDS, close_gap
from ident.closed_loop.recorder import CommandRecorder, Recorder
from ident.closed_loop.result import Closing, close_simulated, keep
from ident.errors import InputError
from ident.outputs import begin_folder
from ident.provenance import Provenance
from ident.sessions import Robot, load_robot

CLOSE_KIND = "close"
# Seeds of the arms that follow the first fit below the simulator's own bound.
LARGEST_SEED = 2**62


def close(
    robot: Robot = "tm5-900",
    out: str | Path = "out/close",
    *,
    recorder: Recorder | str | None = None,
    exciter: Exciter | None = None,
    arms: int = 1,
    seed: int = 0,
    rounds: int = MOST_ROUNDS,
    effects: tuple[str, ...] | None = None,
    compared: bool = True,
    say: Callable[[str], None] = lambda line: None,
) -> Closing:
    """From a URDF and an arm to a model that leaves hardly more than noise on recordings that it never saw.

    Args:
        robot: URDF path, name or arm.
        out: Folder for `close.json` and, for each arm, its last diagnosis and patch.
        recorder: A real arm: an object with `record(motions)`, or a command with {commands} and {session} in it;
            simulated arms if None.
        exciter: Who chooses the motions, where it is not the kinds of `ident.trajectories`; for a given recorder.
        arms: Number of simulated arms; each has effects of its own.
        seed: Of the first arm; the next ones count up.
        rounds: Most rounds an arm.
        effects: What is wrong with each simulated arm (ID:JOINT:SIZE); three at random if None.
        compared: Whether rivals are made from the same recordings, and a controller is tried with each.
        say: Told what happens, in lines.

    Raises:
        InputError: A robot, recordings or numbers that can't be used.
    """
    if arms < 1:
        raise InputError("--arms", f"{arms} arms", "give 1 or more")
    if not 0 <= seed < LARGEST_SEED:
        raise InputError("--seed", f"{seed} is no seed", f"give a number from 0 to {LARGEST_SEED - 1}")
    if rounds < 2:
        raise InputError("--rounds", f"{rounds} round(s) can't be checked", "give 2 or more")
    if recorder is not None and arms != 1:
        raise InputError("--arms", f"{arms} arms behind one recorder", "record one arm at a time")
    folder = Path(out)
    begin_folder(folder, CLOSE_KIND)
    if recorder is not None:
        arm = load_robot(robot, ())
        who = CommandRecorder(recorder, folder / "recorded", arm) if isinstance(recorder, str) else recorder
        loop = close_gap(arm, who, exciter or KindsExciter(arm, seed), rounds, say)
        found = [keep(loop, arm, folder / "arm_00")]
    else:
        if not isinstance(robot, str | Path):
            raise InputError("robot", "an arm in memory can't be simulated", "give its URDF's path, or its name")
        from ident.simulation.request import parse_effect

        for one in effects or ():
            parse_effect(one)  # before anything is simulated
        found = []
        for k in range(arms):
            place = folder / f"arm_{k:02d}"
            found.append(close_simulated(str(robot), seed + k, place, rounds, effects, compared, say))
    settings = {"robot": str(getattr(robot, "name", robot)), "arms": arms, "seed": seed, "rounds": rounds}
    result = Closing(tuple(found)).with_provenance(Provenance("ident close", settings=settings))
    result.save(folder / "close.json")
    return result
