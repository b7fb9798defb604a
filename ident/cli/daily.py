"""The commands of a lab's daily work: `ident new`, `ident servo` and `ident watch`."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import JsonFile, Robot, Sessions, app, console, hand_over, takes
from ident.errors import InputError, visible
from ident.files import write_record
from ident.options import WatchOptions
from ident.outputs import SESSION_KIND, check_outputs
from ident.progress import stage, step
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
    from ident.api.starting import new as guess

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
    from ident.api.servo_arms import servo as find

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
    from ident.api.watching import watch as look
    from ident.monitor.folder import NoSession

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
