"""Diagnoses recordings, and compares two sets of one arm: what `ident diagnose` and `ident compare`
do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

from ident.checks.inspection import inspect_sessions
from ident.checks.report import MENDED_BY_A_FIT, as_mounted, check_accepted, overrule
from ident.command_options import ComparisonOptions, DiagnoseOptions
from ident.diagnosis.diagnose import Analysis
from ident.diagnosis.from_reports import diagnose_reports
from ident.diagnosis.result import Diagnosis
from ident.diagnosis.settings import USUAL, DiagnosisSettings
from ident.effects.base import Effect
from ident.effects.catalogue import CATALOGUE, load_catalogue
from ident.errors import InputError
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.recordings import TOPIC
from ident.recordings.recording import Session
from ident.results import Provenance, stamp_sessions
from ident.sessions import Given, Robot, Sources, inspect_sources, load_robot

if TYPE_CHECKING:
    from ident.diagnosis.change.result import ArmComparison

Catalogue = str | Path | Sequence[Effect]


class Examined(NamedTuple):
    """A diagnosis and what it was made from, for pages and timelines."""

    diagnosis: Diagnosis  # the diagnosis
    analysis: Analysis | None  # all that was computed on the way; None where nothing was
    motions: Sequence[Motion]  # the runs
    model: HybridModel | None  # the user's own model, if one was given


def diagnose(
    source: Sources,
    robot: Robot | None = None,
    *,
    model: HybridModel | str | Path | None = None,
    catalogue: Catalogue | None = None,
    cutoff: float | None = None,
    seed: int = 0,
    accept: Sequence[str] = (),
    settings: DiagnosisSettings | None = None,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
) -> Diagnosis:
    """Where the gap lies, which effect causes it, how far it shrinks; or why that can't be tested.

    Args:
        source: Folders or files of runs, sessions, or tables in memory (the runs of one session).
        robot: URDF path, name or arm; None takes the one named in session.toml.
        model: A model fitted to this arm, or its folder: its inertias count as known.
        catalogue: Further effects: a Python file, or objects.
        cutoff: Corner of the filter for torques and columns [Hz]; as the recordings allow it if
            None.
        seed: Of the sign flips by which the map of the gap is tested.
        accept: Issues of the telemetry that are to refuse nothing.
        settings: The numbers by which it is decided; as shipped if None.
        topic: Of the joint states, in ROS 2 bags.
        session_file: A session.toml, for folders that can't hold one.

    Raises:
        InputError: Recordings, robot, model or effects can't be used, or an issue that can't be
            accepted.
    """
    options = DiagnoseOptions(
        model=model,
        catalogue=catalogue,
        cutoff=cutoff,
        seed=seed,
        accept=tuple(accept),
        settings=settings,
        topic=topic,
        session_file=None if session_file is None else Path(session_file),
    )
    return examine(source, robot, options).diagnosis


# Its matrices are small: threads of BLAS would wait for each other, on a busy machine five times as
# long.
@threadpool_limits.wrap(limits=1, user_api="blas")
def examine(source: Sources, robot: Robot | None, options: DiagnoseOptions) -> Examined:
    """A diagnosis with all that pages and timelines need, as `diagnose` makes it.

    Raises:
        InputError: Recordings, robot or options can't be used.
    """
    model = options.model
    settings = options.settings or USUAL
    seed = options.seed
    if not isinstance(settings, DiagnosisSettings):
        raise InputError(
            "settings",
            f"a {type(settings).__name__} is no settings",
            "give an ident.DiagnosisSettings",
        )
    loaded = None if model is None else HybridModel.given(model)
    effects = gather_effects(options.catalogue)
    given = Given(source, robot, options.topic, options.session_file)
    mended = MENDED_BY_A_FIT if loaded is not None and loaded.inertia != "nominal" else ()
    read = inspect_sources(
        given, options.accept, settings.telemetry, in_parts=True, reported=mended
    )
    arm = read.arm
    if loaded is not None:
        loaded.require_robot(arm, "model" if isinstance(model, HybridModel) else str(model))
    diagnosis, analysis, motions = diagnose_reports(
        read.reports, arm, effects, options.cutoff, seed, loaded, settings
    )
    chosen = {
        "cutoff_hz": motions[0].lowpass.cutoff
        if motions
        else options.cutoff or settings.motion.cutoff_hz,
        "seed": seed,
        "model": None
        if loaded is None
        else loaded.robot.name
        if isinstance(model, HybridModel)
        else str(model),
        "effects": [effect.id for effect in effects],
        "diagnosis": settings.to_dict(),
        "accepted": list(options.accept),
        "gravity_mps2": None
        if analysis is None
        else analysis.baseline.nominal.model.gravity.linear.tolist(),
        "arm_sha256": arm.keeping(diagnosis.joints).content,
    }
    origin = Provenance("ident diagnose", settings=chosen, sessions=read.ledger.stamps)
    return Examined(diagnosis.with_provenance(origin), analysis, motions, loaded)


def examine_until(
    sure: float, source: Sources, robot: Robot | None, options: DiagnoseOptions
) -> Examined:
    """Looks at more and more runs, in their order, until the diagnosis is sure or no run is left.

    Args:
        sure: Least probability of every name.
        source, robot: As for `diagnose`.
        options: How each look is made.

    Returns:
        The last look with all that pages need; its diagnosis holds what all looks found.
    """
    from ident.diagnosis.sequential import diagnose_sequentially

    sessions = tuple(Given(source, robot, options.topic, options.session_file).parts())
    examined: list[Examined] = []

    def look(runs: int) -> Diagnosis:
        analysis = examine(first_runs(sessions, runs), robot, replace(options, session_file=None))
        examined[:] = [analysis]
        return analysis.diagnosis

    total = sum(len(session.runs) for session in sessions)
    looks = diagnose_sequentially(look, total, sure)
    (last,) = examined
    return last._replace(diagnosis=replace(last.diagnosis, until=looks))


def first_runs(sessions: Sequence[Session], count: int) -> list[Session]:
    """The sessions with the first `count` of their runs together, those without any left out."""
    beginnings = []
    for session in sessions:
        if session.runs and count > 0:
            beginnings.append(session.replace(runs=session.runs[:count]))
            count -= len(session.runs)
    return beginnings


def gather_effects(catalogue: Catalogue | None) -> tuple[Effect, ...]:
    """The catalogue, and after it a user's own effects.

    Args:
        catalogue: A Python file whose effects are taken, or effects themselves; None for none.

    Raises:
        InputError: The file can't be run, what was given are no effects, or an id is taken.
    """
    if catalogue is None or isinstance(catalogue, str | Path):
        return load_catalogue(None if catalogue is None else Path(catalogue))
    further = tuple(catalogue)
    for effect in further:
        if not isinstance(effect, Effect):
            what = f"a {type(effect).__name__} is no effect"
            raise InputError(
                "catalogue", what, "give objects of subclasses of ident.Effect, or a Python file"
            )
        if effect.id in {known.id for known in CATALOGUE}:
            raise InputError(
                "catalogue", f"the id {effect.id!r} is taken", "give the effect another id"
            )
    return (*CATALOGUE, *further)


def compare(
    before: Sources,
    after: Sources,
    robot: Robot | None = None,
    *,
    cutoff: float | None = None,
    seed: int = 0,
    topic: str = TOPIC,
    session_file: str | Path | None = None,
    accept: Sequence[str] = (),
) -> ArmComparison:
    """What changed between two sets of recordings of one arm, at which joint, by how much; or why
    that can't be tested.

    Args:
        before, after: Folders or files of runs, sessions, or tables in memory (the runs of one
            session).
        robot: URDF path, name or arm; None takes the one named in session.toml. Its numbers may be
            wrong.
        cutoff: Corner of the filter for torques and columns [Hz].
        seed: Of how runs are dealt into sets between which nothing changed.
        topic: Of the joint states, in ROS 2 bags.
        session_file: A session.toml, for folders that can't hold one.
        accept: Fatal telemetry issues by id that are to be overruled.

    Raises:
        InputError: Recordings or robot can't be used, or an issue that can't be accepted.
    """
    # a diagnosis needs nothing of it
    from ident.diagnosis.change.from_reports import compare_reports

    file = None if session_file is None else Path(session_file)
    chosen = ComparisonOptions(
        cutoff=cutoff, seed=seed, topic=topic, session_file=file, accept=tuple(accept)
    )
    earlier, later = (
        tuple(Given(side, None, chosen.topic, chosen.session_file).parts())
        for side in (before, after)
    )
    arm = load_robot(robot, (*earlier, *later))
    accepted = check_accepted(chosen.accept)
    reports = [overrule(report, accepted) for report in inspect_sessions((*earlier, *later), arm)]
    arm = as_mounted(arm, reports[0].session)
    comparison = compare_reports(
        reports[: len(earlier)], reports[len(earlier) :], arm, chosen.cutoff, chosen.seed
    )
    used = None if np.isnan(comparison.cutoff) else comparison.cutoff
    settings: dict[str, Any] = {
        "cutoff_hz": used,
        "seed": chosen.seed,
        "robot": arm.name,
        "sessions_before": len(earlier),
        "accepted": list(accepted),
    }
    settings["arm_sha256"] = arm.keeping(comparison.joints).content
    stamps = stamp_sessions((*earlier, *later))
    return comparison.with_provenance(
        Provenance("ident compare", settings=settings, sessions=stamps)
    )
