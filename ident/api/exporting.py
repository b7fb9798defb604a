"""Hands on what was identified: what `ident patch`, `ident export` and `ident verify` do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ident.api.diagnosing import gather_effects
from ident.command_options import ExportOptions, PatchOptions, VerifyOptions
from ident.diagnosis.result import Diagnosis
from ident.errors import InputError
from ident.export.identified import Diagnosed
from ident.export.promotion import Promotion, judge_model
from ident.export.write import write_export, write_patch
from ident.model.evaluation import evaluate
from ident.model.evaluation_limits import VERIFICATION_SCHEMA, Check, check_limits, load_limits
from ident.model.hybrid import HybridModel
from ident.motion.settings import FOR_DIAGNOSIS
from ident.records import JsonRecord, JsonTable
from ident.results import Provenance, Result, files_of, runs_of
from ident.sessions import Robot, Sources, load_robot, open_sessions


@dataclass(frozen=True, eq=False)
class Written(Result):
    """Files of an identified arm."""

    SHOWN_BY = "ident.export.printing"

    folder: Path  # where they lie
    record: JsonTable  # what `patch.json` or `export.json` holds

    @property
    def promoted(self) -> bool:
        """Whether all was written: nothing is where a file does not beat the URDF alone."""
        return bool(self.record.get("promotion", {"passed": True})["passed"])

    def to_dict(self) -> JsonRecord:
        return {**self.record, "provenance": self.provenance.to_dict()}


@dataclass(frozen=True, eq=False)
class Verification(Result):
    """A model, by its name, robot and joints, against limits."""

    SHOWN_BY = "ident.export.printing"

    model: str
    robot: str
    joints: tuple[str, ...]
    checks: tuple[Check, ...]  # every limit on every session
    promotion: Promotion  # whether it beats the URDF alone on them
    in_sample: bool  # whether the model was fitted on one of the recordings

    @property
    def passed(self) -> bool:
        """Whether it is promoted and keeps all limits, on recordings that it was not fitted to."""
        return self.promotion.passed and all(check.passed for check in self.checks)

    def to_dict(self) -> JsonRecord:
        return {
            "schema": VERIFICATION_SCHEMA,
            "model": self.model,
            "robot": self.robot,
            "joints": list(self.joints),
            "passed": self.passed,
            "in_sample": self.in_sample,
            "checks": [check.to_dict() for check in self.checks],
            "promotion": self.promotion.to_dict(),
            "provenance": self.provenance.to_dict(),
        }


def patch(
    diagnosis: Diagnosis | JsonTable | str | Path,
    robot: Robot,
    out: str | Path,
    **options: Any,
) -> Written:
    """What a diagnosis found as URDF, MJCF, parameter file and Python module, each loaded back.

    Args:
        diagnosis: A diagnosis, its record, or the file of `ident diagnose --json`.
        robot: The robot that was diagnosed.
        out: Folder of the patch.
        options: Fields of `ident.command_options.PatchOptions`: `on`, `into`, `catalogue`, `topic`,
            `session_file`.

    Raises:
        InputError: Nothing was identified, the diagnosis is of another robot, or the folder holds
            something else.
    """
    chosen = PatchOptions.of("patch", options)
    effects = gather_effects(chosen.catalogue)
    arm = load_robot(robot, ())
    if isinstance(diagnosis, str | Path):
        diagnosed = Diagnosed.load(Path(diagnosis), effects)
    elif isinstance(diagnosis, Diagnosis | Mapping):
        record = diagnosis.to_dict() if isinstance(diagnosis, Diagnosis) else dict(diagnosis)
        diagnosed = Diagnosed.of_record(record, effects)
    else:
        what = f"a {type(diagnosis).__name__} is no diagnosis"
        raise InputError("diagnosis", what, "give a Diagnosis, its record or its JSON file")
    opened = None
    if chosen.on is not None:
        # Filtered as what was diagnosed, as far as the rate allows it.
        motion = FOR_DIAGNOSIS.but(cutoff_hz=diagnosed.cutoff)
        opened = open_sessions(
            chosen.on,
            arm,
            chosen.topic,
            chosen.session_file,
            learning=False,
            accept=chosen.accept,
            motion=motion,
        )
        if opened.arm.joint_names != diagnosed.joints:
            what = f"its joints are {', '.join(opened.arm.joint_names)}, those of the diagnosis "
            session = opened.reports[0].session
            remedy = "give recordings of the joints that were diagnosed"
            raise InputError(
                session.path or session.name, what + ", ".join(diagnosed.joints), remedy
            )
    settings = {"diagnosis": diagnosed.path.name, "robot": arm.name}
    origin = Provenance(
        "ident patch", settings=settings, sessions=() if opened is None else opened.stamps
    )
    motions = () if opened is None else opened.motions
    return Written(
        Path(out),
        write_patch(diagnosed, arm, Path(out), motions, origin, chosen.into),
        provenance=origin,
    )


def export(model: HybridModel | str | Path, out: str | Path, **options: Any) -> Written:
    """What was identified, for others: files of simulators, trainers and controllers.

    Args:
        model: A fitted model or its folder.
        out: Folder of the export.
        options: Fields of `ident.command_options.ExportOptions`: `formats`, `nearest`, `on`,
            `in_sample`, `horizon`, `topic`, `session_file`, `accept`.

    Returns:
        What was written; nothing where a file does not beat the URDF alone (`promoted`).

    Raises:
        InputError: An unknown format, links that no body could be, or recordings that can't be
            used.
    """
    chosen = ExportOptions.of("export", options)
    loaded = HybridModel.given(model)
    opened = None
    if chosen.on is not None:
        opened = open_sessions(
            chosen.on,
            loaded,
            chosen.topic,
            chosen.session_file,
            learning=False,
            accept=chosen.accept,
        )
    settings = {
        "model": loaded.robot.name if loaded is model else str(model),
        "nearest": chosen.nearest,
    }
    origin = Provenance(
        "ident export", settings=settings, sessions=() if opened is None else opened.stamps
    )
    motions = () if opened is None else opened.motions
    record = write_export(loaded, Path(out), chosen, motions, origin)
    return Written(Path(out), record, provenance=origin)


def verify(
    model: HybridModel | str | Path,
    sessions: Sources,
    limits: str | Path | None = None,
    **options: Any,
) -> Verification:
    """A gate: whether a model beats the URDF alone on recordings of no fit, and keeps its limits.

    Args:
        model: A fitted model or its folder.
        sessions: The recordings.
        limits: A TOML file of limits; none if None.
        options: Fields of `ident.command_options.VerifyOptions`: `in_sample`, `horizon`,
            `cutoff`, `topic`, `session_file`, `accept`.

    Raises:
        InputError: Model, recordings or limits can't be used.
    """
    chosen = VerifyOptions.of("verify", options)
    loaded = HybridModel.given(model)
    wanted = None if limits is None else load_limits(Path(limits), loaded.joint_names, loaded.rungs)
    opened = open_sessions(
        sessions,
        loaded,
        chosen.topic,
        chosen.session_file,
        chosen.cutoff,
        learning=False,
        accept=chosen.accept,
    )
    name = loaded.robot.name if loaded is model else Path(str(model)).name
    checks: list[Check] = []
    if wanted is not None:
        for score in evaluate(loaded, opened.groups, name).sessions:
            checks += check_limits(score, wanted)
    seen = bool(files_of(loaded.provenance) & runs_of(opened.stamps))
    bounds = "" if limits is None else str(limits)
    settings = {"model": name, "limits": bounds, "horizon_s": chosen.horizon}
    origin = Provenance("ident verify", settings=settings, sessions=opened.stamps)
    promotion = judge_model(loaded, opened.motions, seen, chosen.in_sample, chosen.horizon)
    robot = loaded.robot.name
    joints = loaded.joint_names
    return Verification(name, robot, joints, tuple(checks), promotion, seen, provenance=origin)
