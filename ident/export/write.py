"""`ident patch` and `ident export`: an identified arm as files, each loaded back and measured.

Formats: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control and more; one writer each, and all
take the same arm. A folder appears whole or not at all.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from ident.command_options import ExportOptions
from ident.errors import InputError
from ident.export.arm_files import ArmFiles
from ident.export.controllers import write_cpp, write_isaac, write_limits, write_parameters
from ident.export.formats import LOADED
from ident.export.friction_files import (
    FEED_FORWARD,
    UR,
    check_feed_forward,
    write_feed_forward,
    write_ur,
)
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.into import is_mjcf, require_as_read, require_loadable, save_into, write_into
from ident.export.learned import FILE as LEARNED
from ident.export.learned import has_learned, write_learned
from ident.export.loaded import FILE_OF, Loading
from ident.export.newton import FILE as NEWTON
from ident.export.newton import check_newton, write_newton
from ident.export.onnx_model import FILE as ONNX
from ident.export.onnx_model import compare_onnx, write_onnx
from ident.export.own_file import read_own_file
from ident.export.promotion import REMEDY, Promotion, tool_of
from ident.export.told import notes_on_arm, notes_on_losses, notes_on_model
from ident.files import atomic_folder
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.records import JsonRecord, as_json
from ident.results import Provenance, files_of, runs_of
from ident.robot.arm import ArmModel

PATCH = "ident.patch/1"
EXPORT = "ident.export/1"
PATCH_KIND = "patch"
EXPORT_KIND = "export"
PATCH_MODULE = "extra_torque.py"
PATCH_FILES = ("robot.urdf", "robot.xml", "parameters.toml", PATCH_MODULE, "patch.json")
FILES = {
    **FILE_OF,
    "toml": "parameters.toml",
    "python": "torque_model.py",
    "isaaclab": "isaaclab.py",
    "ros2_control": "joint_limits.yaml",
    "cpp": "torque_model.hpp",
    "onnx": ONNX,
    "newton": NEWTON,
    "feedforward": FEED_FORWARD,
    "ur": UR,
}
# Written where asked for: they need a package more, or hold less than every model has.
BY_REQUEST = ("onnx", "ur")
USUAL = tuple(name for name in FILES if name not in BY_REQUEST)
WRITERS = {
    "isaaclab": write_isaac,
    "ros2_control": write_limits,
    "cpp": write_cpp,
    "newton": write_newton,
    "feedforward": write_feed_forward,
    "ur": write_ur,
}
# Of the formats above, what loads a file back and measures it.
CHECKS = {"newton": check_newton, "feedforward": check_feed_forward}
NO_READER = "nothing here loads it back"
NOT_TUNED = "not in the diagnosis: losses and tuned inertias are zero"


def write_patch(
    diagnosed: Diagnosed,
    robot: ArmModel,
    out: Path,
    motions: Sequence[Motion] = (),
    provenance: Provenance | None = None,
    into: Path | None = None,
) -> JsonRecord:
    """Writes the patch of a diagnosis.

    Args:
        diagnosed: The diagnosis.
        robot: The robot that it was made with.
        out: Folder of the patch; an earlier patch there is replaced.
        motions: Recordings to measure it on; none for the structural check alone.
        provenance: Where it comes from.
        into: The user's own URDF or MJCF, into which it is written as well; the folder keeps the
            file as it was.

    Returns:
        What `patch.json` holds.

    Raises:
        InputError: Another robot's diagnosis, or the folder holds something else.
    """
    candidates = diagnosed.candidates(robot)
    identified = candidates["after"]
    origin = provenance or Provenance("ident patch")
    edited = b""
    with atomic_folder(out, PATCH_KIND) as folder, tempfile.TemporaryDirectory() as scratch:
        files = ArmFiles(candidates, motions, folder, Path(scratch))
        files.write_loaded(LOADED)
        parameters = write_parameters(
            identified,
            candidates["tuned"].losses,
            urdf=files.losses_of_urdf(),
            figures=diagnosed.identified,
        )
        files.write("parameters.toml", parameters)
        files.write(PATCH_MODULE, files.module())
        effects = files.effects()
        loaded_back = files.loaded_back(PATCH_MODULE)
        in_sample = bool(diagnosed.runs & runs_of(origin.sessions))
        measured = files.measured(PATCH_MODULE, in_sample)
        record: JsonRecord = {
            "schema": PATCH,
            "robot": files.nominal.name,
            "joints": list(files.nominal.joint_names),
            "diagnosis": diagnosed.path.name,
            "verdict": diagnosed.verdict,
            "baseline": "tuned" if diagnosed.has_baseline else NOT_TUNED,
            "files": list(PATCH_FILES),
            "effects": effects,
            "identified": dict(diagnosed.identified),
            "told": notes_on_arm(identified, PATCH_MODULE) + measured.notes,
            "structure": loaded_back,
            **measured.record,
            "provenance": origin.to_dict(),
        }
        slides = [
            name
            for name, is_slide in zip(record["joints"], files.nominal.sliding_joints, strict=True)
            if is_slide
        ]
        if slides:
            record["slides"] = slides
        if into is not None:
            theirs = read_own_file(into)
            stated = files.stated("mjcf" if is_mjcf(into, theirs) else "urdf")
            edited, written = write_into(into, theirs, stated)
            require_loadable(into, edited, written)
            record["into"] = written.to_dict()
            (folder / f"before_{into.name}").write_bytes(theirs)
            require_as_read(into, theirs)
        files.write("patch.json", as_json(record) + "\n")
    if into is not None:
        save_into(into, theirs, edited)
    return record


def write_export(
    model: HybridModel,
    out: Path,
    chosen: ExportOptions | None = None,
    motions: Sequence[Motion] = (),
    origin: Provenance | None = None,
) -> JsonRecord:
    """Writes the arm of a fitted model; with recordings, only what beats the URDF alone on them.

    Args:
        model: The fitted model.
        out: Folder; an earlier export there is replaced.
        chosen: Which of `FILES`, the usual ones if it doesn't say; whether links that no body could
            be are written as the nearest bodies; whether recordings of the fit are accepted, and
            how long it is replayed.
        motions: As of `write_patch`.
        origin: Where it comes from.

    Returns:
        What `export.json` holds; without files where one is not promoted: the folder is as it was.

    Raises:
        InputError: An unknown format, or links that no body could be.
    """
    options = chosen or ExportOptions()
    formats = _formats(options)
    candidates = IdentifiedArm.of_models(model, options.nearest)
    identified = candidates["after"]
    origin = origin or Provenance("ident export")
    module = FILES["python"] if "python" in formats else None
    selected = [motion.select(model.joint_names) for motion in motions]
    with (
        suppress(_NotPromoted),
        atomic_folder(out, EXPORT_KIND) as folder,
        tempfile.TemporaryDirectory() as scratch,
    ):
        files = ArmFiles(candidates, selected, folder, Path(scratch))
        names = _write_formats(files, model, formats)
        loaded_back = files.loaded_back(module) | _load_back(files, model, formats)
        in_sample = bool(files_of(model.provenance) & runs_of(origin.sessions))
        measured = files.measured(module, in_sample)
        losses_alone = [FILES[name] for name in formats if name in WRITERS]
        notes = [
            *notes_on_arm(identified, FILES["python"]),
            *notes_on_model(model),
            *notes_on_losses(identified, losses_alone),
            *measured.notes,
        ]
        record: JsonRecord = {
            "schema": EXPORT,
            "robot": model.robot.name,
            "joints": list(model.joint_names),
            "files": names,
            "changed_links": list(identified.links.mended),
            "left_out": notes,
            "loaded_back": loaded_back,
        }
        if files.chosen:
            record["torque_rmse_Nm"] = _torque_errors(files)
        record |= measured.record
        record["provenance"] = origin.to_dict()
        if motions:
            contests = tuple(files.contests(model, formats, options.horizon))
            tool = tool_of(files.nominal)
            promotion = Promotion(contests, options.horizon, tool, in_sample, options.in_sample)
            record["promotion"] = promotion.to_dict()
            if not promotion.passed:
                record["files"] = []
                notes.append(REMEDY)
                raise _NotPromoted
        files.write("export.json", as_json(record) + "\n")
    return record


class _NotPromoted(Exception):
    """A file does not beat the URDF alone: the folder that was begun is not to be kept."""


def _formats(options: ExportOptions) -> tuple[str, ...]:
    """The formats that are asked for, or the usual ones.

    Raises:
        InputError: One is unknown.
    """
    if options.formats is None:
        return USUAL
    for name in options.formats:
        if name not in FILES:
            remedy = f"use one of: {', '.join(FILES)}"
            raise InputError("--format", f"{name!r} is unknown", remedy)
    return tuple(options.formats)


def _write_formats(files: ArmFiles, model: HybridModel, formats: Sequence[str]) -> list[str]:
    """Writes a model's files; their names, what it learned in a file of its own last."""
    files.write_loaded([name for name in LOADED if name in formats])
    for name in formats:
        if name == "toml":
            urdf = files.losses_of_urdf()
            text = write_parameters(files.identified, estimates=model.figures, urdf=urdf)
            files.write(FILES[name], text)
        elif name == "onnx":
            (files.folder / ONNX).write_bytes(write_onnx(model))
        elif name == "python":
            files.write(FILES[name], files.module())
        elif name not in LOADED:
            files.write(FILES[name], WRITERS[name](files.stated("losses")))
    names = [FILES[name] for name in formats]
    if "cpp" in formats and has_learned(model):
        files.write(LEARNED, write_learned(model))
        names.append(LEARNED)
    return names


def _load_back(files: ArmFiles, model: HybridModel, formats: Sequence[str]) -> dict[str, Loading]:
    """How near files are that no simulator here loads, by format [N m]."""
    checks: dict[str, Loading] = {}
    for name in formats:
        if name in CHECKS:
            checks[name] = CHECKS[name](files.folder / FILES[name], files.stated("losses"))
        elif name == "onnx":
            checks[name] = compare_onnx(files.folder / ONNX, files.runs, model)
        elif name in WRITERS:
            checks[name] = {"loads": None, "told": NO_READER}
    return checks


def _torque_errors(files: ArmFiles) -> dict[str, dict[str, float]]:
    """RMS of the torque of the URDF's arm and of the written one, by format [N m]."""
    errors = {}
    for form, chosen in files.chosen.items():
        errors[form] = {"before": chosen.gaps["given"].rms, "after": chosen.gaps["after"].rms}
    return errors
