"""The `ident` command: parses, calls, prints."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import (
    Accept,
    Catalogue,
    Cutoff,
    JsonFile,
    Robot,
    SessionFile,
    Sessions,
    Topic,
    app,
    console,
    say_where,
)
from ident.console import styled
from ident.errors import InputError, plural
from ident.files import deliver, write_record
from ident.outputs import SESSION_KIND, absolute, check_outputs
from ident.process import run_command
from ident.show.console import LadderTable, print_effort, print_issues, progress_line


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for the model, the report and the timeline.")] = Path("out/demo"),
    logs: Annotated[Path | None, typer.Option(help="Recordings other than the shipped ones.")] = None,
    json_file: JsonFile = None,
) -> None:
    """The main job on the shipped recordings: fit, evaluate, report, timeline."""
    from ident.cli.demo import check_places, run_demo

    check_places(out, logs, json_file)
    write_record(json_file, run_demo(out, logs, console))


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
    from ident.api.inspecting import inspect as check

    places = mended_places(sessions, mend)
    check_outputs([*sessions, session_file, robot], {"--json": json_file}, places)
    found = check(sessions, robot, topic=topic, session_file=session_file)
    reports = found.reports

    def write_mended() -> None:
        for report, (place, _) in zip(reports, places.values(), strict=False):
            report.mend(place)

    def show() -> None:
        for report in reports:
            session = report.session
            size = f"{plural(len(session.runs), 'run')}, {session.samples} samples, {session.duration:.1f} s"
            console.print(f"{session.name}: {size}")
            print_effort(console, report.effort)
            print_issues(console, report.issues)
            console.print(report.verdict if report.is_fit else styled((report.verdict, "red")))

    deliver(show, write_mended, lambda: write_record(json_file, found.to_dict()))


def mended_places(sessions: list[Path], mend: Path | None) -> dict[str, tuple[Path, str]]:
    """Where each mended session goes: the folder itself, or one below it for each of several.

    Raises:
        InputError: Two sessions of one name.
    """
    if mend is None:
        return {}
    if len(sessions) == 1:
        return {"--mend": (mend, SESSION_KIND)}
    names = [absolute(path).name if path.is_dir() else path.stem for path in sessions]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"--mend {mend}", f"two sessions are called {twice!r}", "mend them one after the other")
    return {f"--mend {mend / name}:": (mend / name, SESSION_KIND) for name in names}


@app.command()
def fit(
    sessions: Sessions,
    out: Annotated[Path, typer.Option(help="Folder of the fitted model.")],
    robot: Robot = None,
    links: Annotated[int, typer.Option(help="6 for the full arm with all its joints, 3 for the lumped one.")] = 6,
    inertia: Annotated[str, typer.Option(help="nominal, base or consistent.")] = "consistent",
    net: Annotated[str, typer.Option(help="default, paper or none.")] = "default",
    offset: Annotated[bool, typer.Option(help="Fit a constant torque a joint too.")] = False,
    robust: Annotated[bool, typer.Option(help="Stretches that fit badly lose their pull.")] = False,
    seed: Annotated[int, typer.Option(help="Seed of the net.", min=0)] = 0,
    coupling: Annotated[
        str, typer.Option(help="Two joints on one motor's shaft, as 5,6; 5,-6 where they turn against each other.")
    ] = "",
    named: Annotated[
        Path | None, typer.Option("--with", help="JSON of a diagnosis: its laws of joints are fitted before the net.")
    ] = None,
    smoother: Annotated[str, typer.Option(help="fast, or filterpy: the same numbers, slowly.")] = "fast",
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    accept: Accept = None,
    json_file: JsonFile = None,
) -> None:
    """Fits analytic + loss + residual net; with a diagnosis, the laws that it names too."""
    from ident.api.fitting import fit_hybrid
    from ident.model.hybrid import MODEL_KIND, FitOptions
    from ident.model.net_options import remove_checkpoint
    from ident.sessions import open_sessions

    accepted = tuple(accept or ())
    options = FitOptions(links, inertia, net, offset, robust, seed, accepted, coupling, smoother)  # type: ignore[arg-type]
    check_outputs([*sessions, session_file, robot, named], {"--json": json_file}, {"--out": (out, MODEL_KIND)})
    opened = open_sessions(sessions, robot, topic, session_file, cutoff, accept=options.accept, motion=options.motion)
    print_issues(console, opened.issues)
    checkpoint = absolute(out).with_name(absolute(out).name + ".training")
    with progress_line(console, "fit"):
        results = fit_hybrid(opened, options=options, checkpoint=checkpoint, named=named)

    def show() -> None:
        console.print(results.summary(), soft_wrap=True)
        console.print(f"model written to {out}")

    deliver(show, lambda: write_record(json_file, results.to_dict()), lambda: results.model.save(out))
    remove_checkpoint(checkpoint)


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
    from ident.api.fitting import evaluate as score
    from ident.model.hybrid import HybridModel
    from ident.sessions import open_sessions

    check_outputs([*sessions, *model, session_file], {"--html": html, "--json": json_file})
    models = [(path.name, HybridModel.load(path)) for path in model]
    opened = [open_sessions(sessions, loaded, topic, session_file, cutoff, learning=False) for _, loaded in models]
    pairs = zip(models, opened, strict=True)
    results = [score(data, loaded, name=name) for (name, loaded), data in pairs]
    record = {
        "schema": "ident.evaluations/1",
        "robot": results[0].robot,
        "joints": list(results[0].pooled.joints),
        "models": [result.to_dict() for result in results],
        "provenance": results[0].provenance.to_dict(),
    }

    def write_page() -> None:
        if html is not None:
            from ident.show.report import write_evaluation_report

            write_evaluation_report(html, [loaded for _, loaded in models], results, opened[0].issues)

    def show() -> None:
        for result in results:
            console.print(styled((result.model, "bold")))
            for one in (*result.sessions, result.pooled) if len(result.sessions) > 1 else result.sessions:
                console.print(LadderTable(one))
        say_where(("report", html))

    deliver(show, lambda: write_record(json_file, record), write_page)


@app.command()
def diagnose(
    sessions: Sessions,
    robot: Robot = None,
    model: Annotated[Path | None, typer.Option(help="Model fitted to this arm: its inertias count as known.")] = None,
    catalogue: Catalogue = None,
    html: Annotated[Path | None, typer.Option(help="Write the page to this file.")] = None,
    rrd: Annotated[Path | None, typer.Option(help="Save the timeline, with the gap marked, to this file.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    seed: Annotated[int, typer.Option(help="Seed of the sign-flip tests.", min=0)] = 0,
    until: Annotated[
        float | None,
        typer.Option(help="Look at more and more runs until it is so sure (0.9, say), or tell what is missing."),
    ] = None,
    accept: Accept = None,
    settings: Annotated[Path | None, typer.Option(help="Numbers to decide by, in place of the usual ones.")] = None,
    json_file: JsonFile = None,
) -> None:
    """Where the gap lies, which effect causes it, how far it shrinks; or why that can't be told."""
    from ident.api.diagnosing import DiagnoseOptions, examine, examine_until
    from ident.api.fitting import evaluate as score
    from ident.diagnosis.settings import USUAL
    from ident.diagnosis.settings_file import read_settings
    from ident.show.terminal import gap_curves, gap_marks, print_diagnosis, print_looks

    read = [*sessions, robot, model, catalogue, session_file, settings]
    check_outputs(read, {"--html": html, "--rrd": rrd, "--json": json_file})
    chosen = USUAL if settings is None else read_settings(settings)
    options = DiagnoseOptions(model, catalogue, cutoff, seed, topic, session_file, accept or (), chosen)
    looks = None
    with progress_line(console, "diagnose"):
        if until is None:
            examined = examine(sessions, robot, options)
        else:
            examined, looks = examine_until(until, sessions, robot, options)
    diagnosis, analysis, loaded = examined.diagnosis, examined.analysis, examined.model
    record = {**diagnosis.to_dict(), **({} if looks is None else {"until": looks.to_dict()})}

    def write_page() -> None:
        if html is None:
            return
        from ident.show.report import DiagnosisInput, ReportInput, write_diagnosis_report
        from ident.show.report.laws import draw_laws

        evaluation = None
        if loaded is not None and analysis is not None:
            scored = score(sessions, loaded, topic=topic, session_file=session_file, cutoff=cutoff)
            evaluation = ReportInput((loaded,), (scored,), ())
        pictures = () if analysis is None else draw_laws(analysis)
        write_diagnosis_report(html, DiagnosisInput(record, pictures=pictures), evaluation)

    def write_rrd() -> None:
        if rrd is not None and analysis is not None:
            from ident.show.timeline import write_timeline

            marks, curves = gap_marks(analysis), gap_curves(analysis)
            write_timeline(rrd, analysis.baseline.nominal, examined.motions, loaded, diagnosis.telemetry, marks, curves)

    def show() -> None:
        print_diagnosis(console, record)
        if looks is not None:
            print_looks(console, looks)
        say_where(("page", html), ("timeline", None if analysis is None else rrd))

    deliver(show, lambda: write_record(json_file, record), write_page, write_rrd)


@app.command()
def patch(
    diagnosis: Annotated[Path, typer.Argument(help="The JSON of ident diagnose.", show_default=False)],
    robot: Annotated[str, typer.Option(help="The robot that was diagnosed: URDF path or name.")],
    out: Annotated[Path, typer.Option(help="Folder of the patch.")],
    on: Annotated[list[Path] | None, typer.Option(help="Sessions to measure it on.")] = None,
    into: Annotated[Path | None, typer.Option(help="Your own MJCF of this arm: a copy gets what was found.")] = None,
    catalogue: Catalogue = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    json_file: JsonFile = None,
) -> None:
    """The named effects for simulators: URDF, MJCF, parameter file and Python module, each loaded back."""
    from ident.api.patching import patch as write_patch
    from ident.export.printing import print_patch
    from ident.export.write import PATCH_KIND

    read = [diagnosis, robot, catalogue, *(on or ()), session_file, into]
    check_outputs(read, {"--json": json_file}, {"--out": (out, PATCH_KIND)})
    written = write_patch(
        diagnosis, robot, out, on=on or None, into=into, catalogue=catalogue, topic=topic, session_file=session_file
    )
    record = written.to_dict()
    deliver(lambda: print_patch(console, record, out), lambda: write_record(json_file, record))


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
    from ident.api.viewing import view as show

    check_outputs([*sessions, model, robot, session_file], {"--rrd": rrd, "--json": json_file})
    found = show(sessions, robot, model=model, rrd=rrd, topic=topic, session_file=session_file, cutoff=cutoff)
    deliver(lambda: say_where(("timeline", rrd)), lambda: write_record(json_file, found.to_dict()))


@app.command()
def schema(
    name: Annotated[str, typer.Argument(help="Kind of result file: diagnosis, fit, blind, …", show_default=False)],
) -> None:
    """The JSON Schema of a result file, on standard output."""
    from ident.schemas.publish import make_schema

    print(json.dumps(make_schema(name), indent=1))


# Their commands stand last in the list of commands.
from ident.cli import closing as _closing  # noqa: E402, F401
from ident.cli import compared as _compared  # noqa: E402, F401
from ident.cli import daily as _daily  # noqa: E402, F401
from ident.cli import identified as _identified  # noqa: E402, F401
from ident.cli import simulated as _simulated  # noqa: E402, F401


def main() -> None:
    """Runs the command; the user's mistakes end in one line and exit status 2."""
    run_command("ident", __name__)
