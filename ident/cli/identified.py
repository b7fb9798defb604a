"""The commands that take an identified arm on: `ident export`, `ident ranges` and `ident verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import Cutoff, JsonFile, Robot, SessionFile, Sessions, Topic, app, console
from ident.errors import visible
from ident.files import deliver, write_record
from ident.outputs import check_outputs
from ident.process import NOT_PASSED
from ident.results import Result

Model = Annotated[Path, typer.Argument(help="Folder of a fitted model.", show_default=False)]


@app.command()
def export(
    model: Model,
    out: Annotated[Path, typer.Option(help="Folder of the export.")],
    form: Annotated[
        list[str] | None,
        typer.Option("--format", help="urdf, mjcf, toml, python, isaaclab, ros2_control or cpp; all if not given."),
    ] = None,
    nearest: Annotated[bool, typer.Option(help="Write links that no body could be as the nearest bodies.")] = False,
    on: Annotated[list[Path] | None, typer.Option(help="Sessions to measure the files on.")] = None,
    into: Annotated[
        Path | None, typer.Option(help="Your own MJCF of this arm: a copy gets what was identified.")
    ] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    json_file: JsonFile = None,
) -> None:
    """What was identified, for others: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control."""
    from ident.api.exporting import export as write
    from ident.export.write import EXPORT_KIND, FILES

    check_outputs([model, *(on or ()), session_file, into], {"--json": json_file}, {"--out": (out, EXPORT_KIND)})
    formats = tuple(form or FILES)
    found = write(
        model, out, formats=formats, nearest=nearest, on=on or None, into=into, topic=topic, session_file=session_file
    )
    _deliver(found, json_file)


@app.command()
def ranges(
    sessions: Sessions,
    robot: Robot = None,
    model: Annotated[Path | None, typer.Option(help="Fitted model whose inertias all days refer to.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for randomisation files of Isaac Lab and MuJoCo Playground.")
    ] = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """Ranges for domain randomisation: each day a session; as wide as the arm changes, checked on days left out."""
    from ident.api.ranging import RANGES_KIND
    from ident.api.ranging import ranges as find

    check_outputs([model, *sessions, robot, session_file], {"--json": json_file}, {"--out": (out, RANGES_KIND)})
    _deliver(
        find(list(sessions), robot, model=model, out=out, topic=topic, session_file=session_file, cutoff=cutoff),
        json_file,
    )


@app.command()
def verify(
    model: Model,
    sessions: Sessions,
    limits: Annotated[Path, typer.Option(help="TOML file of limits: [torque_rmse_Nm] total = 2.0 and the like.")],
    in_sample: Annotated[bool, typer.Option(help="Accept recordings that the model was fitted on.")] = False,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """A gate: exit 0 where a model keeps its limits on recordings, 3 where it does not, or was fitted on them."""
    from ident.api.exporting import verify as check

    check_outputs([model, *sessions, limits, session_file], {"--json": json_file})
    found = check(model, sessions, limits, in_sample=in_sample, topic=topic, session_file=session_file, cutoff=cutoff)
    _deliver(found, json_file)
    if not found.passed:
        raise typer.Exit(NOT_PASSED)


def _deliver(found: Result, json_file: Path | None) -> None:
    words = visible(found.summary(), lines=True)
    deliver(
        lambda: console.print(words, markup=False, highlight=False, soft_wrap=True),
        lambda: write_record(json_file, found.to_dict()),
    )
