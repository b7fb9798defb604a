"""`ident patch`: from a diagnosis to files, each loaded back and measured before the folder appears."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ident.errors import InputError
from ident.files import atomic_folder
from ident.motion.motion import Motion
from ident.opening import Opened, Robot, Sources, open_sessions
from ident.patches.best import best_of, tell_choice, write_best
from ident.patches.bodies import Links, change_links, tuned_arm
from ident.patches.change import Change, Diagnosed, Tuning
from ident.patches.expressed import FORMATS, express, untold
from ident.patches.gaps import MOST_WINDOWS, WINDOW
from ident.patches.mjcf import write_mjcf
from ident.patches.mjcf_merge import Merged, merge_mjcf
from ident.patches.module import write_module
from ident.patches.parameters import write_parameters
from ident.patches.standalone.log import Effect
from ident.patches.standalone.motion import Losses
from ident.patches.urdf import write_urdf
from ident.patches.verify import WrittenPatch, check_structure, compare
from ident.provenance import Provenance
from ident.robot.arm import ArmModel

SCHEMA = "ident.patch/1"
PATCH_KIND = "patch"
# Less of the tuned torque than this is not worth a word.
LEAST_MISSED = 0.005
MERGED = "merged.xml"
FILES = ("robot.urdf", "robot.xml", "parameters.toml", "extra_torque.py", "patch.json")


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
    arm = diagnosed.fit_to(robot)
    with atomic_folder(out, PATCH_KIND) as folder, tempfile.TemporaryDirectory() as spare:
        after = _write_after(diagnosed, arm, folder)
        _, links = tuned_arm(arm, diagnosed)
        told = _told(arm, diagnosed, links)
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": arm.name,
            "joints": list(arm.joint_names),
            "diagnosis": diagnosed.path.name,
            "verdict": diagnosed.verdict,
            "baseline": "tuned"
            if diagnosed.has_baseline
            else "not in the diagnosis: losses and tuned inertias are zero",
            "files": list(FILES),
            "effects": [_describe(change) for change in diagnosed.changes],
            "told": told,
            "structure": check_structure(after, _exactly_expressed(diagnosed.changes)),
        }
        if into is not None:
            merged = _merge(into, diagnosed, arm, folder / MERGED, out / MERGED)
            record |= {"merged": merged.to_dict(), "files": [*FILES, MERGED]}
            told += [f"{MERGED}: left out {one}" for one in merged.left_out]
        if motions:
            before = {
                "before": write_before(arm, diagnosed.urdf, Path(spare) / "urdf"),
                "tuned": write_before(arm, diagnosed.alone, Path(spare) / "tuned"),
            }
            measured = _measure(before, after, motions)
            written = write_best(measured["gaps"], before, folder)
            told += tell_choice(written, measured["best"])
            record |= {"heldout": measured, "written": written}
        record["provenance"] = (provenance or Provenance("ident patch")).to_dict()
        (folder / "patch.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
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
        what = (
            f"its joints are {', '.join(opened.arm.joint_names)}, those of the diagnosis {', '.join(diagnosed.joints)}"
        )
        where = opened.reports[0].session.path or opened.reports[0].session.name
        raise InputError(where, what, "give recordings of the joints that were diagnosed")
    return opened


def write_before(arm: ArmModel, tuning: Tuning, folder: Path) -> WrittenPatch:
    """The files that a baseline gives without any effect, to compare with."""
    folder.mkdir()
    links = change_links(arm, tuning.links, ())
    changed = arm.with_inertial_parameters(arm.inertial_parameters + links.total.ravel())
    losses = tuning.losses
    (folder / "robot.urdf").write_text(write_urdf(arm, losses, links.total, ()), encoding="utf-8")
    (folder / "robot.xml").write_text(write_mjcf(changed, losses, ()), encoding="utf-8")
    return WrittenPatch(folder, arm, tuple(arm.locked_joints), {"urdf": losses, "mjcf": losses})


def _write_after(diagnosed: Diagnosed, arm: ArmModel, folder: Path) -> WrittenPatch:
    tuned, links = tuned_arm(arm, diagnosed)
    with_links = arm.with_inertial_parameters(arm.inertial_parameters + links.total.ravel())
    losses = {form: _losses(diagnosed, form) for form in ("urdf", "mjcf")}
    stated = {form: [c for c in diagnosed.changes if express(c, form).answer != "no"] for form in losses}
    effects, owners = known_effects(diagnosed.changes)
    in_file = {form: [k for k, change in enumerate(owners) if change in stated[form]] for form in losses}
    texts = {
        "robot.urdf": write_urdf(arm, losses["urdf"], links.total, stated["urdf"]),
        "robot.xml": write_mjcf(with_links, losses["mjcf"], stated["mjcf"]),
        "parameters.toml": write_parameters(diagnosed, arm, links),
        "extra_torque.py": write_module(
            tuned, diagnosed.tuned.losses, effects, in_file, losses, [change.kind for change in owners if change.kind]
        ),
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    return WrittenPatch(folder, arm, tuple(arm.locked_joints), losses)


def _merge(into: Path, diagnosed: Diagnosed, arm: ArmModel, part: Path, placed: Path) -> Merged:
    """The user's own MJCF with tuned links, losses, and the effects that such a file has words for."""
    _, links = tuned_arm(arm, diagnosed)
    changed = arm.with_inertial_parameters(arm.inertial_parameters + links.total.ravel())
    stated = [change for change in diagnosed.changes if express(change, "mjcf").answer != "no"]
    return merge_mjcf(into, part, arm, changed, _losses(diagnosed, "mjcf"), stated, placed)


def _losses(diagnosed: Diagnosed, form: str) -> Losses:
    """Losses of a file: where it has no words for an effect, those that fit best without it stand in."""
    tuned: Tuning = diagnosed.tuned
    return tuned.with_losses_of(diagnosed.alone, untold(diagnosed.changes, form))


def known_effects(changes: Sequence[Change]) -> tuple[list[Effect], list[Change]]:
    """The effects whose law the module knows, as it takes them, and the changes that they come from."""
    owners = [change for change in changes if change.has_law]
    return [(change.effect, change.joint, change.values) for change in owners], owners


def _exactly_expressed(changes: Sequence[Change]) -> dict[str, list[Effect]]:
    return {
        form: known_effects([change for change in changes if express(change, form).answer == "yes"])[0]
        for form in ("urdf", "mjcf")
        if all(express(change, form).answer != "approximate" for change in changes)
    }


def _describe(change: Change) -> dict[str, Any]:
    return {
        "effect": change.effect,
        "joints": list(change.joints),
        "parameters": {name: figure.to_dict() for name, figure in change.figures.items()},
        "formats": {form: express(change, form).to_dict() for form in FORMATS},
    }


def _told(arm: ArmModel, diagnosed: Diagnosed, links: Links) -> list[str]:
    """What a user of the files should know beside the effects."""
    lines = ["robot.urdf: a URDF has no place for rotor inertia; take it from parameters.toml (Pinocchio: armature)"]
    ranges = diagnosed.tuned.losses.range
    if ranges.any():
        names = ", ".join(arm.joint_names[j] for j in ranges.nonzero()[0])
        lines.append(
            f"{names}: dry friction turns round over a displacement (sliding_range_rad of parameters.toml), for which "
            "neither file has words: robot.xml sticks and slips at once, robot.urdf leaves it to the simulator"
        )
    if links.missed > LEAST_MISSED:
        lines.append(f"{links.missed:.1%} of the changed inertias' torque is left out: no real bodies have it")
    for name, position in arm.locked_joints.items():
        lines.append(f"robot.xml: {name} is fixed at {position:g}, as it was not in the recordings or is a finger")
    for form in ("urdf", "mjcf"):
        joints = [arm.joint_names[j] for j in sorted(untold(diagnosed.changes, form))]
        if joints:
            lines.append(
                f"{form}: at {', '.join(joints)} the losses that fit best without the effects stand in for them"
            )
    return lines


def _measure(before: Mapping[str, WrittenPatch], after: WrittenPatch, motions: Sequence[Motion]) -> dict[str, Any]:
    joints = motions[0].joints
    found = compare(before, after, motions)
    gaps = {form: {when: gap.to_dict(joints) for when, gap in one.items()} for form, one in found.items()}
    return {
        "best": {form: best_of(one) for form, one in gaps.items()},
        "runs": [motion.name for motion in motions],
        "window_s": WINDOW,
        "most_windows": MOST_WINDOWS,
        "before": "the URDF's inertias, losses tuned without the effects",
        "tuned": "inertias and losses tuned without the effects",
        "after": "the written file",
        "after_with_module": "the written file and the module's missing_torque; for the URDF also its log",
        "gaps": gaps,
    }
