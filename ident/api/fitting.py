"""Fits, scores and shows hybrid models: what `ident fit`, `ident evaluate` and `ident view` do."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from threadpoolctl import threadpool_limits

from ident.command_options import FilterOptions, FitOptions
from ident.errors import InputError
from ident.fitting import fit as fitting
from ident.fitting.fit import FitResults
from ident.fitting.named_laws import NamedLaws, read_named_laws, take_laws
from ident.laws.acting import KNOWN
from ident.laws.carried import KINDS
from ident.model.carried import CarriedEffect
from ident.model.hybrid import HybridModel
from ident.progress import step
from ident.results import Provenance, Result, files_of, runs_of
from ident.robot.arm import ArmModel
from ident.sessions import Opened, Robot, Sources, lock_still, open_sessions

if TYPE_CHECKING:
    from ident.export.identified import Diagnosed
    from ident.model.evaluation import Evaluation

Model = HybridModel | str | Path
# Probability from which on `--laws auto` takes a name: at most one in five of such names is wrong.
SURE = 0.8


def fit_hybrid(
    source: Sources | Opened,
    robot: Robot | None = None,
    options: FitOptions | None = None,
    *,
    checkpoint: Path | None = None,
    named: str | Path | None = None,
    recordings: Sources | None = None,
    **reading: Any,
) -> FitResults:
    """Fits analytic + loss + named laws + residual net to recordings.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: What is fitted.
        checkpoint: Folder in which the net's training may stop and go on.
        named: JSON of a diagnosis whose names are to be part of the model.
        recordings: What `laws="auto"` diagnoses where the source is opened already.
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`,
            `accept`.

    Raises:
        InputError: Recordings, robot or diagnosis can't be used.
    """
    options = options or FitOptions()
    read = FilterOptions.of("fit", reading)
    accept = (*read.accept, *options.accept)
    opened = (
        source
        if isinstance(source, Opened)
        else open_sessions(source, robot, **{**vars(read), "accept": accept}, motion=options.motion)
    )
    opened = lock_still(opened)
    laws = (
        None
        if named is None
        else with_carried(Path(named), opened.arm, read_named_laws(Path(named), opened.arm))
    )
    if options.laws == "auto" and named is None:
        laws = sure_laws(source if recordings is None else recordings, opened.arm, read)
    # Sums over threads differ in their last digits from one number of threads to another.
    with threadpool_limits(limits=1, user_api="blas"):
        fitted = fitting.fit_hybrid(
            opened.motions, opened.arm, options, opened.data_records(), step, checkpoint, laws
        )
    accepted = [issue.to_dict() for issue in opened.issues if issue.issue in accept]
    model = replace(fitted.model, provenance={**fitted.model.provenance, "accepted": accepted})
    fitted = replace(fitted, model=model)
    settings = {**vars(options), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    return fitted.with_provenance(
        Provenance("ident fit", settings=settings, sessions=opened.stamps)
    )


def with_carried(path: Path, arm: ArmModel, laws: NamedLaws) -> NamedLaws:
    """Beside friction's laws what else a diagnosis names, as far as its law is known.

    Args:
        path: What `ident diagnose --json` wrote.
        arm: The arm that is to be fitted.
        laws: Its laws of friction, and what was left out.
    """
    from ident.export.identified import Diagnosed
    from ident.safe_read import read_record

    record = read_record(path, ("ident.diagnosis/1",), "give the JSON of `ident diagnose`")
    return _carry(Diagnosed.of_record(record, path=path, needed=False), arm, laws)


def _carry(diagnosed: Diagnosed, arm: ArmModel, laws: NamedLaws) -> NamedLaws:
    carried = []
    left_out = []
    for change in diagnosed.changes:
        if change.effect in KINDS:
            continue
        place = -1 if change.joint < 0 else arm.joint_names.index(change.joints[0])
        if change.effect in KNOWN:
            sizes = change.parameters.items()
            known = {name: size for name, size in sizes if size.low < size.high}
            ends = {name: (size.low, size.high) for name, size in known.items()}
            carried.append(CarriedEffect(change.effect, place, change.values, ends))
        else:
            left_out.append(f"{change.effect} of {', '.join(change.joints)}: no model carries it")
    remaining = tuple(text for text in laws.left_out if "carries friction alone" not in text)
    return NamedLaws(laws.laws, (*remaining, *left_out), tuple(carried))


def sure_laws(source: Sources | Opened, arm: ArmModel, read: FilterOptions) -> NamedLaws | None:
    """What a diagnosis of the same recordings is sure of; None where it names nothing so surely.

    Args:
        source: The recordings.
        arm: The arm that is to be fitted.
        read: How the recordings are read.

    Raises:
        InputError: They were opened already, and are no recordings any more.
    """
    from ident.api.diagnosing import diagnose
    from ident.export.identified import Diagnosed

    if isinstance(source, Opened):
        raise InputError(
            "laws",
            "opened sessions can't be diagnosed",
            "give `recordings`, or laws of a diagnosis",
        )
    record = diagnose(source, arm, **vars(read)).to_dict()
    sure = [finding for finding in record["findings"] if finding.get("probability", 1.0) >= SURE]
    if not sure:
        return None
    record = {**record, "findings": sure}
    laws = take_laws(record, arm, Path("diagnosis"))
    return _carry(Diagnosed.of_record(record, needed=False), arm, laws)


fit = fit_hybrid  # as the command is called


def evaluate(
    source: Sources | Opened, model: Model, *, name: str | None = None, **reading: Any
) -> Evaluation:
    """Scores every rung of a model's ladder on recordings that its fit did not see.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        model: The model, or its folder.
        name: Of the model in reports; that of its folder or robot if None.
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`,
            `accept`.

    Raises:
        InputError: Recordings or model can't be used.
    """
    from ident.model import evaluation

    loaded = HybridModel.given(model)
    read = FilterOptions.of("evaluate", reading)
    opened = (
        source
        if isinstance(source, Opened)
        else open_sessions(source, loaded, **vars(read), learning=False)
    )
    named = name or (loaded.robot.name if isinstance(model, HybridModel) else Path(model).name)
    settings = {"model": str(named), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    origin = Provenance("ident evaluate", settings=settings, sessions=opened.stamps)
    evaluated = evaluation.evaluate(loaded, opened.groups, named)
    fitted = len(runs_of(opened.stamps) & files_of(loaded.provenance))
    return replace(evaluated, fitted_files=fitted).with_provenance(origin)


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
            "models": [evaluation.to_dict() for evaluation in self.models],
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
        rrd: File for the timeline; Rerun's window is opened if None, and the call returns when it
            is closed.
        reading: Fields of `ident.command_options.FilterOptions`: `topic`, `session_file`, `cutoff`,
            `accept`.

    Raises:
        InputError: Recordings, robot or model can't be used, or there is no screen.
    """
    from ident.show.timeline import writing as timeline

    if rrd is None:
        timeline.require_screen()
    read = FilterOptions.of("view", reading)
    loaded = None if model is None else HybridModel.given(model)
    opened = open_sessions(source, loaded or robot, **vars(read), learning=False)
    if rrd is None:
        timeline.show_timeline(opened.arm, opened.motions, loaded, opened.issues)
    else:
        timeline.write_timeline(rrd, opened.arm, opened.motions, loaded, opened.issues)
    named = (
        str(model)
        if isinstance(model, str | Path)
        else None
        if loaded is None
        else loaded.robot.name
    )
    origin = Provenance("ident view", settings={"model": named}, sessions=opened.stamps)
    runs = tuple(motion.name for motion in opened.motions)
    return View(opened.arm.name, opened.arm.joint_names, runs, provenance=origin)
