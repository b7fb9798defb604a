"""What the commands share: how an application is made, its options and console, and how results are written."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ident.console import make_console
from ident.outputs import STANDARD_OUTPUT
from ident.provenance import own_version

console = make_console()


def _tell_version(context: typer.Context, asked: bool) -> None:
    if asked:
        print(f"{context.find_root().command.name} (armgap) {own_version()}")
        raise typer.Exit


def make_app(name: str, purpose: str) -> typer.Typer:
    """An application that shows its help where no command is given, and knows `--version`.

    Args:
        name: The command's name.
        purpose: One sentence for its help.
    """
    app = typer.Typer(name=name, help=purpose, pretty_exceptions_enable=False, rich_markup_mode=None)

    @app.callback(invoke_without_command=True)
    def start(
        context: typer.Context,
        version: Annotated[
            bool, typer.Option("--version", help="Show the version and exit.", callback=_tell_version, is_eager=True)
        ] = False,
    ) -> None:
        if context.invoked_subcommand is None:
            print(context.get_help())

    return app


def _clear_output(context: typer.Context, path: Path | None) -> Path | None:
    """Where the record goes to standard output, all that is said goes to standard error until the command ends."""
    if path == STANDARD_OUTPUT:
        console.stderr = True
        context.call_on_close(lambda: setattr(console, "stderr", False))
    return path


app = make_app("ident", "Identify a robot arm, and find out why it does not move as its model says.")

Sessions = Annotated[list[Path], typer.Argument(help="Session folders, or single files.", show_default=False)]
Robot = Annotated[
    str | None,
    typer.Option("--robot", help="URDF path, tm5-900, or a name of example-robot-data (panda, baxter:left_w2, …)."),
]
JsonFile = Annotated[
    Path | None,
    typer.Option("--json", help="Write the results to this file; - is standard output.", callback=_clear_output),
]
Topic = Annotated[str, typer.Option(help="Topic of the joint states, for ROS 2 bags.")]
SessionFile = Annotated[Path | None, typer.Option(help="A session.toml, for folders that can't hold one.")]
Catalogue = Annotated[
    Path | None, typer.Option(help="A Python file with further effects. It is run: give none that you don't trust.")
]
Accept = Annotated[
    list[str] | None, typer.Option(help="Use the recordings although this issue refuses them; may be given again.")
]
Cutoff = Annotated[float | None, typer.Option(help="Corner of the filter for torques and columns [Hz].")]


def say_where(*written: tuple[str, Path | None]) -> None:
    for what, path in written:
        if path is not None and path.exists():
            console.print(f"{what} written to {path}", soft_wrap=True)
