"""The commands that take an identified arm on: `ident export`, `ident ranges` and `ident verify`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ident.cli.shared import Cutoff, JsonFile, Robot, SessionFile, Sessions, Topic, app, console, write_json
from ident.errors import visible
from ident.exit_status import NOT_PASSED
from ident.files import deliver
from ident.ownership import check_outputs
from ident.provenance import Provenance

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
    from ident.model.hybrid import HybridModel
    from ident.opening import open_for_model
    from ident.patches.export import EXPORT_KIND, FILES, write_export

    check_outputs([model, *(on or ()), session_file, into], {"--json": json_file}, {"--out": (out, EXPORT_KIND)})
    loaded = HybridModel.load(model)
    opened = open_for_model(on, loaded, topic, session_file) if on else None
    stamps = () if opened is None else opened.stamps
    origin = Provenance("ident export", settings={"model": model, "nearest": nearest}, sessions=stamps)
    motions = () if opened is None else opened.motions
    record = write_export(loaded, out, tuple(form or FILES), nearest, motions, into, origin)

    def show() -> None:
        for name, found in record["loaded_back"].items():
            error = found.get("torque_difference_Nm")
            told = "" if error is None else f", torque within {error:.1e} N m of the model's"
            console.print(f"{FILES[name]}: loaded back{told}", highlight=False)
        for name, error in record.get("torque_rmse_Nm", {}).items():
            console.print(f"{FILES[name]}: torque RMSE {error['before']:.3f} -> {error['after']:.3f} N m")
        if "merged" in record:
            far = record["merged"]["torque_difference_Nm"]
            console.print(
                f"merged.xml: your {into} with what was identified, torque within {far:.1e} N m", markup=False
            )
        if record["changed_links"]:
            console.print(f"nearest bodies written for: {', '.join(record['changed_links'])}", markup=False)
        for line in record["left_out"]:
            console.print(f"left out: {line}")
        console.print(f"written to {out}", markup=False, soft_wrap=True)

    deliver(show, lambda: write_json(json_file, record))


@app.command()
def ranges(
    sessions: Sessions,
    robot: Robot = None,
    model: Annotated[Path | None, typer.Option(help="Fitted model whose inertias all days refer to.")] = None,
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """Ranges for domain randomisation: each day a session; as wide as the arm changes, checked on days left out."""
    from ident.api.ranging import ranges as find

    check_outputs([model, *sessions, robot, session_file], {"--json": json_file})
    found = find(list(sessions), robot, model=model, topic=topic, session_file=session_file, cutoff=cutoff)
    words = visible(found.summary(), lines=True)
    deliver(
        lambda: console.print(words, markup=False, highlight=False, soft_wrap=True),
        lambda: write_json(json_file, found.to_dict()),
    )


@app.command()
def verify(
    model: Model,
    sessions: Sessions,
    limits: Annotated[Path, typer.Option(help="TOML file of limits: [torque_rmse_Nm] total = 2.0 and the like.")],
    topic: Topic = "/joint_states",
    session_file: SessionFile = None,
    cutoff: Cutoff = None,
    json_file: JsonFile = None,
) -> None:
    """A gate: exit 0 where a model keeps its limits on recordings, 3 where it does not."""
    from ident.model.evaluation import evaluate
    from ident.model.hybrid import HybridModel
    from ident.model.limits import SCHEMA, load_limits
    from ident.opening import open_for_model

    check_outputs([model, *sessions, limits, session_file], {"--json": json_file})
    loaded = HybridModel.load(model)
    wanted = load_limits(limits, loaded.joint_names, loaded.rungs)
    opened = open_for_model(sessions, loaded, topic, session_file, cutoff)
    scores = evaluate(loaded, opened.groups, model.name).sessions
    checks = [check for score in scores for check in wanted.check(score)]
    passed = all(check.passed for check in checks)
    record = {
        "schema": SCHEMA,
        "model": model.name,
        "robot": loaded.robot.name,
        "joints": list(loaded.joint_names),
        "passed": passed,
        "checks": [check.to_dict() for check in checks],
        "provenance": Provenance(
            "ident verify", settings={"model": model, "limits": limits}, sessions=opened.stamps
        ).to_dict(),
    }

    def show() -> None:
        for check in checks:
            value = "not told by these recordings" if check.value is None else f"{check.value:.4g}"
            place = f"{check.session}: {check.limit.figure} {check.limit.joint}"
            mark = "kept" if check.passed else "NOT KEPT"
            console.print(f"{place}: {value}, limit {check.limit.bound:g}: {mark}", markup=False, highlight=False)
        console.print("passed" if passed else "not passed")

    deliver(show, lambda: write_json(json_file, record))
    if not passed:
        raise typer.Exit(NOT_PASSED)
