"""The `ident` command: parses, calls, prints."""

from __future__ import annotations

import json
import sys
from itertools import count
from pathlib import Path
from typing import Annotated, Any

import typer

from ident.errors import InputError
from ident.files import atomic_write
from ident.show.console import ladder_table, make_console, print_issues, progress_bar

app = typer.Typer(
    name="ident",
    help="Identify a robot arm, and find out why it does not move as its model says.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
console = make_console()
STOPPED = 130  # exit status after Ctrl-C

Sessions = Annotated[list[Path], typer.Argument(help="Session folders, or single files.", show_default=False)]
Robot = Annotated[
    str | None, typer.Option("--robot", help="URDF path, tm5-900, or a name of example-robot-data (panda, ur10, …).")
]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the results to this file.")]
Topic = Annotated[str, typer.Option(help="Topic of the joint states, for ROS 2 bags.")]
SessionFile = Annotated[Path | None, typer.Option(help="A session.toml, for folders that can't hold one.")]
Cutoff = Annotated[float | None, typer.Option(help="Corner of the filter for torques and columns [Hz].")]


def write_json(path: Path | None, record: dict[str, Any]) -> None:
    """Writes a result file, whole or not at all."""
    if path is not None:
        with atomic_write(path) as part:
            part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def _tell_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        print(f"ident (armgap) {version('armgap')}")
        raise typer.Exit


@app.callback()
def ident(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and exit.", callback=_tell_version, is_eager=True)
    ] = False,
) -> None:
    """Identify a robot arm, and find out why it does not move as its model says."""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the model, the report and the timeline.")] = Path("out/demo"),
    logs: Annotated[Path | None, typer.Option(help="Recordings other than the shipped ones.")] = None,
    json_file: JsonFile = None,
) -> None:
    """The main job on the shipped recordings: fit, evaluate, report, timeline."""
    from ident.cli.demo import run_demo

    write_json(json_file, run_demo(out, logs, console))


@app.command()
def inspect(
    sessions: Sessions,
    robot: Robot = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    mend: Annotated[Path | None, typer.Option(help="Write the mended sessions into this folder.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Checks the telemetry before anything is fitted."""
    from ident.opening import inspect_paths

    _, reports = inspect_paths(sessions, robot, topic, session_file)
    for report in reports:
        session = report.session
        console.print(f"{session.name}: {len(session.runs)} runs, {session.samples} samples, {session.duration:.1f} s")
        print_issues(console, report.issues)
        console.print("fit for use" if report.is_fit else "[red]not fit for use[/]")
        if mend is not None:
            report.mend(mend / session.name if len(reports) > 1 else mend)
    write_json(json_file, {"schema": "ident.telemetry/1", "sessions": [report.to_dict() for report in reports]})


@app.command()
def fit(
    sessions: Sessions,
    out: Annotated[Path, typer.Option(help="Folder of the fitted model.")],
    robot: Robot = None,
    links: Annotated[int, typer.Option(help="6 for the full arm, 3 for the lumped three-joint model.")] = 6,
    inertia: Annotated[str, typer.Option(help="nominal, base or consistent.")] = "consistent",
    net: Annotated[str, typer.Option(help="default, paper or none.")] = "default",
    offset: Annotated[bool, typer.Option(help="Fit a constant torque a joint too.")] = False,
    robust: Annotated[bool, typer.Option(help="Stretches that fit badly lose their pull.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the net.")] = 0,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """Fits analytic + loss + residual net."""
    from ident.model.hybrid import FitOptions, fit_hybrid
    from ident.opening import open_sessions

    options = FitOptions(links, inertia, net, offset, robust, seed)  # type: ignore[arg-type]
    opened = open_sessions(sessions, robot, topic, session_file, cutoff)
    print_issues(console, opened.issues)
    checkpoint = out.with_name(out.name + ".training")
    with progress_bar(console, "residual net") as progress:
        results = fit_hybrid(opened.motions, opened.arm, options, opened.data_records(), progress, checkpoint)
    results.model.save(out)
    _remove_checkpoint(checkpoint)
    console.print(results.loss.summary(), markup=False, soft_wrap=True)
    console.print(f"condition number of the motions: {results.inertia.condition_number:.0f}")
    console.print(f"model written to {out}")
    write_json(json_file, {**results.model.record(), "schema": "ident.fit/1"})


def _remove_checkpoint(folder: Path) -> None:
    """A finished training needs its checkpoint no more."""
    file = folder / "checkpoint.safetensors"
    if file.is_file():
        file.unlink()
        folder.rmdir()


@app.command()
def evaluate(
    sessions: Sessions,
    model: Annotated[list[Path], typer.Option(help="Folder of a fitted model; give several to compare them.")],
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    html: Annotated[Path | None, typer.Option(help="Write the report to this file.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Energy error and torque RMSE of every rung of the ladder, on runs that the fit did not see."""
    from ident.model.evaluation import evaluate as score
    from ident.model.hybrid import HybridModel
    from ident.opening import open_for_model
    from ident.show.report import write_evaluation_report

    models = [(path.name, HybridModel.load(path)) for path in model]
    opened = [open_for_model(sessions, loaded, topic, session_file, cutoff) for _, loaded in models]
    pairs = zip(models, opened, strict=True)
    results = [score(loaded, data.groups, name) for (name, loaded), data in pairs]
    for result in results:
        console.print(f"[bold]{result.model}[/]")
        for one in (*result.sessions, result.pooled) if len(result.sessions) > 1 else result.sessions:
            console.print(ladder_table(one))
    if html is not None:
        write_evaluation_report(html, [loaded for _, loaded in models], results, opened[0].issues)
        console.print(f"report written to {html}")
    write_json(json_file, {"schema": "ident.evaluations/1", "models": [result.to_dict() for result in results]})


@app.command()
def diagnose(
    sessions: Sessions,
    robot: Robot = None,
    model: Annotated[Path | None, typer.Option(help="Model fitted to this arm: its inertias count as known.")] = None,
    catalogue: Annotated[Path | None, typer.Option(help="A Python file with further effects.")] = None,
    html: Annotated[Path | None, typer.Option(help="Write the page to this file.")] = None,
    rrd: Annotated[Path | None, typer.Option(help="Save the timeline, with the gap marked, to this file.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    seed: Annotated[int, typer.Option(help="Seed of the sign-flip tests.")] = 0,
    json_file: JsonFile = None,
) -> None:
    """Where the gap lies, which effect causes it, how far it shrinks; or why that can't be told."""
    from ident.diagnosis.from_reports import diagnose_reports
    from ident.effects.catalogue import load_catalogue
    from ident.model.evaluation import evaluate as score
    from ident.model.hybrid import HybridModel
    from ident.opening import inspect_in_parts, open_for_model
    from ident.show.terminal import gap_curves, gap_marks, print_diagnosis

    loaded = HybridModel.load(model) if model else None
    arm, reports = inspect_in_parts(sessions, robot, topic, session_file)
    if loaded is not None and model is not None:
        loaded.require_robot(arm, model)
    diagnosis, analysis, motions = diagnose_reports(reports, arm, load_catalogue(catalogue), cutoff, seed, loaded)
    print_diagnosis(console, diagnosis)
    record = diagnosis.to_dict()
    if html is not None:
        from ident.show.report import ReportInput, write_diagnosis_report

        evaluation = None
        if loaded is not None and analysis is not None:
            opened = open_for_model(sessions, loaded, topic, session_file)
            evaluation = ReportInput((loaded,), (score(loaded, opened.groups, loaded.robot.name),), ())
        write_diagnosis_report(html, record, evaluation)
        console.print(f"page written to {html}")
    if rrd is not None and analysis is not None:
        from ident.show.timeline import write_timeline

        marks, curves = gap_marks(analysis), gap_curves(analysis)
        write_timeline(rrd, analysis.baseline.nominal, motions, loaded, diagnosis.telemetry, marks, curves)
        console.print(f"timeline written to {rrd}")
    write_json(json_file, record)


@app.command()
def patch(
    diagnosis: Annotated[Path, typer.Argument(help="The JSON of ident diagnose.", show_default=False)],
    robot: Annotated[str, typer.Option(help="The robot that was diagnosed: URDF path or name.")],
    out: Annotated[Path, typer.Option(help="Folder of the patch.")],
    on: Annotated[list[Path] | None, typer.Option(help="Sessions to measure it on.")] = None,
    catalogue: Annotated[Path | None, typer.Option(help="A Python file with further effects.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    json_file: JsonFile = None,
) -> None:
    """The named effects for simulators: URDF, MJCF, parameter file and Python module, each loaded back."""
    from ident.effects.catalogue import load_catalogue
    from ident.patches.change import Diagnosed
    from ident.patches.command import open_heldout, write_patch
    from ident.patches.printing import print_patch
    from ident.robot.arm import ArmModel

    diagnosed = Diagnosed.load(diagnosis, load_catalogue(catalogue))
    motions = open_heldout(on, robot, diagnosed, topic, session_file) if on else ()
    record = write_patch(diagnosed, ArmModel.load(robot), out, motions)
    print_patch(console, record, out)
    write_json(json_file, record)


@app.command()
def simulate(
    out: Annotated[Path, typer.Option(help="Folder of the simulated session.")],
    effect: Annotated[list[str] | None, typer.Option(help="ID:JOINT:SIZE; SIZE in SI units, or 3x the noise.")] = None,
    robot: Annotated[str | None, typer.Option(help="URDF path or name; tm5-900 if not given.")] = None,
    world: Annotated[
        str | None, typer.Option(help="Another arm and sensors: a preset's name, or a TOML file. Other options hold.")
    ] = None,
    seed: Annotated[int, typer.Option(help="Of everything: arm, motions, noise.")] = 0,
    motion: Annotated[list[str] | None, typer.Option(help="Kinds of motion, in turn.")] = None,
    commands: Annotated[
        Path | None, typer.Option(help="Run the motions of these command files instead (as of plan excite --out).")
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
    recipe: Annotated[str | None, typer.Option(help="Make a shipped set of recordings instead.")] = None,
    json_file: JsonFile = None,
) -> None:
    """A session of the simulated arm, its effects chosen."""
    from ident.plant.output import simulate_to
    from ident.plant.recipes import run_recipe
    from ident.plant.request import parse_payload
    from ident.plant.simulate import RICH, SimulationOptions
    from ident.plant.world_presets import find_world, settle
    from ident.robot.arm import ArmModel
    from ident.trajectories.command_files import read_commands

    drawn = None if world is None else settle(find_world(world), seed, robot, runs, duration, rate, velocity)
    robot = drawn.robot if drawn else robot or "tm5-900"
    runs = drawn.runs if drawn else 10 if runs is None else runs
    given = None if commands is None else read_commands(commands, ArmModel.load(robot))
    total = runs if given is None else len(given)
    with progress_bar(console, "simulation", "") as progress:
        finished = count()

        def tell() -> None:
            progress(next(finished) + 1, total, 0.0)

        if recipe is not None:
            written = run_recipe(recipe, out)
        else:
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
            written = [simulate_to(out, options, answer, sealed, tell, given)]
    for one in written:
        console.print(f"{one.folder}: {one.runs} runs, {one.samples} samples, {one.duration_s:.0f} s")
        if one.sha256:
            console.print(f"sealed: sha256 {one.sha256}" + (f", key {one.key}" if one.key else ""), soft_wrap=True)
    record = [{**vars(one), "folder": str(one.folder)} for one in written]
    write_json(json_file, {"schema": "ident.simulation/1", "sessions": record})


@app.command()
def blind(
    cases: Annotated[int, typer.Option(help="Number of cases.")] = 40,
    seed: Annotated[int | None, typer.Option(help="Of the check; the system's entropy if not given.")] = None,
    out: Annotated[Path, typer.Option(help="Folder of the check; one that was stopped there goes on.")] = Path(
        "out/blind"
    ),
    workers: Annotated[int, typer.Option(help="Processes on this machine.")] = 1,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler instead.")] = None,
    robot: Annotated[str, typer.Option(help="URDF path or name.")] = "tm5-900",
    semi_real: Annotated[Path | None, typer.Option(help="Real recordings to which known effects are added.")] = None,
    worlds: Annotated[
        str,
        typer.Option(help="Arms and sensors of other worlds: all, development, quoted, NAME,… (-NAME: without)."),
    ] = "",
    mix: Annotated[str, typer.Option(help="Kinds of case and their shares: single=20,healthy=5,…")] = "",
    json_file: JsonFile = None,
) -> None:
    """The check on withheld effects: draws, simulates, seals, diagnoses from the recordings alone, scores."""
    from ident.blind_check.cases import FULL_MIX, parse_mix
    from ident.blind_check.run import BlindOptions, run_blind

    options = BlindOptions(
        cases=cases,
        seed=seed,
        out=out,
        workers=workers,
        scheduler=scheduler,
        robot=robot,
        semi_real=semi_real,
        worlds=worlds,
        mix=parse_mix(mix) if mix else FULL_MIX,
    )
    with progress_bar(console, "blind check", "") as progress:
        report = run_blind(
            options,
            lambda line: console.print(line, soft_wrap=True, highlight=False),
            lambda step, done, total: progress(done, total, 0.0),
        )
    record = report.to_dict()
    for name, value in record["scores"].items():
        low, high = record["intervals"].get(name, (None, None))
        interval = f" [{low:.2f}, {high:.2f}]" if low is not None and high is not None else ""
        console.print(f"  {name}: {value if value is None else round(value, 3)}{interval}", highlight=False)
    console.print(f"written to {out}")
    write_json(json_file, record)


@app.command()
def view(
    sessions: Sessions,
    model: Annotated[Path | None, typer.Option(help="Folder of a fitted model.")] = None,
    robot: Robot = None,
    rrd: Annotated[Path | None, typer.Option(help="Save the timeline to this file instead of opening it.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """The Rerun timeline: measured torque against every rung, residuals, energy, the moving arm."""
    from ident.model.hybrid import HybridModel
    from ident.opening import open_for_model, open_sessions
    from ident.show.timeline import show_timeline, write_timeline

    loaded = HybridModel.load(model) if model else None
    if loaded is not None:
        opened = open_for_model(sessions, loaded, topic, session_file, cutoff)
    else:
        opened = open_sessions(sessions, robot, topic, session_file, cutoff, learning=False)
    if rrd is not None:
        write_timeline(rrd, opened.arm, opened.motions, loaded, opened.issues)
        console.print(f"timeline written to {rrd}")
    else:
        show_timeline(opened.arm, opened.motions, loaded, opened.issues)
    write_json(json_file, {"schema": "ident.view/1", "runs": [motion.name for motion in opened.motions]})


def main() -> None:
    """Runs the command; the user's mistakes end in one line and exit status 2."""
    try:
        status = app(standalone_mode=False)
    except InputError as error:
        print(f"ident: {error}".replace("\n", " "), file=sys.stderr)
        sys.exit(2)
    except typer.Abort:
        print("ident: stopped", file=sys.stderr)
        sys.exit(STOPPED)
    except Exception as error:
        if type(error).__module__.startswith(("click", "typer")) and hasattr(error, "format_message"):
            print(f"ident: {error.format_message().rstrip('.')}; see ident --help", file=sys.stderr)
            sys.exit(2)
        raise
    except KeyboardInterrupt:
        print("ident: stopped", file=sys.stderr)
        sys.exit(STOPPED)
    if status == STOPPED:  # typer turns Ctrl-C into this status
        print("ident: stopped", file=sys.stderr)
    sys.exit(status if isinstance(status, int) else 0)
