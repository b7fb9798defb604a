"""Commands of a lab's daily work and of the simulated arm."""

from __future__ import annotations

import time
from functools import partial
from itertools import count
from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import JsonFile, Robot, Sessions, app, console, hand_over, takes
from ident.errors import InputError, plural, visible
from ident.files import deliver, write_record
from ident.options import CheckOptions, CloseOptions, WatchOptions
from ident.outputs import SESSION_KIND, check_outputs
from ident.progress import stage, step
from ident.results import Provenance, Result
from ident.show.console import progress_line


@app.command()
def new(
    session: Annotated[Path, typer.Argument(help="Folder of tables, or one table, bag or data set.")],
    tables: Annotated[
        list[Path] | None, typer.Argument(help="Tables to copy into SESSION, which is then a new folder.")
    ] = None,
    robot: Robot = None,
    json_file: JsonFile = None,
) -> None:
    """Looks at a foreign table and writes a session.toml with its guesses, each with its evidence."""
    from ident.api.daily import new as guess

    folders = {"SESSION": (session, SESSION_KIND)} if tables else {}
    check_outputs([*(tables or [session]), robot], {"--json": json_file}, folders)
    found = guess(session, robot, tables=tables or ())
    hand_over(found, json_file)
    console.print(f"written to {found.file}: look through it, then `ident inspect`", soft_wrap=True)


@app.command()
def servo(
    sessions: Sessions,
    robot: Robot = None,
    cutoff: Annotated[float | None, typer.Option(help="Corner of the filter for all signals [Hz].")] = None,
    json_file: JsonFile = None,
) -> None:
    """Arms that log goal and position only: lag, delay, dead band, droop, gain, and what can't be told."""
    from ident.api.daily import servo as find

    check_outputs([*sessions, robot], {"--json": json_file})
    hand_over(find(sessions, robot, cutoff=cutoff), json_file)


@app.command()
@takes
def watch(
    folder: Annotated[Path, typer.Argument(help="Folder of sessions, or of arms that hold sessions.")],
    store: Annotated[Path, typer.Option(help="Folder of the results: tables, diagnoses, pages.")],
    options: WatchOptions,
    once: Annotated[bool, typer.Option("--once", help="Look once and end, as cron wants it.")] = False,
    every: Annotated[float, typer.Option(help="Look again after so many seconds.")] = 60.0,
    json_file: JsonFile = None,
) -> None:
    """Follows arms through time: new sessions as they come, figures over dates, alarms, a page for each arm."""
    from ident.api.daily import watch as look
    from ident.monitor.store import NoSession

    check_outputs([options.robot, options.model], {"--json": json_file})
    if not every > 0.0:
        raise InputError("--every", f"{every:g} is no time", "give seconds")
    shown = ""
    while True:
        try:
            with progress_line(console, "watch"):
                stage("sessions")
                found = look(folder, store, **vars(options), progress=step)
        except NoSession as error:
            if once:
                raise
            words = f"{error.where}: no session yet"
        else:
            words = f"{found.summary()}\nwritten to {store}; look at {store / 'index.html'}"
            write_record(json_file, found.to_dict())
        if words != shown:
            console.print(visible(words, lines=True), highlight=False, soft_wrap=True)
        if once:
            return
        shown = words
        time.sleep(every)


# The commands of the simulated arm: `ident simulate`, `ident blind` and `ident close`.


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(help="Folder of the simulated session.")],
    effect: Annotated[list[str] | None, typer.Option(help="ID:JOINT:SIZE; SIZE in SI units, or 3x the noise.")] = None,
    robot: Annotated[str | None, typer.Option(help="URDF path or name; tm5-900 if not given.")] = None,
    world: Annotated[
        str | None, typer.Option(help="Another arm and sensors: a preset's name, or a TOML file. Other options hold.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything: arm, motions, noise.", min=0)] = 0,
    motion: Annotated[list[str] | None, typer.Option(help="Kinds of motion, in turn.")] = None,
    commands: Annotated[
        Path | None, typer.Option(help="Run the motions of these command files instead (as of plan excite --out).")
    ] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Run this plan instead (as of plan solve --json), so many times as --runs says.")
    ] = None,
    runs: Annotated[int | None, typer.Option(help="Number of runs; 10 if not given.")] = None,
    duration: Annotated[float | None, typer.Option(help="Rough duration of a run [s]; 8 if not given.")] = None,
    rate: Annotated[float | None, typer.Option(help="Log rate [Hz]; 250 if not given.")] = None,
    velocity: Annotated[bool | None, typer.Option(help="Log the velocity channel; yes if not given.")] = None,
    temperature: Annotated[bool, typer.Option(help="Log joint temperatures.")] = False,
    payload: Annotated[str | None, typer.Option(help="Known body at the flange: MASS or MASS@X,Y,Z.")] = None,
    decoy: Annotated[list[str] | None, typer.Option(help="inertia, geometry, friction, controller.")] = None,
    answer: Annotated[bool, typer.Option(help="Write what was wrong beside the session.")] = False,
    sealed: Annotated[bool, typer.Option(help="Write it encrypted; its SHA-256 and key are printed.")] = False,
    json_file: JsonFile = None,
) -> None:
    """A session of the simulated arm, its effects chosen."""
    from ident.robot.arm import ArmModel
    from ident.simulation.request import parse_payload
    from ident.simulation.simulate import RICH, SimulationOptions, simulate_to
    from ident.simulation.world import find_world, settle
    from ident.trajectories.files import read_commands, read_plan

    if plan is not None and commands is not None:
        raise InputError("--plan", "given beside --commands", "give one of them")
    check_outputs([commands, plan, robot, world], {"--json": json_file}, {"--out": (out, SESSION_KIND)})
    drawn = None if world is None else settle(find_world(world), seed, robot, runs, duration, rate, velocity)
    robot = drawn.robot if drawn else robot or "tm5-900"
    runs = drawn.runs if drawn else 10 if runs is None else runs
    given = None if commands is None else read_commands(commands, ArmModel.load(robot))
    if plan is not None:
        given = (read_plan(plan, ArmModel.load(robot)),) * runs
    total = runs if given is None else len(given)
    with progress_line(console, "simulate"):
        finished = count(1)
        stage("running the arm")

        def tell() -> None:
            step(next(finished), total)

        options = SimulationOptions(
            robot=robot,
            effects=tuple(effect or ()),
            seed=seed,
            motions=tuple(motion) if motion else RICH,
            runs=runs,
            duration=8.0 if duration is None else duration,
            rate=250.0 if rate is None else rate,
            velocity=velocity is not False,
            temperature=temperature,
            payload=parse_payload(payload) if payload else None,
            decoys=tuple(decoy or ()),
        )
        options = options if drawn is None else options.in_world(drawn)
        written = simulate_to(out, options, answer, sealed, tell, given)
    settings = {"effects": effect or [], "robot": robot, "world": world, "seed": seed}
    record = {
        "schema": "ident.simulation/1",
        "robot": written.robot,
        "joints": list(written.joints),
        "sessions": [{**vars(written), "folder": str(written.folder)}],
        "provenance": Provenance("ident simulate", settings=settings).to_dict(),
    }

    def show() -> None:
        console.print(
            f"{written.folder}: {plural(written.runs, 'run')}, {written.samples} samples, {written.duration_s:.0f} s"
        )
        if written.sha256:
            key = f", key {written.key}" if written.key else ""
            console.print(f"sealed: sha256 {written.sha256}{key}", soft_wrap=True)

    deliver(show, lambda: write_record(json_file, record))


@app.command()
@takes
def blind(
    options: CheckOptions,
    semi_real: Annotated[Path | None, typer.Option(help="Real recordings to which known effects are added.")] = None,
    mix: Annotated[str, typer.Option(help="Kinds of case and their shares: single=20,healthy=5,…")] = "",
    json_file: JsonFile = None,
) -> None:
    """The check on withheld effects: draws, simulates, seals, diagnoses from the recordings alone, scores."""
    from ident.benchmark.cases import FULL_MIX, parse_mix
    from ident.benchmark.real_check import check_on_real
    from ident.benchmark.run import BlindOptions, run_blind

    check_outputs([options.robot, semi_real], {"--json": json_file})
    if options.worlds and semi_real:
        raise InputError("--worlds", "worlds and real recordings", "choose --worlds or --semi-real")
    chosen = BlindOptions(**vars(options), mix=parse_mix(mix) if mix else FULL_MIX)
    with progress_line(console, "blind"):
        report: Result = (run_blind if semi_real is None else partial(check_on_real, semi_real))(
            chosen,
            lambda line: console.print(line, soft_wrap=True, highlight=False),
            lambda words, done, total: stage(words, done / max(total, 1)),
        )
    hand_over(report, json_file)
    console.print(f"written to {options.out}")


@app.command()
@takes
def close(
    out: Annotated[Path, typer.Option(help="Folder for close.json and each arm's diagnosis and patch.")],
    options: CloseOptions,
    robot: Annotated[str, typer.Option(help="URDF path, tm5-900, or a name of example-robot-data.")] = "tm5-900",
    json_file: JsonFile = None,
) -> None:
    """Closes the gap: diagnose, patch, record what is open, and again, until only noise is left; tells the minutes."""
    from ident.api.simulating import close as run

    def say(line: str) -> None:
        console.print(visible(line), highlight=False, soft_wrap=True)

    check_outputs([robot], {"--json": json_file})
    hand_over(run(robot, out, say=say, **vars(options)), json_file)
    console.print(f"written to {out}", soft_wrap=True)
