"""The `ident` command: parses, calls, prints."""

from __future__ import annotations

import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

import ident.command_options as given
from ident.cli.shared import (
    READS,
    Html,
    JsonFile,
    Model,
    Robot,
    Sessions,
    Writes,
    app,
    command,
    console,
    hand_over,
)
from ident.errors import InputError
from ident.outputs import SESSION_KIND, absolute, check_outputs
from ident.process import NOT_PASSED, run_command
from ident.results import Result
from ident.show.console import print_issues, progress_line


@command
def demo(
    out: Annotated[
        Path, typer.Option(help="Folder for the model, the report and the timeline.")
    ] = Path("out/demo"),
    logs: Annotated[
        Path | None, typer.Option(help="Recordings other than the shipped ones.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """The main job on the shipped recordings: fit, evaluate, report, timeline."""
    from ident.cli.demo import run_demo

    run_demo(out, logs, json_file, console)


@command
def inspect(
    sessions: Sessions,
    options: given.ReadOptions,
    robot: Robot = None,
    mend: Annotated[
        Path | None, typer.Option(help="Write the mended sessions into this folder.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Checks the telemetry before anything is fitted."""
    from ident.api.inspecting import inspect as check

    # Each mended session goes into the folder itself, or into one below it for each of several.
    names = [absolute(path).name if path.is_dir() else path.stem for path in sessions]
    places = {}
    if mend is not None:
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise InputError(
                f"--mend {mend}",
                f"two sessions are called {twice!r}",
                "mend them one after the other",
            )
        several = {f"--mend {mend / name}:": (mend / name, SESSION_KIND) for name in names}
        places = several if len(names) > 1 else {"--mend": (mend, SESSION_KIND)}
    check_outputs([*sessions, options.session_file, robot], {"--json": json_file}, places)
    checked = check(sessions, robot, **vars(options))

    def write_mended() -> None:
        for report, (place, _) in zip(checked.reports, places.values(), strict=False):
            report.mend(place)

    hand_over(checked, json_file, write_mended)


@command
def fit(
    sessions: Sessions,
    out: Annotated[Path, typer.Option(help="Folder of the fitted model."), Writes("model")],
    options: given.FitOptions,
    reading: given.FilterOptions,
    robot: Robot = None,
    named: Annotated[
        Path | None,
        typer.Option("--with", help="JSON of a diagnosis: what it names is part of the model."),
    ] = None,
    html: Html = None,
    json_file: JsonFile = None,
) -> None:
    """Fits rigid body + losses + residual net; with a diagnosis, the laws that it names too."""
    from ident.api.fitting import fit_hybrid
    from ident.sessions import lock_still, open_sessions

    if options.net != "none":
        import_module("safetensors")  # that a net can't be saved is told before it is fitted
    options = replace(options, accept=reading.accept)  # the model's provenance holds it
    opened = lock_still(open_sessions(sessions, robot, **vars(reading), motion=options.motion))
    print_issues(console, [issue.to_dict() for issue in opened.issues])
    checkpoint = absolute(out).with_name(absolute(out).name + ".training")
    with progress_line(console, "fit"):
        results = fit_hybrid(
            opened, options=options, checkpoint=checkpoint, named=named, recordings=sessions
        )

    def write_page() -> None:
        if html is not None:
            from ident.show.report.fit_page import write_fit_report

            write_fit_report(html, results, opened.motions, opened.issues)

    hand_over(
        results,
        json_file,
        lambda: results.model.save(out),
        write_page,
        places={"page": html, "model (its URDF: `ident export`)": out},
    )
    if checkpoint.exists():
        from ident.model.net_options import remove_checkpoint

        remove_checkpoint(checkpoint)


@command
def evaluate(
    sessions: Annotated[
        list[Path],
        typer.Argument(
            help="Fitted models, then sessions, as folders or files.", show_default=False
        ),
    ],
    options: given.FilterOptions,
    model: Annotated[
        list[Path] | None,
        typer.Option(help="Folder of a fitted model, if not given first; several are compared."),
    ] = None,
    html: Html = None,
    json_file: JsonFile = None,
) -> None:
    """Energy error and torque RMSE of every rung of the ladder, on runs that the fit did
    not see.
    """
    from ident.api.fitting import Evaluations
    from ident.api.fitting import evaluate as score
    from ident.model.hybrid import HybridModel, split_models
    from ident.sessions import open_sessions

    folders, sessions = split_models(sessions, model or [])
    models = [(path.name, HybridModel.load(path)) for path in folders]
    opened = [
        open_sessions(sessions, loaded, **vars(options), learning=False) for _, loaded in models
    ]
    pairs = zip(models, opened, strict=True)
    evaluations = [score(data, loaded, name=name) for (name, loaded), data in pairs]
    results = Evaluations(tuple(evaluations))

    def write_page() -> None:
        if html is not None:
            from ident.show.report.evaluation import write_evaluation_report

            write_evaluation_report(
                html, [loaded for _, loaded in models], results.models, opened[0].issues
            )

    hand_over(results, json_file, write_page, places={"report": html})


@command
def diagnose(
    sessions: Sessions,
    options: given.DiagnoseOptions,
    robot: Robot = None,
    html: Html = None,
    rrd: Annotated[
        Path | None,
        typer.Option(help="Save the timeline, with the gap marked, to this file."),
        Writes(),
    ] = None,
    until: Annotated[
        float | None,
        typer.Option(
            help="Look at more and more runs until it is so sure (0.9, say), or tell what is "
            "missing."
        ),
    ] = None,
    details: Annotated[
        bool,
        typer.Option(
            "--details", help="Print all: parameters, doubts, what these recordings can't show."
        ),
    ] = False,
    json_file: JsonFile = None,
) -> None:
    """What is wrong with the model and what to do: where the gap lies, its cause, your URDF's
    numbers and the arm's.
    """
    from ident.api.diagnosing import examine, examine_until
    from ident.show.diagnosis_lines import PATCH, patch_call, print_diagnosis

    with progress_line(console, "diagnose"):
        if until is None:
            examined = examine(sessions, robot, options)
        else:
            examined = examine_until(until, sessions, robot, options)
    diagnosis = examined.diagnosis

    def write_page() -> None:
        if html is not None:
            from ident.cli.diagnosis_files import write_diagnosis_page

            write_diagnosis_page(html, examined, sessions, options)

    def write_rrd() -> None:
        if rrd is not None:
            from ident.cli.diagnosis_files import write_gap_timeline

            write_gap_timeline(rrd, examined)

    def tell() -> None:
        call = PATCH if robot is None else patch_call(str(robot), sessions, json_file, options)
        print_diagnosis(console, diagnosis.to_dict(), details, call)

    places = {"page": html, "timeline": None if examined.analysis is None else rrd}
    hand_over(diagnosis, json_file, write_page, write_rrd, places=places, tell=tell)


@command
def patch(
    diagnosis: Annotated[
        Path, typer.Argument(help="The JSON of ident diagnose.", show_default=False)
    ],
    robot: Annotated[
        str, typer.Option(help=f"The robot that was diagnosed: {given.ROBOT_HELP}."), READS
    ],
    out: Annotated[Path, typer.Option(help="Folder of the patch."), Writes("patch")],
    options: given.PatchOptions,
) -> Result:
    """What was found for simulators, a cause named or not: URDF, MJCF, parameters, Python; into
    your own file too.
    """
    from ident.api.exporting import patch as write

    return write(diagnosis, robot, out, **vars(options))


@command
def view(
    sessions: Sessions,
    options: given.FilterOptions,
    model: Annotated[Path | None, typer.Option(help="Folder of a fitted model.")] = None,
    robot: Robot = None,
    rrd: Annotated[
        Path | None,
        typer.Option(help="Save the timeline to this file instead of opening it."),
        Writes(),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """The Rerun timeline: measured torque against every rung, residuals, energy, the moving arm."""
    from ident.api.fitting import view as show

    hand_over(
        show(sessions, robot, model=model, rrd=rrd, **vars(options)),
        json_file,
        places={"timeline": rrd},
    )


@command
def open_(
    log: Annotated[
        Path | None, typer.Argument(help="Session folder or file; may be given on the page.")
    ] = None,
    robot: Annotated[
        str | None, typer.Argument(help=f"{given.ROBOT_HELP}; may be given on the page."), READS
    ] = None,
    port: Annotated[
        int, typer.Option(help="Port on this machine; any free one if 0.", min=0, max=65535)
    ] = 0,
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open it in the browser.")
    ] = True,
) -> None:
    """A page in your browser: drop a log and a URDF, check, diagnose, take the files.

    Runs on this machine alone.
    """
    from ident.local_page.server import open_page

    def tell(address: str) -> None:
        console.print(f"{address}  (Ctrl-C ends it)", soft_wrap=True)
        console.file.flush()

    open_page(log, robot, port, browser, tell)


@app.command()
def schema(
    name: Annotated[
        str,
        typer.Argument(help="Kind of result file: diagnosis, fit, blind, …", show_default=False),
    ],
) -> None:
    """The JSON Schema of a result file, on standard output."""
    from ident.schemas.publish import make_schema

    print(json.dumps(make_schema(name), indent=1))


@command
def compare(
    before: Annotated[
        list[Path],
        typer.Argument(
            help="Sessions before, as folders or files; the second of two is after.",
            show_default=False,
        ),
    ],
    options: given.ComparisonOptions,
    after: Annotated[
        list[Path] | None, typer.Option(help="Sessions after, where either set has several.")
    ] = None,
    robot: Robot = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for the result file and the page."),
        Writes("comparison"),
    ] = None,
    html: Html = None,
    details: Annotated[
        bool,
        typer.Option(
            "--details", help="Print all: sizes, doubts, what these recordings can't show."
        ),
    ] = False,
    json_file: JsonFile = None,
) -> None:
    """What changed between two sets of sessions of one arm: at which joint, by how much."""
    from ident.api.diagnosing import compare as compare_sets
    from ident.files import atomic_folder
    from ident.show.report.diagnosis_pages import render_comparison_report
    from ident.show.report.page import save_page
    from ident.show.terminal import print_comparison

    if not after and len(before) != 2:
        what = f"{len(before)} sessions and no --after: it is open which of them are the later ones"
        raise InputError("compare", what, "give two sessions, or BEFORE … --after AFTER --after …")
    earlier, later = (before, after) if after else (before[:1], before[1:])
    with progress_line(console, "compare"):
        comparison = compare_sets(earlier, later, robot, **vars(options))
    page = "" if html is None and out is None else render_comparison_report(comparison.to_dict())

    def write_page() -> None:
        if html is not None:
            save_page(html, page)

    def write_folder() -> None:
        if out is not None:
            with atomic_folder(out, "comparison") as folder:
                comparison.save(folder / "comparison.json")
                (folder / "comparison.html").write_text(page, encoding="utf-8")

    hand_over(
        comparison,
        json_file,
        write_page,
        write_folder,
        places={"page": html, "result and page": out},
        tell=lambda: print_comparison(console, comparison.to_dict(), details),
    )


@command
def export(
    model: Model,
    out: Annotated[Path, typer.Option(help="Folder of the export."), Writes("export")],
    options: given.ExportOptions,
    json_file: JsonFile = None,
) -> None:
    """What was identified, for others; with --on only where it beats the URDF (else exit 3)."""
    from ident.api.exporting import export as write

    written = write(model, out, **vars(options))
    hand_over(written, json_file)
    if not written.promoted:
        raise typer.Exit(NOT_PASSED)


@command
def ranges(sessions: Sessions, options: given.RangesOptions, robot: Robot = None) -> Result:
    """Ranges for domain randomisation: each day a session; as wide as the arm changes, checked on
    days left out.
    """
    from ident.api.daily import ranges as find

    return find(sessions, robot, **vars(options))


@command
def verify(
    model: Model,
    sessions: Sessions,
    options: given.VerifyOptions,
    limits: Annotated[
        Path | None,
        typer.Option(help="TOML file of limits: [torque_rmse_Nm] total = 2.0 and the like."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """A gate: exit 0 where a model beats the URDF alone on recordings and keeps limits, else 3."""
    from ident.api.exporting import verify as check

    verification = check(model, sessions, limits, **vars(options))
    hand_over(verification, json_file)
    if not verification.passed:
        raise typer.Exit(NOT_PASSED)


# Its commands stand last in the list of commands.
from ident.cli import simulated as _simulated  # noqa: E402, F401


def main() -> None:
    """Runs the command; the user's mistakes end in one line and exit status 2."""
    run_command("ident", __name__)
