"""The command that closes the loop: `ident close`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import JsonFile, app, console
from ident.errors import visible
from ident.files import deliver, write_record
from ident.outputs import check_outputs


@app.command()
def close(
    out: Annotated[Path, typer.Option(help="Folder for close.json and each arm's diagnosis and patch.")],
    robot: Annotated[str, typer.Option(help="URDF path, tm5-900, or a name of example-robot-data.")] = "tm5-900",
    arms: Annotated[int, typer.Option(help="Simulated arms, each with three random effects.")] = 1,
    seed: Annotated[int, typer.Option(help="Of the first arm; the next ones count up.", min=0)] = 0,
    rounds: Annotated[int, typer.Option(help="Most rounds of recording an arm.")] = 8,
    effect: Annotated[list[str] | None, typer.Option(help="ID:JOINT:SIZE instead of random effects.")] = None,
    record: Annotated[
        str | None,
        typer.Option(help="Command that moves a real arm: {commands} and {session} in it become folders."),
    ] = None,
    compare: Annotated[bool, typer.Option(help="Make rivals of the same data, try a controller with each.")] = True,
    json_file: JsonFile = None,
) -> None:
    """Closes the gap: diagnose, patch, record what is open, and again, until only noise is left; tells the minutes."""
    from ident.api.closing import close as run

    check_outputs([robot], {"--json": json_file})
    found = run(
        robot,
        out,
        recorder=record,
        arms=arms,
        seed=seed,
        rounds=rounds,
        effects=tuple(effect) if effect else None,
        compared=compare,
        say=lambda line: console.print(visible(line), markup=False, highlight=False, soft_wrap=True),
    )

    def show() -> None:
        console.print(visible(found.summary(), lines=True), markup=False, highlight=False, soft_wrap=True)
        console.print(f"written to {out}", markup=False, soft_wrap=True)

    deliver(show, lambda: write_record(json_file, found.to_dict()))
