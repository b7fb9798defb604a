"""What all commands of `ident` share: the application, its options and console, and how results are written."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any

import typer

from ident.console import make_console
from ident.files import atomic_write

app = typer.Typer(
    name="ident",
    help="Identify a robot arm, and find out why it does not move as its model says.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)
console = make_console()

Sessions = Annotated[list[Path], typer.Argument(help="Session folders, or single files.", show_default=False)]
Robot = Annotated[
    str | None,
    typer.Option("--robot", help="URDF path, tm5-900, or a name of example-robot-data (panda, baxter:left_w2, …)."),
]
JsonFile = Annotated[Path | None, typer.Option("--json", help="Write the results to this file.")]
Topic = Annotated[str, typer.Option(help="Topic of the joint states, for ROS 2 bags.")]
SessionFile = Annotated[Path | None, typer.Option(help="A session.toml, for folders that can't hold one.")]
Catalogue = Annotated[
    Path | None, typer.Option(help="A Python file with further effects. It is run: give none that you don't trust.")
]
Accept = Annotated[
    list[str] | None, typer.Option(help="Use the recordings although this issue refuses them; may be given again.")
]
Cutoff = Annotated[float | None, typer.Option(help="Corner of the filter for torques and columns [Hz].")]


def write_json(path: Path | None, record: dict[str, Any]) -> None:
    """Writes a result file, whole or not at all."""
    if path is not None:
        with atomic_write(path) as part:
            part.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def say_where(*written: tuple[str, Path | None]) -> None:
    for what, path in written:
        if path is not None and path.exists():
            console.print(f"{what} written to {path}", soft_wrap=True)
