"""Fits, scores and shows hybrid models: what `ident fit`, `ident evaluate` and `ident view` do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from ident.command_options import FilterOptions, FitOptions
from ident.fitting import fit as fitting
from ident.fitting.fit import FitResults, read_named_laws
from ident.model.hybrid import HybridModel
from ident.progress import step
from ident.results import Provenance, Result
from ident.sessions import Opened, Robot, Sources, open_sessions

if TYPE_CHECKING:
    from ident.model.evaluation import Evaluation

Model = HybridModel | str | Path


def fit_hybrid(
    source: Sources | Opened,
    robot: Robot | None = None,
    options: FitOptions | None = None,
    *,
    checkpoint: Path | None = None,
    named: str | Path | None = None,
    **reading: Any,
) -> FitResults:
    """Fits analytic + loss + named laws + residual net to recordings.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: What is fitted.
        checkpoint: Folder in which the net's training may stop and go on.
        named: JSON of a diagnosis whose laws of joints are to be part of the model.
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`, `accept`.

    Raises:
        InputError: Recordings, robot or diagnosis can't be used.
    """
    options, read = options or FitOptions(), FilterOptions.of("fit", reading)
    accept = (*read.accept, *options.accept)
    opened = (
        source
        if isinstance(source, Opened)
        else open_sessions(source, robot, **{**vars(read), "accept": accept}, motion=options.motion)
    )
    laws = None if named is None else read_named_laws(Path(named), opened.arm)
    # Sums over threads differ in their last digits from one number of threads to another.
    with threadpool_limits(limits=1, user_api="blas"):
        found = fitting.fit_hybrid(opened.motions, opened.arm, options, opened.data_records(), step, checkpoint, laws)
    accepted = [issue.to_dict() for issue in opened.issues if issue.issue in accept]
    model = replace(found.model, provenance={**found.model.provenance, "accepted": accepted})
    found = replace(found, model=model)
    settings = {**vars(options), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    return found.with_provenance(Provenance("ident fit", settings=settings, sessions=opened.stamps))


fit = fit_hybrid  # as the command is called


def evaluate(source: Sources | Opened, model: Model, *, name: str | None = None, **reading: Any) -> Evaluation:
    """Scores every rung of a model's ladder on recordings that its fit did not see.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        model: The model, or its folder.
        name: Of the model in reports; that of its folder or robot if None.
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`, `accept`.

    Raises:
        InputError: Recordings or model can't be used.
    """
    from ident.model import evaluation

    loaded, read = HybridModel.given(model), FilterOptions.of("evaluate", reading)
    opened = source if isinstance(source, Opened) else open_sessions(source, loaded, **vars(read), learning=False)
    named = name or (loaded.robot.name if isinstance(model, HybridModel) else Path(model).name)
    settings = {"model": str(named), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    origin = Provenance("ident evaluate", settings=settings, sessions=opened.stamps)
    return evaluation.evaluate(loaded, opened.groups, named).with_provenance(origin)


@dataclass(frozen=True, eq=False)
class Evaluations(Result):
    """Scores of several models on the same recordings."""

    models: tuple[Evaluation, ...]  # of each

    def to_dict(self) -> dict[str, Any]:
        first = self.models[0]
        return {
            "schema": "ident.evaluations/1",
            "robot": first.robot,
            "joints": list(first.pooled.joints),
            "models": [one.to_dict() for one in self.models],
            "provenance": first.provenance.to_dict(),
        }


@dataclass(frozen=True, eq=False)
class View(Result):
    """What was shown."""

    SCHEMA = "ident.view/1"

    robot: str  # name of the robot
    joints: tuple[str, ...]  # joint names
    runs: tuple[str, ...]  # names of the runs


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
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`, `accept`.

    Raises:
        InputError: Recordings, robot or model can't be used, or there is no screen.
    """
    from ident.show.timeline import writing as timeline

    if rrd is None:
        timeline.require_screen()
    read, loaded = FilterOptions.of("view", reading), None if model is None else HybridModel.given(model)
    opened = open_sessions(source, loaded or robot, **vars(read), learning=False)
    if rrd is None:
        timeline.show_timeline(opened.arm, opened.motions, loaded, opened.issues)
    else:
        timeline.write_timeline(rrd, opened.arm, opened.motions, loaded, opened.issues)
    named = str(model) if isinstance(model, str | Path) else None if loaded is None else loaded.robot.name
    origin = Provenance("ident view", settings={"model": named}, sessions=opened.stamps)
    runs = tuple(motion.name for motion in opened.motions)
    return View(opened.arm.name, opened.arm.joint_names, runs, provenance=origin)
