"""Commands of a lab's daily work and of the simulated arm."""

from __future__ import annotations

import shlex
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import (
    READS,
    Html,
    JsonFile,
    Robot,
    Sessions,
    Writes,
    command,
    console,
    hand_over,
)
from ident.command_options import (
    ROBOT_HELP,
    BoardOptions,
    CheckOptions,
    CloseOptions,
    SimulateOptions,
    WatchOptions,
)
from ident.errors import InputError, visible
from ident.files import write_record
from ident.outputs import SESSION_KIND
from ident.progress import stage, step
from ident.results import Result
from ident.show.console import progress_line, say


@command
def new(
    session: Annotated[
        Path, typer.Argument(help="Folder of tables, or one table, bag or data set.")
    ],
    robot: Robot = None,
    rate: Annotated[
        float | None, typer.Option(help="Samples a second, where no column is time [Hz].")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Looks at a foreign table and writes a session.toml with its guesses, each with its
    evidence.
    """
    from ident.api.daily import new as guess

    hand_over(guessed := guess(session, robot, rate=rate), json_file)
    then = ["ident", "inspect" if guessed.has_effort else "servo", str(session)]
    then += [] if robot is None else ["--robot", robot]
    words = f"written to {guessed.file}: look through it, then `{shlex.join(then)}`"
    say(console, words)


@command
def servo(
    sessions: Sessions,
    robot: Robot = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Corner of the filter for all signals [Hz].")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Folder for models that roll out: MuJoCo, BAM, mjlab."),
        Writes("servo"),
    ] = None,
    html: Html = None,
    json_file: JsonFile = None,
) -> None:
    """Arms that log goal and position only: lag, delay, dead band, droop, gain, and what can't be
    determined.
    """
    from ident.api.daily import servo as find

    check = find(sessions, robot, cutoff=cutoff, out=out)

    def write_page() -> None:
        if html is not None:
            from ident.show.report.servo_page import write_servo_report

            write_servo_report(html, check)

    places = {"page": html, "models (MuJoCo: servo.xml; BAM, mjlab beside it)": out}
    hand_over(check, json_file, write_page, places=places)


@command
def watch(
    folder: Annotated[
        Path, typer.Argument(help="Folder of sessions, or of arms that hold sessions.")
    ],
    store: Annotated[Path, typer.Option(help="Folder of the results: tables, diagnoses, pages.")],
    options: WatchOptions,
    once: Annotated[
        bool, typer.Option("--once", help="Look once and end, as cron wants it.")
    ] = False,
    every: Annotated[
        float, typer.Option(help="Look again after so many seconds.", min=1e-3)
    ] = 60.0,
    json_file: JsonFile = None,
) -> None:
    """Follows arms through time: new sessions as they come, figures over dates, alarms, a page for
    each arm.
    """
    from ident.api.daily import watch as look
    from ident.monitor.store import NoSession

    shown = ""
    while True:
        try:
            with progress_line(console, "watch"):
                stage("sessions")
                watched = look(folder, store, **vars(options), progress=step)
        except NoSession as error:
            if once:
                raise
            words = f"{error.where}: no session yet"
        else:
            words = f"{watched.summary()}\nwritten to {store}; look at {store / 'index.html'}"
            write_record(json_file, watched.to_dict())
        if words != shown:
            console.print(visible(words, lines=True), highlight=False, soft_wrap=True)
        if once:
            return
        shown = words
        time.sleep(every)


# The commands of the simulated arm.


@command
def simulate(
    out: Annotated[
        Path, typer.Option(help="Folder of the simulated session."), Writes(SESSION_KIND)
    ],
    options: SimulateOptions,
) -> Result:
    """A session of the simulated arm, its effects chosen."""
    from ident.api.simulating import simulate_into

    with progress_line(console, "simulate"):
        return simulate_into(out, options)


@command
def blind(
    options: CheckOptions,
    semi_real: Annotated[
        Path | None, typer.Option(help="Real recordings to which known effects are added.")
    ] = None,
    mix: Annotated[
        str, typer.Option(help="Kinds of case and their shares: single=20,healthy=5,…")
    ] = "",
    corpus: Annotated[
        Path | None, typer.Option(help="Make, diagnose and score a stored corpus in this folder.")
    ] = None,
    calibrate: Annotated[
        Path | None, typer.Option(help="Fit the probabilities to this stored corpus.")
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """The check on withheld effects: draws, simulates, seals, diagnoses from the recordings alone,
    scores.
    """
    from ident.benchmark.cases import FULL_MIX, parse_mix
    from ident.benchmark.real_check import check_on_real
    from ident.benchmark.run import BlindOptions, run_blind

    if corpus is not None or calibrate is not None:
        _corpus(options, semi_real, corpus, calibrate, json_file)
        return
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


def _corpus(
    options: CheckOptions,
    recordings: Path | None,
    corpus: Path | None,
    calibrate: Path | None,
    json_file: Path | None,
) -> None:
    """What a stored corpus is asked for."""
    from ident.benchmark.corpus_check import calibrate_corpus, check_corpus
    from ident.benchmark.run import BlindOptions

    if corpus is not None and calibrate is not None:
        raise InputError(
            "--calibrate",
            "a corpus to be made and one to be fitted",
            "make it first, then calibrate",
        )
    with progress_line(console, "blind"):
        if calibrate is not None:
            report: Result = calibrate_corpus(calibrate, options.seed)
        else:
            assert corpus is not None
            report = check_corpus(
                corpus,
                recordings,
                BlindOptions(**vars(options)),
                lambda line: console.print(line, soft_wrap=True, highlight=False),
                lambda words, done, total: stage(words, done / max(total, 1)),
            )
    hand_over(report, json_file)


@command
def board(
    job: Annotated[str, typer.Argument(help="make, answer, seal or score.", show_default=False)],
    folder: Annotated[Path, typer.Argument(help="Folder of the board.", show_default=False)],
    options: BoardOptions,
    answers: Annotated[
        Path | None,
        typer.Argument(
            help="answer writes this folder; seal and score read it: one entrant's, or one each."
        ),
    ] = None,
    html: Html = None,
    json_file: JsonFile = None,
) -> None:
    """A public board: sessions without answers, sealed truths, and scores of whoever answers."""
    from ident.benchmark.board.jobs import run_job
    from ident.benchmark.board.report import render_board
    from ident.show.report.page import save_page

    if html is not None and job != "score":
        raise InputError("--html", f"{job} has no page", "give it to: ident board score")
    with progress_line(console, "board"):
        report = run_job(
            job,
            folder,
            answers,
            options,
            lambda line: console.print(visible(line), soft_wrap=True, highlight=False),
            lambda done, total: stage("sessions", done / max(total, 1)),
        )

    def write_page() -> None:
        if html is not None:
            save_page(
                html, render_board(report.record | {"provenance": report.provenance.to_dict()})
            )

    hand_over(report, json_file, write_page, places={"page": html})


@command
def close(
    out: Annotated[
        Path, typer.Option(help="Folder for close.json and each arm's diagnosis and patch.")
    ],
    options: CloseOptions,
    robot: Annotated[str, typer.Option(help=f"{ROBOT_HELP}."), READS] = "tm5-900",
    json_file: JsonFile = None,
) -> None:
    """Closes the gap: diagnose, patch, record what is open, and again, until only noise is left;
    tells the minutes.
    """
    from ident.api.simulating import close as run

    def say(line: str) -> None:
        console.print(visible(line), highlight=False, soft_wrap=True)

    hand_over(run(robot, out, say=say, **vars(options)), json_file)
    console.print(f"written to {out}", soft_wrap=True)
