"""The commands of a lab's daily work: `ident new`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import JsonFile, Robot, app, console, write_json
from ident.errors import visible
from ident.files import deliver
from ident.ownership import SESSION_KIND, check_outputs
from ident.show.console import print_issues


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

    def show() -> None:
        console.print(visible(found.summary(), lines=True), markup=False, highlight=False, soft_wrap=True)
        if found.report is not None:
            print_issues(console, found.report.issues)
        console.print(f"written to {found.file}: look through it, then `ident inspect`", markup=False, soft_wrap=True)

    deliver(show, lambda: write_json(json_file, found.to_dict()))
