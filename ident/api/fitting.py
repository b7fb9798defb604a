"""Fits and scores hybrid models: what `ident fit` and `ident evaluate` do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ident.errors import ModelError
from ident.model import hybrid
from ident.model.hybrid import FitOptions, FitResults, HybridModel
from ident.model.named_fit import read_named_laws
from ident.progress import step
from ident.provenance import Provenance
from ident.recordings.load import TOPIC
from ident.sessions import Opened, Robot, Sources, open_sessions

if TYPE_CHECKING:
    from ident.model.evaluation import Evaluation

Model = HybridModel | str | Path


def fit_hybrid(
    source: Sources | Opened,
    robot: Robot | None = None,
    options: FitOptions | None = None,
    *,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
    checkpoint: Path | None = None,
    named: str | Path | None = None,
) -> FitResults:
    """Fits analytic + loss + named laws + residual net to recordings.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        robot: URDF path, name or arm; None takes the one named in session.toml.
        options: What is fitted.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the common filter [Hz].
        checkpoint: Folder in which the net's training may stop and go on.
        named: JSON of a diagnosis whose laws of joints are to be part of the model.

    Raises:
        InputError: Recordings, robot or diagnosis can't be used.
    """
    options = options or FitOptions()
    if isinstance(source, Opened):
        opened = source
    else:
        opened = open_sessions(source, robot, topic, session_file, cutoff, accept=options.accept, motion=options.motion)
    laws = None if named is None else read_named_laws(Path(named), opened.arm)
    data = opened.data_records()
    found = hybrid.fit_hybrid(opened.motions, opened.arm, options, data, step, checkpoint, laws)
    accepted = [issue.to_dict() for issue in opened.issues if issue.issue in options.accept]
    model = replace(found.model, provenance={**found.model.provenance, "accepted": accepted})
    found = replace(found, model=model)
    settings = {**vars(options), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    return found.with_provenance(Provenance("ident fit", settings=settings, sessions=opened.stamps))


fit = fit_hybrid  # as the command is called


def evaluate(
    source: Sources | Opened,
    model: Model,
    *,
    name: str | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    cutoff: float | None = None,
) -> Evaluation:
    """Scores every rung of a model's ladder on recordings that its fit did not see.

    Args:
        source: Folders or files of runs, sessions, tables in memory, or what `open_sessions` gave.
        model: The model, or its folder.
        name: Of the model in reports; that of its folder or robot if None.
        topic: Topic of bags.
        session_file: A session.toml for folders that can't hold one.
        cutoff: Corner of the common filter [Hz].

    Raises:
        InputError: Recordings or model can't be used.
    """
    from ident.model import evaluation

    loaded = load_model(model)
    opened = (
        source
        if isinstance(source, Opened)
        else open_sessions(source, loaded, topic, session_file, cutoff, learning=False)
    )
    named = name or (loaded.robot.name if isinstance(model, HybridModel) else Path(model).name)
    settings = {"model": str(named), "cutoff_hz": opened.motions[0].lowpass.cutoff}
    origin = Provenance("ident evaluate", settings=settings, sessions=opened.stamps)
    return evaluation.evaluate(loaded, opened.groups, named).with_provenance(origin)


def load_model(model: Model) -> HybridModel:
    """A model, or the one in a folder.

    Raises:
        ModelError: It is none, or can't be read.
    """
    if isinstance(model, HybridModel):
        return model
    if not isinstance(model, str | Path):
        raise ModelError("model", f"a {type(model).__name__} is no model", "give a HybridModel or its folder")
    return HybridModel.load(Path(model))
