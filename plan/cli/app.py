"""The `plan` command: parses, calls, prints."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ident.cli.shared import JsonFile, Writes, commands_of, console, hand_over, make_app
from ident.command_options import ROBOT_HELP
from ident.errors import InputError
from ident.outputs import check_outputs, remove_own_file
from ident.process import run_command
from ident.show.console import progress_line
from plan.command_options import CompareOptions, ExciteOptions, PaperOptions, SolveOptions

if TYPE_CHECKING:
    from plan.experiment.result import Excitation

app = make_app(
    "plan",
    "Plan energy- and time-optimal motions that keep clear of obstacles, on an identified arm.",
)
command = commands_of(app)
# Exit status where a task has no plan: neither done nor anybody's fault.
NO_PLAN = 3
# What a comparison's folder holds: all methods, and the best plan.
COMPARISON_FILES = ("comparison.png", "best.png", "best.rrd", "best.json")

SceneFile = Annotated[Path, typer.Argument(help="Scene file (TOML).", show_default=False)]
ModelFolder = Annotated[
    Path | None,
    typer.Option(
        "--model", help="Folder of a fitted model; the rigid arm without losses if not given."
    ),
]


@command
def solve(
    scene: SceneFile,
    options: SolveOptions,
    model: ModelFolder = None,
    json_file: JsonFile = None,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw motion and torques into this file (PNG, SVG)."),
        Writes(),
    ] = None,
    rrd: Annotated[
        Path | None, typer.Option(help="Write the motion as a Rerun recording."), Writes()
    ] = None,
    curve: Annotated[
        Path | None,
        typer.Option(
            help="Where the duration is free: least energy over duration, as PNG, SVG or CSV."
        ),
        Writes(),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Write the motion for a controller: .yaml (JointTrajectory), .tmscript (PVT), "
            ".script (URScript); or samples of it: .csv, .parquet."
        ),
        Writes(),
    ] = None,
    rate: Annotated[float, typer.Option(help="Rate of samples [Hz].")] = 250.0,
) -> None:
    """Finds one trajectory and certifies it."""
    began = time.perf_counter()
    before = time.process_time()
    from plan.problem.task_file import load_task

    task = load_task(
        scene
    )  # before anything heavy is loaded: a slip of the pen is reported at once
    from ident.compiled import compile_seconds
    from plan.api.planning import open_task, tell_compiling
    from plan.planners.base import budget_seconds

    if out is not None:
        from plan.problem.execution import (
            require_writable,
            write_motion_file,
        )  # brings the table formats along

        require_writable(out, rate)
    if picture is not None:
        from plan.show.pictures import draw_motion, require_picture, save_figure

        require_picture(picture)
    if curve is not None:
        from plan.show.pictures import require_curve, save_energy_curve

        require_curve(curve)
    opened = open_task(task, model, options)
    if curve is not None and opened.problem.longest is None:
        raise InputError(
            "--curve",
            "the task's duration is fixed",
            "give task.at_most_s or standby_W in its place",
        )
    controller = opened.controller(options, out)
    if options.beyond:  # before anything is planned
        console.print(opened.problem.notes[0], soft_wrap=True, highlight=False)
    with _progress(f"solve by {options.method}"):
        result = opened.solve(
            options, controller=controller, began=0.0
        )  # from the process's own start
    spent = (
        before + time.perf_counter() - began
    )  # loading Python and its libraries, all of it processor time, too
    result = replace(result, seconds=spent, cpu_seconds=budget_seconds())
    result = tell_compiling(result, compile_seconds())
    written = []

    def write_pictures() -> None:
        """Only of a motion; none of an earlier one is left in their place."""
        if result.splines is None or result.stands:
            for path in filter(None, (picture, rrd, curve)):
                remove_own_file(path)
            return
        if curve is not None:
            save_energy_curve(result, curve)
        if picture is not None:
            save_figure(draw_motion(opened.problem, result), picture)
        if rrd is not None:
            from plan.show.timeline import save_timeline

            save_timeline(opened.problem, result, rrd)

    def write_motion() -> None:
        """Where there is none, one of an earlier run is removed: a controller would take it for
        this task's.
        """
        if out is not None and result.solved:
            motion = write_motion_file(result, out, rate)
            longer = (
                f", {motion.longer:.3f} s longer than planned to start and end at rest"
                if motion.longer
                else ""
            )
            whose = f" for {motion.controller.name}" if motion.controller is not None else ""
            points = f"{len(motion.times)} points, {motion.duration:.4f} s{longer}"
            written.append(f"motion{whose} written to {out}: {points}")
        elif out is not None and remove_own_file(out):
            written.append(f"no motion: that of an earlier run is removed from {out}")

    hand_over(result, json_file, write_pictures, write_motion)
    for line in written:
        console.print(line, soft_wrap=True, highlight=False)
    if not result.solved:
        raise typer.Exit(NO_PLAN)


@command
def cycle(
    scene: SceneFile,
    options: SolveOptions,
    model: ModelFolder = None,
    json_file: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for samples of each motion (CSV), one file a leg.")
    ] = None,
    rate: Annotated[float, typer.Option(help="Rate of samples [Hz].")] = 250.0,
) -> None:
    """Plans a cycle of several motions as one task: stops, a load gripped and released, one
    duration for all.
    """
    from plan.problem.task_file import load_task

    task = load_task(scene)
    from plan.api.cycles import MOTIONS_KIND, write_motions
    from plan.api.cycles import cycle as plan_cycle

    check_outputs([scene, model], {"--json": json_file}, {"--out": (out, MOTIONS_KIND)})
    if out is not None:
        from plan.problem.execution import require_writable

        require_writable(Path("leg.csv"), rate)
    with _progress("cycle"):
        # From the process's own start.
        result = plan_cycle(task, model, began=0.0, **asdict(options))

    def write_folder() -> None:
        if out is not None and result.solved:
            write_motions(result, out, rate)

    hand_over(result, json_file, write_folder)
    if not result.solved:
        raise typer.Exit(NO_PLAN)


@command
def compare(
    scene: SceneFile,
    options: CompareOptions,
    model: ModelFolder = None,
    json_file: JsonFile = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the pictures and the Rerun recording.")
    ] = None,
) -> None:
    """Runs all methods on one task."""
    from plan.problem.task_file import load_task

    task = load_task(scene)
    from plan.api.planning import open_task

    written = (
        {} if out is None else {f"--out {out}: {name}": out / name for name in COMPARISON_FILES}
    )
    check_outputs([scene, model], {**written, "--json": json_file})
    opened = open_task(task, model, options)
    if options.beyond:
        console.print(opened.problem.notes[0], soft_wrap=True, highlight=False)
    with _progress("compare"):
        table = opened.compare(options)

    def write_folder() -> None:
        if out is None:
            return
        from plan.show.pictures import draw_comparison, draw_motion, save_figure
        from plan.show.timeline import save_timeline

        picture, motion, timeline, record = (out / name for name in COMPARISON_FILES)
        save_figure(draw_comparison(table), picture)
        best = table.best()
        if best is not None:
            save_figure(draw_motion(opened.problem, best), motion)
            save_timeline(opened.problem, best, timeline)
            best.save(record)

    hand_over(table, json_file, write_folder)


@command
def paper(
    options: PaperOptions,
    model: ModelFolder = None,
    out: Annotated[Path, typer.Option(help="Folder for the page and its pictures.")] = Path(
        "out/paper"
    ),
) -> None:
    """The paper's planning tables and figures beside ours, on one page."""
    from ident.model.hybrid import HybridModel
    from plan.paper.repeat import FILES, repeat_paper, write_page

    check_outputs([model], {f"--out {out}: {name}": out / name for name in FILES})
    fitted = None if model is None else HybridModel.load(model)
    with _progress("paper"):
        repeated = repeat_paper(fitted, options)
    console.print(f"page written to {write_page(repeated, out)}")


@command
def excite(
    options: ExciteOptions,
    robot: Annotated[str, typer.Option(help=f"{ROBOT_HELP}.")] = "tm5-900",
    diagnosis: Annotated[
        Path | None,
        typer.Option(help="File of `ident diagnose --json`: its open question, sizes and noise."),
    ] = None,
    catalogue: Annotated[
        Path | None,
        typer.Option(
            help="A Python file with further effects. It is run: give none that you don't trust."
        ),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for the motion's command files, one a run.")
    ] = None,
    capture: Annotated[
        str | None,
        typer.Option(
            help="With --out: slow test, warm-up, runs and held-out ones for a controller: "
            "its name, or csv."
        ),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """The next motion to record: what tells two effects apart, in the fewest minutes."""
    from plan.api.exciting import excite as find_motion
    from plan.experiment.result import MOTION_KIND

    check_outputs(
        [robot, diagnosis, catalogue, options.scene],
        {"--json": json_file},
        {"--out": (out, MOTION_KIND)},
    )
    write = _excite_writer(robot, out, capture)
    with _progress("excite"):
        asked = asdict(options)
        excitation = find_motion(robot, diagnosis=diagnosis, catalogue=catalogue, **asked)
    hand_over(excitation, json_file, lambda: None if write is None else write(excitation))
    if out is None:
        console.print("nothing written: give --out FOLDER for the motion's files")
        return
    console.print(f"motion written to {out}")
    if capture is not None:
        console.print(f"what to do with it, step by step: {out / 'capture.json'}")


def _progress(job: str) -> AbstractContextManager[None]:
    """Shows how far a job has come; what compiling takes foretells nothing of the rest.

    Args:
        job: The command's name.
    """
    from ident.compiled import working_clock

    return progress_line(console, job, working_clock)


def _excite_writer(
    robot: str, out: Path | None, capture: str | None
) -> Callable[[Excitation], object] | None:
    """What writes the motion's files; None where none are asked for.

    Raises:
        InputError: A capture without a folder, or for a controller that is not this arm's.
    """
    if capture is None:
        return None if out is None else lambda excitation: excitation.write(out)
    if out is None:
        raise InputError("--capture", "it needs a folder", "give --out FOLDER")
    from ident.sessions import load_robot
    from plan.experiment.capture import choose_format, write_capture

    controller = choose_format(capture, load_robot(robot, ()))
    return lambda excitation: write_capture(excitation, out, controller)


@app.command()
def schema(
    name: Annotated[
        str,
        typer.Argument(
            help="Kind of result file: result, cycle, comparison or excite.", show_default=False
        ),
    ],
) -> None:
    """The JSON Schema of a result file, on standard output."""
    from ident.schemas.publish import make_schema

    print(json.dumps(make_schema(name, "plan"), indent=1))


def main() -> None:
    """Runs the command; the user's mistakes end in one line and exit status 2."""
    run_command("plan", __name__)
