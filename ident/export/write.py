"""`ident patch` and `ident export`: an identified arm as files, each loaded back and measured before they appear.

Formats: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control; one writer each, and all take the same arm.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ident.command_options import ExportOptions
from ident.errors import InputError
from ident.export.bodies import random_states
from ident.export.choose import MOST_WINDOWS, SAID, WINDOW, Chosen, choose, measure_gap, mix
from ident.export.controllers import (
    InFile,
    write_cpp,
    write_isaac,
    write_limits,
    write_module,
    write_parameters,
)
from ident.export.formats import (
    LOADED,
    NEAR,
    Run,
    describe,
    measure_off,
    state_arm,
    stood_in,
    usual_run,
)
from ident.export.friction_files import (
    FEED_FORWARD,
    UR,
    check_feed_forward,
    write_feed_forward,
    write_ur,
)
from ident.export.identified import Diagnosed, IdentifiedArm
from ident.export.into import is_mjcf, require_loadable, save_into, write_into
from ident.export.learned import FILE as LEARNED
from ident.export.learned import has_learned, write_learned
from ident.export.loaded import FILE_OF, WrittenFile, load_module
from ident.export.newton import FILE as NEWTON
from ident.export.newton import check_newton, write_newton
from ident.export.onnx_model import FILE as ONNX
from ident.export.onnx_model import compare_onnx, write_onnx
from ident.export.promotion import (
    REMEDY,
    Contest,
    Promotion,
    contest_of_model,
    measure_distance,
    tool_of,
)
from ident.files import atomic_folder
from ident.laws.motion import Losses
from ident.model.hybrid import HybridModel
from ident.motion.motion import Motion
from ident.recordings.columns import listed
from ident.records import as_json
from ident.results import Provenance, files_of, runs_of
from ident.robot.arm import ArmModel

PATCH = "ident.patch/1"
EXPORT = "ident.export/1"
PATCH_KIND = "patch"
EXPORT_KIND = "export"
PATCH_FILES = ("robot.urdf", "robot.xml", "parameters.toml", "extra_torque.py", "patch.json")
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
UNMEASURED = "measured on no recordings: with --on SESSION the best of the candidates is written, the URDF's arm among them"
# More samples of all runs together say no more about a law's nearest losses.
MOST_SAMPLES = 5000
# Less of the tuned torque than this is not worth a word.
LEAST_MISSED = 0.005
# What the candidates are, in a record.
CANDIDATES = SAID | {
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
        into: The user's own URDF or MJCF, into which it is written as well; the folder keeps the file as it was.

    Returns:
        What `patch.json` holds.

    Raises:
        InputError: Another robot's diagnosis, or the folder holds something else.
    """
    options = diagnosed.candidates(robot)
    origin = provenance or Provenance("ident patch")
    module = "extra_torque.py"
    with atomic_folder(out, PATCH_KIND) as folder, tempfile.TemporaryDirectory() as scratch:
        arm = _Files(options, motions, folder, Path(scratch))
        arm.write_loaded(LOADED)
        alone = options["tuned"].losses
        parameters = write_parameters(
            options["after"], alone, urdf=arm.losses_of_urdf(), figures=diagnosed.identified
        )
        arm.write("parameters.toml", parameters)
        arm.write(module, arm.module())
        record: dict[str, Any] = {
            "schema": PATCH,
            "robot": arm.nominal.name,
            "joints": list(arm.nominal.joint_names),
            "diagnosis": diagnosed.path.name,
            "verdict": diagnosed.verdict,
            "baseline": "tuned" if diagnosed.has_baseline else NOT_TUNED,
            "files": list(PATCH_FILES),
            "effects": arm.effects(),
            "identified": dict(diagnosed.identified),
            "told": (notes := _notes(options["after"], module)),
            "structure": arm.structure(module),
        }
        record |= arm.measured(module, bool(diagnosed.runs & runs_of(origin.sessions)), notes)
        record["provenance"] = origin.to_dict()
        if into is not None:
            text, written = write_into(into, arm.stated("mjcf" if is_mjcf(into) else "urdf"))
            require_loadable(into, text, written)
            record["into"] = written.to_dict()
            (folder / f"before_{into.name}").write_bytes(into.read_bytes())
        arm.write("patch.json", as_json(record) + "\n")
    if into is not None:
        save_into(into, text)
    return record


def write_export(
    model: HybridModel,
    out: Path,
    chosen: ExportOptions | None = None,
    motions: Sequence[Motion] = (),
    origin: Provenance | None = None,
) -> dict[str, Any]:
    """Writes the arm of a fitted model; with recordings, only what beats the URDF alone on them.

    Args:
        model: The fitted model.
        out: Folder; an earlier export there is replaced.
        chosen: Which of `FILES`, the usual ones if it doesn't say; whether links that no body could be are
            written as the nearest bodies; whether recordings of the fit are accepted, and how long it is replayed.
        motions: As of `write_patch`.
        origin: Where it comes from.

    Returns:
        What `export.json` holds; without files where one is not promoted: the folder is as it was.

    Raises:
        InputError: An unknown format, or links that no body could be.
    """
    chosen = chosen or ExportOptions()
    formats = USUAL if chosen.formats is None else tuple(chosen.formats)
    unknown = [name for name in formats if name not in FILES]
    if unknown:
        raise InputError(
            "--format", f"{unknown[0]!r} is unknown", f"use one of: {', '.join(FILES)}"
        )
    options = IdentifiedArm.of_models(model, chosen.nearest)
    origin = origin or Provenance("ident export")
    after = options["after"]
    module = FILES["python"] if "python" in formats else None
    with (
        suppress(_NotPromoted),
        atomic_folder(out, EXPORT_KIND) as folder,
        tempfile.TemporaryDirectory() as scratch,
    ):
        arm = _Files(
            options, [motion.select(model.joint_names) for motion in motions], folder, Path(scratch)
        )
        arm.write_loaded([name for name in LOADED if name in formats])
        for name in formats:
            if name == "toml":
                parameters = write_parameters(
                    after, estimates=model.figures, urdf=arm.losses_of_urdf()
                )
                arm.write(FILES[name], parameters)
            elif name == "onnx":
                (folder / ONNX).write_bytes(write_onnx(model))
            elif name not in LOADED:
                arm.write(
                    FILES[name],
                    arm.module() if name == "python" else WRITERS[name](arm.stated("losses")),
                )
        learned = "cpp" in formats and has_learned(model)
        if learned:
            arm.write(LEARNED, write_learned(model))
        notes = [*_notes(after, FILES["python"], model), *_plain_losses(after, formats)]
        record: dict[str, Any] = {
            "schema": EXPORT,
            "robot": model.robot.name,
            "joints": list(model.joint_names),
            "files": [*(FILES[name] for name in formats), *([LEARNED] if learned else [])],
            "changed_links": list(after.links.mended),
            "left_out": notes,
            "loaded_back": arm.structure(module),
        }
        for name in formats:
            if name in CHECKS:
                stated = arm.stated("losses")
                record["loaded_back"][name] = CHECKS[name](folder / FILES[name], stated)
            elif name == "onnx":
                record["loaded_back"][name] = compare_onnx(folder / ONNX, arm.runs, model)
            elif name in WRITERS:
                record["loaded_back"][name] = {"loads": None, "told": NO_READER}
        if arm.chosen:
            record["torque_rmse_Nm"] = {
                form: {"before": one.gaps["given"].rms, "after": one.gaps["after"].rms}
                for form, one in arm.chosen.items()
            }
        seen = bool(files_of(model.provenance) & runs_of(origin.sessions))
        record |= arm.measured(module, seen, notes)
        record["provenance"] = origin.to_dict()
        if motions:
            contests = tuple(arm.contests(model, formats, chosen.horizon))
            tool = tool_of(arm.nominal)
            promotion = Promotion(contests, chosen.horizon, tool, seen, chosen.in_sample)
            record["promotion"] = promotion.to_dict()
            if not promotion.passed:
                record["files"] = []
                record["left_out"].append(REMEDY)
                raise _NotPromoted
        arm.write("export.json", as_json(record) + "\n")
    return record


class _NotPromoted(Exception):
    """A file does not beat the URDF alone: the folder that was begun is not to be kept."""


class _Files:
    """The files of an arm while they are put together: of the options `after` has all that was identified."""

    def __init__(
        self,
        options: Mapping[str, IdentifiedArm],
        motions: Sequence[Motion],
        folder: Path,
        scratch: Path,
    ) -> None:
        self.options = options
        self.motions = motions
        self.folder = folder
        self.scratch = scratch
        self.identified = options["after"]
        self.nominal = self.identified.nominal
        # States of recordings, of long ones their first part: the torque is left out.
        rows = slice(0, max(3, MOST_SAMPLES // max(len(motions), 1)))
        recorded: list[Run] = [(m.q[rows], m.dq[rows], m.ddq[rows], m.interval) for m in motions]
        self.runs = recorded or [usual_run(self.nominal)]
        self.written: dict[str, WrittenFile] = {}
        self.chosen: dict[str, Chosen] = {}
        self.shares: dict[str, list[dict[str, float]]] = {}

    def stated(self, form: str) -> IdentifiedArm:
        """What the file of a format holds; of one that knows no effect, losses that stand in for all of them."""
        if form in self.written:
            return self.written[form].stated
        stated = state_arm(self.identified, form, self.runs)
        if "tuned" not in self.options or self.motions:
            return stated
        # No recording says what is best. Where losses are no good for a law, those that were fitted without it are
        # better; and where the file has no effect at all, so are bodies.
        changes = self.identified.changes
        off = self.off(form) if form in LOADED else [{} for _ in changes]
        held = {(change.effect, change.joint) for change in stated.changes}
        near = [
            c
            for c, one in zip(changes, off, strict=True)
            if (c.effect, c.joint) in held or one.get(form, 1.0) <= NEAR
        ]
        joints = {change.joint for change in stood_in(changes, form)} - {
            change.joint for change in near
        }
        names = ["tuned" if j in joints else "after" for j in range(self.nominal.n)]
        tuned = self.options["tuned"]
        return mix({"after": stated, "tuned": tuned}, "after", names) if near else tuned

    def write(self, name: str, text: str) -> None:
        (self.folder / name).write_text(text, encoding="utf-8")

    def write_loaded(self, forms: Sequence[str]) -> None:
        """The files of simulators: where there are recordings, the best of the candidates on them."""
        for form in forms:
            stated = self.stated(form)
            if self.motions:
                others = {
                    name: state_arm(one, form, self.runs) for name, one in self.options.items()
                }
                self.chosen[form] = choose(form, others, self.motions, self.scratch / form)
                stated = self.chosen[form].stated
            self.written[form] = WrittenFile.write(form, self.folder, stated)

    def contests(self, model: HybridModel, formats: Sequence[str], horizon: float) -> list[Contest]:
        """Each simulator's file against the URDF alone; of other formats the model behind them."""
        payload = self.motions[0].payload
        contests = []
        for form, file in self.written.items():
            urdf = WrittenFile.write(form, self.scratch / f"{form}_nominal", self.options["given"])
            nominal = measure_distance(urdf.load(payload), self.motions, self.nominal, horizon)
            written = measure_distance(file.load(payload), self.motions, self.nominal, horizon)
            contests.append(Contest(form, nominal, written, self.chosen[form].tried))
        if any(name not in LOADED for name in formats):
            contests.append(contest_of_model(model, self.motions, horizon))
        return contests

    def effects(self) -> list[dict[str, Any]]:
        """Every effect, and how near each format comes to it."""
        found = zip(self.identified.changes, *(self.off(form) for form in LOADED), strict=True)
        return [describe(change, {**urdf, **mjcf}) for change, urdf, mjcf in found]

    def off(self, form: str) -> list[dict[str, float]]:
        """How far each effect's torque in a file is from its law, as a share, by the format."""
        if form not in self.shares:
            self.shares[form] = measure_off(self.identified, form, self.runs, self.scratch / form)
        return self.shares[form]

    def losses_of_urdf(self) -> Losses | None:
        """Losses of the URDF, with what it has no place for, where they are others than the arm's own."""
        found = self.written["urdf"].stated.losses if "urdf" in self.written else None
        return None if found is None or found is self.identified.losses else found

    def module(self) -> str:
        """The Python module, which says what the simulators' files lack."""
        owners = [(c.effect, c.joint) for c in self.identified.changes if c.has_law]
        files: dict[str, InFile] = {}
        for form in LOADED:
            stated = self.stated(form if form in self.written else "losses")
            held = {(c.effect, c.joint) for c in stated.changes}
            errors = any(change.part("urdf") == "inertial" for change in stated.changes)
            links = stated.links.total - (self.identified.links.named if errors else 0.0)
            same = np.allclose(links, self.identified.links.tuned, atol=1e-12)
            numbers = None if same else self.nominal.inertial_parameters.reshape(-1, 10) + links
            files[form] = [k for k, one in enumerate(owners) if one in held], stated.losses, numbers
        return write_module(self.identified, files)

    def structure(self, module: str | None) -> dict[str, Any]:
        """How near each loaded file is to what it should hold [N m]."""
        found = {form: one.check() for form, one in self.written.items()}
        if module is not None:
            q, dq, ddq = random_states(self.nominal, np.random.default_rng(0))
            losses = self.identified.losses
            wanted = losses.torque(dq, ddq, np.tanh(dq / losses.transition))
            wanted += self.identified.tuned.inverse_dynamics(q, dq, ddq)
            left = load_module(self.folder / module).modelled_torque(q, dq, ddq) - wanted
            found["python"] = {"loads": True, "torque_difference_Nm": float(np.max(np.abs(left)))}
        return found

    def measured(self, module: str | None, in_sample: bool, notes: list[str]) -> dict[str, Any]:
        """Errors of the candidates and of the written files where there are recordings, and what was written."""
        if not self.chosen:
            notes += [UNMEASURED] * bool(self.written)
            return {}
        joints = self.nominal.joint_names
        gaps = {form: dict(one.gaps) for form, one in self.chosen.items()}
        if module is not None:
            loaded = load_module(self.folder / module)
            for form, found in gaps.items():
                helped = self.written[form].load(self.motions[0].payload, loaded)
                found["after_with_module"] = measure_gap(helped, self.motions)
        rms = {form: {when: gap.rms for when, gap in one.items()} for form, one in gaps.items()}
        notes += [line for form, one in self.chosen.items() for line in one.in_words(form, joints)]
        notes += ["measured on recordings that it was made from: nothing is held out"] * in_sample
        heldout = {
            "best": {form: min(one, key=one.__getitem__) for form, one in rms.items()},
            "in_sample": in_sample,
            "runs": [motion.name for motion in self.motions],
            "window_s": WINDOW,
            "most_windows": MOST_WINDOWS,
            **CANDIDATES,
            "gaps": {
                form: {w: gap.to_dict(joints) for w, gap in one.items()}
                for form, one in gaps.items()
            },
            "choice": {form: one.to_dict(joints) for form, one in self.chosen.items()},
        }
        return {
            "heldout": heldout,
            "written": {form: one.name for form, one in self.chosen.items()},
        }


def _plain_losses(identified: IdentifiedArm, formats: Sequence[str]) -> list[str]:
    """Which files know no law of an effect, and what stands in for it there."""
    files = [FILES[name] for name in formats if name in WRITERS]
    effects = [f"{change.effect} of {change.joints[0]}" for change in identified.changes]
    if not files or not effects:
        return []
    stand = "of friction of a joint, what is nearest along these motions stands in"
    return [f"{listed(files)}: no place for {listed(effects)}: {stand}"]


def _notes(identified: IdentifiedArm, module: str, model: HybridModel | None = None) -> list[str]:
    """What a user of the files should know beside the effects, and what no file says of a model."""
    arm = identified.nominal
    ranges = identified.losses.range * (identified.losses.coulomb > 0.0)
    lines = [
        "robot.urdf: a URDF has no place for rotor inertia; take it from parameters.toml (Pinocchio: armature)"
    ]
    if not identified.is_level:
        pull = " ".join(f"{one:.2f}" for one in identified.gravity)
        lines.append(
            f"gravity pulls along ({pull}) m/s² of the base: robot.urdf stands on a link `level`, turned so"
        )
    if ranges.any():
        names = ", ".join(arm.joint_names[j] for j in ranges.nonzero()[0])
        lines.append(
            f"{names}: dry friction turns round over a displacement (sliding_range_rad of parameters.toml), for which "
            "neither file has words: robot.xml sticks and slips at once, robot.urdf leaves it to the simulator"
        )
    doubtful = ", ".join(
        f"{c.effect} of {c.joints[0]}" for c in identified.changes if c.probability < 0.5
    )
    lines += [f"less likely than not, and written all the same: {doubtful}"] * bool(doubtful)
    if (missed := identified.links.missed) > LEAST_MISSED:
        lines.append(
            "the inertias as identified belong to no bodies that can exist: the files have the nearest "
            f"that can, which leave out {100.0 * missed:.1f} % of the torque that the change makes"
        )
    fixed = [f"{name} at {position:g}" for name, position in arm.locked_joints.items()]
    lines += [
        f"robot.xml: not in the recordings, or fingers, and so fixed: {listed(fixed)}"
    ] * bool(fixed)
    for form in LOADED:
        joints = [
            arm.joint_names[j]
            for j in sorted({c.joint for c in stood_in(identified.changes, form)})
        ]
        if joints:
            stand = "the losses nearest to the effects' laws stand in for them"
            lines.append(
                f"{form}: at {', '.join(joints)} {stand}; {module} (extra_torque) has the laws"
            )
    if model is not None and (model.net is not None or model.loss.offset.any()):
        lines.append(
            f"the residual net and torque offsets are in the model folder and, of format cpp, {LEARNED} alone"
        )
    if model is not None and model.carried:
        names = ", ".join(one.effect for one in model.carried)
        lines.append(
            f"carried effects ({names}) are in the model folder alone: `ident patch` writes what it can"
        )
    return lines
