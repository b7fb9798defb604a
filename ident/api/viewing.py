"""Shows recordings on Rerun's timeline: what `ident view` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.api.fitting import Model, load_model
from ident.options import FilterOptions
from ident.results import Provenance, Result
from ident.sessions import Robot, Sources, open_sessions
from ident.show import timeline


@dataclass(frozen=True, eq=False)
class View(Result):
    """What was shown.

    Attributes:
        robot: Name of the robot.
        joints: Joint names.
        runs: Names of the runs.
    """

    SCHEMA = "ident.view/1"

    robot: str
    joints: tuple[str, ...]
    runs: tuple[str, ...]


def view(
    source: Sources,
    robot: Robot | None = None,
    *,
    model: Model | None = None,
    rrd: str | Path | None = None,
    **reading: Any,
) -> View:
    """Measured torque against every rung of a model, residuals, energy, and the moving arm.

    Args:
        source: Folders or files of runs, sessions, or tables in memory.
        robot: URDF path, name or arm; that of the model or of session.toml if None.
        model: Model whose rungs are compared, or its folder; measured curves only if None.
        rrd: File for the timeline; Rerun's window is opened if None, and the call returns when it is closed.
        reading: Fields of `ident.options.FilterOptions`: `topic`, `session_file`, `cutoff`.

    Raises:
        InputError: Recordings, robot or model can't be used, or there is no screen.
    """
    if rrd is None:
        timeline.require_screen()
    read, loaded = FilterOptions.of("view", reading), None if model is None else load_model(model)
    opened = open_sessions(source, loaded or robot, **vars(read), learning=False)
    if rrd is None:
        timeline.show_timeline(opened.arm, opened.motions, loaded, opened.issues)
    else:
        timeline.write_timeline(rrd, opened.arm, opened.motions, loaded, opened.issues)
    named = str(model) if isinstance(model, str | Path) else None if loaded is None else loaded.robot.name
    origin = Provenance("ident view", settings={"model": named}, sessions=opened.stamps)
    runs = tuple(motion.name for motion in opened.motions)
    return View(opened.arm.name, opened.arm.joint_names, runs, provenance=origin)
