"""The simulated arm: what the commands simulate, blind and close do."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

from ident.benchmark.run import BlindOptions, Progress, Say, run_blind
from ident.benchmark.summary import BlindReport
from ident.closed_loop.loop import close_gap
from ident.closed_loop.recorder import CommandRecorder
from ident.closed_loop.result import Closing, close_simulated, keep
from ident.command_options import CloseOptions, SimulateOptions
from ident.errors import InputError
from ident.outputs import begin_folder, end_if_empty
from ident.progress import stage, step
from ident.recordings.load import load_session
from ident.recordings.recording import Session
from ident.results import Provenance
from ident.robot.arm import ArmModel
from ident.sessions import Robot, load_robot
from ident.simulation.request import parse_effect, parse_payload
from ident.simulation.simulate import RICH, SimulationOptions, WrittenSession, simulate_to
from ident.simulation.simulate import simulate as run
from ident.simulation.world import find_world, settle
from ident.trajectories.files import read_commands
from ident.trajectories.plan_record import read_plan

CLOSE_KIND = "close"


def blind(
    cases: int = 40,
    *,
    out: str | Path = "out/blind",
    say: Say = lambda line: None,
    progress: Progress = lambda step, done, total: None,
    **options: Any,
) -> BlindReport:
    """Draws effects, simulates, seals, diagnoses from the recordings alone, opens, scores.

    Args:
        cases: Number of cases.
        out: Folder for everything; a check that was stopped there goes on.
        say: Called with the seals, line by line, before any diagnosis.
        progress: Called with what is being done, how many cases are done, and of how many.
        options: Further fields of `ident.benchmark.run.BlindOptions`: seed, workers, robot, runs,
            duration, …

    Raises:
        InputError: Options that make no sense, or another check in the folder.
    """
    return run_blind(
        BlindOptions.of("blind", {"cases": cases, "out": Path(out), **options}), say, progress
    )


def close(
    robot: Robot = "tm5-900",
    out: str | Path = "out/close",
    *,
    say: Callable[[str], None] = lambda line: None,
    **options: Any,
) -> Closing:
    """From a URDF and an arm to a model that leaves hardly more than noise on recordings that it
    never saw.

    Args:
        robot: URDF path, name or arm.
        out: Folder for `close.json` and, for each arm, its last diagnosis and patch.
        say: Called with each line that says what happens.
        options: Fields of `ident.command_options.CloseOptions`: `recorder` (a command, or an object
            with `record(motions)`; of simulated arms none), `arms`, `seed`, `rounds`, `effects`,
            `compared`.

    Raises:
        InputError: A robot, recordings or numbers that can't be used.
    """
    chosen = CloseOptions.of("close", options)
    folder = Path(out)
    begin_folder(folder, CLOSE_KIND)
    try:
        loops = _close_arms(robot, folder, chosen, say)
    except InputError:
        end_if_empty(folder)
        raise
    settings = {
        "robot": str(getattr(robot, "name", robot)),
        "arms": chosen.arms,
        "seed": chosen.seed,
        "rounds": chosen.rounds,
    }
    result = Closing(tuple(loops)).with_provenance(Provenance("ident close", settings=settings))
    result.save(folder / "close.json")
    return result


def _close_arms(
    robot: Robot, folder: Path, chosen: CloseOptions, say: Callable[[str], None]
) -> list[dict[str, Any]]:
    """The record of each arm, one behind a recorder or simulated ones."""
    recorder = chosen.recorder
    if recorder is not None:
        arm = load_robot(robot, ())
        who = (
            CommandRecorder(recorder, folder / "recorded", arm)
            if isinstance(recorder, str)
            else recorder
        )
        loop = close_gap(arm, who, chosen.seed, chosen.rounds, say)
        return [keep(loop, arm, folder / "arm_00")]
    if not isinstance(robot, str | Path):
        raise InputError(
            "robot", "an arm in memory can't be simulated", "give its URDF's path, or its name"
        )
    for effect in chosen.effects or ():
        parse_effect(effect)  # before anything is simulated
    return [
        close_simulated(
            str(robot),
            chosen.seed + number,
            folder / f"arm_{number:02d}",
            chosen.rounds,
            chosen.effects,
            chosen.compared,
            say,
        )
        for number in range(chosen.arms)
    ]


def simulate(*effects: str, out: str | Path | None = None, **options: Any) -> Session:
    """A session of the simulated arm, its effects chosen.

    Args:
        effects: What is wrong, each ID:JOINT:SIZE; SIZE in SI units, or as a multiple of the noise
            (`3x`).
        out: Folder in which it is written too; in memory alone if None.
        options: Fields of `ident.simulation.simulate.SimulationOptions`: robot, seed, runs,
            duration, rate, payload, …

    Raises:
        InputError: An unknown effect, joint or option.
    """
    for effect in effects:
        if not isinstance(effect, str):
            raise InputError(
                "simulate", f"a {type(effect).__name__} is no effect", "give ID:JOINT:SIZE as text"
            )
    chosen = SimulationOptions.of("simulate", {**options, "effects": effects})
    if out is None:
        return run(chosen).session
    simulate_to(out, chosen)
    return load_session(out)


def simulate_into(out: Path, given: SimulateOptions) -> WrittenSession:
    """A session of the simulated arm in a folder, as the command asks for it.

    Raises:
        InputError: An unknown effect, joint, world, motion or decoy, or options that exclude each
            other.
    """
    if given.plan is not None and given.commands is not None:
        raise InputError("--plan", "given beside --commands", "give one of them")
    asked = {
        name: getattr(given, name) for name in ("robot", "runs", "duration", "rate", "velocity")
    }
    options = SimulationOptions(
        **{name: value for name, value in asked.items() if value is not None},
        effects=given.effect,
        seed=given.seed,
        motions=given.motion or RICH,
        temperature=given.temperature,
        payload=parse_payload(given.payload) if given.payload else None,
        decoys=given.decoy,
    )
    if given.world is not None:
        options = options.in_world(settle(find_world(given.world), given.seed, **asked))
    robot = options.robot
    runs = options.runs
    motions = (
        None if given.commands is None else read_commands(given.commands, ArmModel.load(robot))
    )
    if given.plan is not None:
        motions = (read_plan(given.plan, ArmModel.load(robot)),) * runs
    finished = count(1)
    total = runs if motions is None else len(motions)
    stage("running the arm")
    written = simulate_to(
        out, options, given.answer, given.sealed, lambda: step(next(finished), total), motions
    )
    settings = {
        "effects": list(given.effect),
        "robot": robot,
        "world": given.world,
        "seed": given.seed,
    }
    return written.with_provenance(Provenance("ident simulate", settings=settings))
