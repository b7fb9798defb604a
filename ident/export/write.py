"""`ident patch` and `ident export`: an identified arm as files, each loaded back and measured before they appear.

Formats: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control; one writer each, and all take the same arm.
"""

from __future__ import annotations

import json
import tempfile
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.export.bodies import random_states
from ident.export.choose import MOST_WINDOWS, WINDOW, Chosen, Helper, choose, measure_gap
from ident.export.controllers import write_cpp, write_isaac, write_limits, write_parameters
from ident.export.formats import FORMATS, LOADED, Run, express, recorded_runs, state_arm, stood_in, usual_run
from ident.export.identified import Change, Diagnosed, IdentifiedArm
from ident.export.loading import FILE_OF, WrittenFile, load_module
from ident.export.mjcf_merge import merge_mjcf
from ident.export.python import InFile, write_module
from ident.files import atomic_folder
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.results import Provenance, files_of, runs_of
from ident.robot.arm import ArmModel
from ident.sessions import Opened, Robot, Sources, open_sessions

PATCH, EXPORT = "ident.patch/1", "ident.export/1"
PATCH_KIND, EXPORT_KIND = "patch", "export"
MERGED = "merged.xml"
PATCH_FILES = ("robot.urdf", "robot.xml", "parameters.toml", "extra_torque.py", "patch.json")
FILES = {
    **FILE_OF,
    "toml": "parameters.toml",
    "python": "torque_model.py",
    "isaaclab": "isaaclab.py",
    "ros2_control": "joint_limits.yaml",
    "cpp": "torque_model.hpp",
}
WRITERS = {"isaaclab": write_isaac, "ros2_control": write_limits, "cpp": write_cpp}
NOT_TUNED = "not in the diagnosis: losses and tuned inertias are zero"
# Less of the tuned torque than this is not worth a word.
LEAST_MISSED = 0.005
# What the candidates are, in a record.
CANDIDATES = {
    "before": "the URDF's inertias, losses tuned without the effects",
    "tuned": "inertias and losses tuned without the effects",
    "after": "the written file",
    "after_with_module": "the written file and the module's missing_torque; for the URDF also its log",
}


def write_patch(
    diagnosed: Diagnosed,
    robot: ArmModel,
    out: Path,
    motions: Sequence[Motion] = (),
    provenance: Provenance | None = None,
    into: Path | None = None,
) -> dict[str, Any]:
    """Writes the patch of a diagnosis.

    Args:
        diagnosed: The diagnosis.
        robot: The robot that it was made with.
        out: Folder of the patch; an earlier patch there is replaced.
        motions: Recordings to measure it on; none for the structural check alone.
        provenance: Where it comes from.
        into: The user's own MJCF of this arm, of which a copy gets what was found.

    Returns:
        What `patch.json` holds.

    Raises:
        InputError: Another robot's diagnosis, or the folder holds something else.
    """
    options, origin = diagnosed.candidates(robot), provenance or Provenance("ident patch")
    seen = bool(diagnosed.runs & runs_of(origin.sessions))
    with _Files.into_folder(options, motions, out, PATCH_KIND) as arm:
        arm.write_loaded(LOADED)
        arm.write("parameters.toml", write_parameters(options["after"], options["tuned"].losses))
        arm.write("extra_torque.py", arm.module())
        told = _notes(options["after"])
        record: dict[str, Any] = {
            "schema": PATCH,
            "robot": arm.nominal.name,
            "joints": list(arm.nominal.joint_names),
            "diagnosis": diagnosed.path.name,
            "verdict": diagnosed.verdict,
            "baseline": "tuned" if diagnosed.has_baseline else NOT_TUNED,
            "files": list(PATCH_FILES),
            "effects": [_describe(change) for change in diagnosed.changes],
            "told": told,
            "structure": arm.structure(),
        }
        if into is not None:
            record |= {"merged": arm.merge(into), "files": [*PATCH_FILES, MERGED]}
            told += [f"{MERGED}: left out {one}" for one in record["merged"]["left_out"]]
        if motions:
            record |= arm.measured("extra_torque.py", in_sample=seen)
            told += arm.choice_in_words()
            if seen:
                told.append("measured on recordings that the diagnosis was made from: nothing is held out")
        arm.write_record("patch.json", record, origin)
    return record


def write_export(
    model: HybridModel,
    out: Path,
    formats: Sequence[str] = tuple(FILES),
    nearest: bool = False,
    motions: Sequence[Motion] = (),
    into: Path | None = None,
    origin: Provenance | None = None,
) -> dict[str, Any]:
    """Writes the arm of a fitted model.

    Args:
        model: The fitted model.
        out: Folder; an earlier export there is replaced.
        formats: Which of `FILES`.
        nearest: Whether links that no body could be are written as the nearest bodies.
        motions: Recordings on which the files are measured; the best of the candidates is written.
        into: The user's own MJCF of this arm, of which a copy gets what was identified.
        origin: Where it comes from.

    Returns:
        What `export.json` holds.

    Raises:
        InputError: An unknown format, or links that no body could be.
    """
    unknown = [name for name in formats if name not in FILES]
    if unknown:
        raise InputError("--format", f"{unknown[0]!r} is unknown", f"use one of: {', '.join(FILES)}")
    after = IdentifiedArm.of_model(model, nearest)
    options = {"before": IdentifiedArm.as_urdf(model.nominal), "after": after}
    motions = [motion.select(model.joint_names) for motion in motions]
    with _Files.into_folder(options, motions, out, EXPORT_KIND) as arm:
        arm.write_loaded([name for name in LOADED if name in formats])
        texts = {"toml": lambda: write_parameters(after, estimates=model.figures), "python": arm.module}
        for name in formats:
            if name in texts:
                arm.write(FILES[name], texts[name]())
            elif name in WRITERS:
                arm.write(FILES[name], WRITERS[name](arm.plain))
        left_out = _left_out(model)
        record: dict[str, Any] = {
            "schema": EXPORT,
            "robot": model.robot.name,
            "joints": list(model.joint_names),
            "files": [FILES[name] for name in formats],
            "changed_links": list(after.links.mended),
            "left_out": left_out,
            "loaded_back": {**arm.structure(), **_read_back(arm.folder, formats, after)},
        }
        if into is not None:
            record["merged"] = arm.merge(into)
            record["files"].append(MERGED)
        if motions and arm.chosen:
            seen = origin is not None and bool(files_of(model.provenance) & runs_of(origin.sessions))
            record |= arm.measured(FILES["python"] if "python" in formats else None, seen)
            record["torque_rmse_Nm"] = {
                form: {"before": one.gaps["before"].rms, "after": one.gaps["after"].rms}
                for form, one in arm.chosen.items()
            }
            left_out += arm.choice_in_words()
        arm.write_record("export.json", record, origin or Provenance("ident export"))
    return record


def open_heldout(
    paths: Sources, robot: Robot, diagnosed: Diagnosed, topic: str, session_file: str | Path | None
) -> Opened:
    """Recordings to measure a patch on, filtered as those that were diagnosed.

    Raises:
        InputError: They can't be read, or have other joints than the diagnosis.
    """
    opened = open_sessions(paths, robot, topic, session_file, diagnosed.cutoff, learning=False)
    if opened.arm.joint_names != diagnosed.joints:
        theirs = ", ".join(diagnosed.joints)
        what = f"its joints are {', '.join(opened.arm.joint_names)}, those of the diagnosis {theirs}"
        where = opened.reports[0].session.path or opened.reports[0].session.name
        raise InputError(where, what, "give recordings of the joints that were diagnosed")
    return opened


@dataclass(eq=False)
class _Files:
    """The files of an identified arm while they are written.

    Attributes:
        options: What could be written; `after` is the arm with all that was identified.
        motions: Recordings that decide which of them is.
        folder: Where the files are put together.
        out: Where they will lie.
        scratch: For candidates.
    """

    options: Mapping[str, IdentifiedArm]
    motions: Sequence[Motion]
    folder: Path
    out: Path
    scratch: Path

    @classmethod
    @contextmanager
    def into_folder(
        cls, options: Mapping[str, IdentifiedArm], motions: Sequence[Motion], out: Path, kind: str
    ) -> Iterator[_Files]:
        """The files of a folder that appears whole or not at all."""
        with atomic_folder(out, kind) as folder, tempfile.TemporaryDirectory() as scratch:
            yield cls(options, motions, folder, out, Path(scratch))

    def __post_init__(self) -> None:
        self.identified = self.options["after"]
        self.nominal = self.identified.nominal
        self.runs: list[Run] = recorded_runs(self.motions) or [usual_run(self.nominal)]
        self.written: dict[str, WrittenFile] = {}
        self.chosen: dict[str, Chosen] = {}
        self.alone = self.options["tuned"].losses if "tuned" in self.options and not self.motions else None

    @cached_property
    def plain(self) -> IdentifiedArm:
        """What a format states that knows no effect."""
        return state_arm(self.identified, "losses", self.runs, self.alone)

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text, encoding="utf-8")

    def write_record(self, name: str, record: dict[str, Any], origin: Provenance) -> None:
        """The record of all files, the last of them."""
        record["provenance"] = origin.to_dict()
        self.write(name, json.dumps(record, indent=1) + "\n")

    def write_loaded(self, forms: Sequence[str]) -> None:
        """The files of simulators: where there are recordings, the best of the candidates on them."""
        for form in forms:
            stated = state_arm(self.identified, form, self.runs, self.alone)
            if self.motions:
                others = {name: state_arm(one, form, self.runs) for name, one in self.options.items()}
                self.chosen[form] = choose(form, others, self.motions, self.scratch / form)
                stated = self.chosen[form].stated
            self.written[form] = WrittenFile.write(form, self.folder, stated)

    def module(self) -> str:
        """The Python module, which says what the simulators' files lack."""
        owners = [change for change in self.identified.changes if change.has_law]
        files = {form: self._in_file(owners, self.written[form].stated) for form in self.written}
        usual = InFile((), self.plain.losses)
        return write_module(self.identified, {form: files.get(form, usual) for form in LOADED})

    def _in_file(self, owners: Sequence[Change], stated: IdentifiedArm) -> InFile:
        errors = [change for change in stated.changes if change.part("urdf") == "inertial"]
        links = stated.links.total - (self.identified.links.named if errors else 0.0)
        same = np.allclose(links, self.identified.links.tuned, atol=1e-12)
        numbers = None if same else self.nominal.inertial_parameters.reshape(-1, 10) + links
        return InFile([k for k, one in enumerate(owners) if one in stated.changes], stated.losses, numbers)

    def merge(self, into: Path) -> dict[str, Any]:
        """A copy of the user's own MJCF with what was identified, and what is to be said of it."""
        stated = (
            self.written["mjcf"].stated
            if "mjcf" in self.written
            else state_arm(self.identified, "mjcf", self.runs, self.alone)
        )
        return merge_mjcf(into, self.folder / MERGED, stated, self.out / MERGED)

    def structure(self) -> dict[str, Any]:
        """How near each loaded file is to what it should hold."""
        found = {form: one.check() for form, one in self.written.items()}
        return {form: one for form, one in found.items() if one is not None}

    def measured(self, module: str | None, in_sample: bool) -> dict[str, Any]:
        """Errors of the candidates and of the written files, and what was written."""
        joints = self.nominal.joint_names
        gaps = {form: dict(one.gaps) for form, one in self.chosen.items()}
        loaded = None if module is None else load_module(self.folder / module)
        for form in gaps:
            if loaded is None:
                break
            helper = Helper(loaded, form)
            model = self.written[form].load(self.motions[0].payload)
            gaps[form]["after_with_module"] = measure_gap(model, self.motions, helper)
        rms = {form: {when: gap.rms for when, gap in one.items()} for form, one in gaps.items()}
        heldout = {
            "best": {form: min(one, key=one.__getitem__) for form, one in rms.items()},
            "in_sample": in_sample,
            "runs": [motion.name for motion in self.motions],
            "window_s": WINDOW,
            "most_windows": MOST_WINDOWS,
            **CANDIDATES,
            "gaps": {form: {w: gap.to_dict(joints) for w, gap in one.items()} for form, one in gaps.items()},
            "choice": {form: one.to_dict(joints) for form, one in self.chosen.items()},
        }
        return {"heldout": heldout, "written": {form: one.name for form, one in self.chosen.items()}}

    def choice_in_words(self) -> list[str]:
        joints = self.nominal.joint_names
        return [line for form, one in self.chosen.items() for line in one.in_words(form, joints)]


def _describe(change: Change) -> dict[str, Any]:
    return {
        "effect": change.effect,
        "joints": list(change.joints),
        "parameters": {name: figure.to_dict() for name, figure in change.figures.items()},
        "formats": {form: express(change, form).to_dict() for form in FORMATS},
    }


def _notes(identified: IdentifiedArm) -> list[str]:
    """What a user of the files should know beside the effects."""
    arm, ranges = identified.nominal, identified.losses.range
    lines = ["robot.urdf: a URDF has no place for rotor inertia; take it from parameters.toml (Pinocchio: armature)"]
    if not identified.is_level:
        pull = " ".join(f"{one:.2f}" for one in identified.gravity)
        lines.append(f"gravity pulls along ({pull}) m/s² of the base: robot.urdf stands on a link `level`, turned so")
    if ranges.any():
        names = ", ".join(arm.joint_names[j] for j in ranges.nonzero()[0])
        lines.append(
            f"{names}: dry friction turns round over a displacement (sliding_range_rad of parameters.toml), for which "
            "neither file has words: robot.xml sticks and slips at once, robot.urdf leaves it to the simulator"
        )
    if identified.links.missed > LEAST_MISSED:
        lines.append(
            f"{identified.links.missed:.1%} of the changed inertias' torque is left out: no real bodies have it"
        )
    for name, position in arm.locked_joints.items():
        lines.append(f"robot.xml: {name} is fixed at {position:g}, as it was not in the recordings or is a finger")
    for form in LOADED:
        joints = [arm.joint_names[j] for j in sorted({c.joint for c in stood_in(identified.changes, form)})]
        if joints:
            lines.append(f"{form}: at {', '.join(joints)} the losses nearest to the effects' laws stand in for them")
    return lines


def _left_out(model: HybridModel) -> list[str]:
    """What no file says."""
    told = ["a URDF has no place for rotor inertia, nor for the speed over which dry friction turns round"]
    if np.any(model.loss.offset != 0.0):
        told.append("torque offsets are in the model folder alone")
    if model.coupling is not None:
        shaft = model.coupling.shaft
        pair = f"{model.joint_names[shaft.first]} and {model.joint_names[shaft.second]}"
        told.append(f"the shaft shared by {pair} is in the model folder alone")
    if model.named:
        laws = ", ".join(f"{law.effect} of {model.joint_names[law.joint]}" for law in model.named)
        told.append(
            f"exactly in torque_model.py (extra_torque) and parameters.toml alone: {laws}; elsewhere the losses that "
            "are nearest to these laws stand in for them"
        )
    if model.net is not None:
        told.append("the residual net is in the model folder alone")
    return told


def _read_back(folder: Path, formats: Sequence[str], identified: IdentifiedArm) -> dict[str, Any]:
    """The parameter file read, and the module's torque against the identified arm's own [N m]."""
    found: dict[str, Any] = {}
    if "toml" in formats:
        found["toml"] = {"loads": bool(tomllib.loads((folder / FILES["toml"]).read_text(encoding="utf-8"))["joints"])}
    if "python" in formats:
        module = load_module(folder / FILES["python"])
        q, dq, ddq = random_states(identified.nominal, np.random.default_rng(0))
        losses = identified.losses
        wanted = identified.tuned.inverse_dynamics(q, dq, ddq)
        wanted = wanted + losses.torque(dq, ddq, np.tanh(dq / losses.transition))
        left = module.modelled_torque(q, dq, ddq) - wanted
        found["python"] = {"loads": True, "torque_difference_Nm": float(np.max(np.abs(left)))}
    return found
