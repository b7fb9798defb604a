"""What was identified, in the files of others: URDF, MJCF, TOML, Python, C++, Isaac Lab, ros2_control.

Only bodies that can exist are written: an integrator makes motion of them. Every file is loaded back by its consumer
before the folder appears, and its torque compared with the model's.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from ident.errors import InputError
from ident.files import atomic_folder
from ident.model.consistency import nearest_consistent
from ident.model.hybrid import HybridModel
from ident.model.inertia import parameter_scale
from ident.model.named_laws import NamedLaw, named_torque
from ident.motion.motion import Motion
from ident.patches.bodies import is_body
from ident.patches.command import MERGED
from ident.patches.cpp import write_cpp
from ident.patches.isaac import write_isaac
from ident.patches.mjcf import write_mjcf
from ident.patches.mjcf_merge import merge_mjcf
from ident.patches.model_laws import module_effects
from ident.patches.module import write_module
from ident.patches.ros2_limits import write_limits
from ident.patches.standalone.motion import Losses
from ident.patches.urdf import write_urdf
from ident.patches.verify import WrittenPatch, load_module, random_states
from ident.provenance import Provenance
from ident.robot.arm import ArmModel

SCHEMA = "ident.export/1"
EXPORT_KIND = "export"
FILES = {
    "urdf": "robot.urdf",
    "mjcf": "robot.xml",
    "toml": "parameters.toml",
    "python": "torque_model.py",
    "isaaclab": "isaaclab.py",
    "ros2_control": "joint_limits.yaml",
    "cpp": "torque_model.hpp",
}
# Formats that a simulator loads back; the others are read as they are.
LOADED = ("urdf", "mjcf")
# Those that a Python program takes.
CONSUMED = (*LOADED, "toml", "python")


def write_export(
    model: HybridModel,
    out: Path,
    formats: Sequence[str] = tuple(FILES),
    nearest: bool = False,
    motions: Sequence[Motion] = (),
    into: Path | None = None,
    origin: Provenance | None = None,
) -> dict[str, Any]:
    """Writes an identified arm.

    Args:
        model: The fitted model.
        out: Folder; an earlier export there is replaced.
        formats: Which of `FILES`.
        nearest: Whether links that no body could be are written as the nearest bodies.
        motions: Recordings on which each file's torque error is measured, before and after.
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
    arm, changed = _physical(model, nearest)
    losses = _losses(model)
    with atomic_folder(out, EXPORT_KIND) as folder:
        for name in formats:
            (folder / FILES[name]).write_text(_text(name, model, arm, losses), encoding="utf-8")
        written = WrittenPatch(folder, model.nominal, tuple(model.nominal.locked_joints), dict.fromkeys(LOADED, losses))
        record: dict[str, Any] = {
            "schema": SCHEMA,
            "robot": model.robot.name,
            "joints": list(model.joint_names),
            "files": [FILES[name] for name in formats],
            "changed_links": changed,
            "left_out": _left_out(model),
            "loaded_back": {
                name: _loaded_back(name, written, arm, losses, model.named) for name in formats if name in CONSUMED
            },
        }
        if into is not None:
            record["merged"] = merge_mjcf(
                into, folder / MERGED, model.nominal, arm, losses, placed=out / MERGED
            ).to_dict()
            record["files"].append(MERGED)
        if motions:
            record["torque_rmse_Nm"] = _errors([name for name in formats if name in LOADED], written, model, motions)
        record["provenance"] = (origin or Provenance("ident export")).to_dict()
        (folder / "export.json").write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    return record


def _physical(model: HybridModel, nearest: bool) -> tuple[ArmModel, list[str]]:
    """The identified arm with links that are bodies, and which were changed for it."""
    numbers = model.arm.inertial_parameters
    links = model.arm.links
    # A link that the URDF itself leaves without extent is written as it is.
    given = model.nominal.inertial_parameters.reshape(-1, 10)
    wrong = [
        links[j]
        for j, row in enumerate(numbers.reshape(-1, 10))
        if not is_body(row) and not np.array_equal(row, given[j])
    ]
    if not wrong:
        return model.arm, []
    if not nearest:
        raise InputError(
            "the model",
            f"its {', '.join(wrong)} could be no real body",
            "give --nearest to write the nearest bodies, or fit with --inertia consistent",
        )
    mended = nearest_consistent(numbers, parameter_scale(model.nominal))
    return model.arm.with_inertial_parameters(mended), wrong


def _losses(model: HybridModel) -> Losses:
    loss = model.loss
    widths = np.where(loss.transition_speed > 0.0, loss.transition_speed, 1e-6)
    return Losses(loss.motor_inertia, loss.viscous, loss.coulomb, widths, np.zeros(model.arm.n))


def _text(name: str, model: HybridModel, arm: ArmModel, losses: Losses) -> str:
    if name == "urdf":
        change = (arm.inertial_parameters - model.nominal.inertial_parameters).reshape(-1, 10)
        # The model's own copy of the URDF, not the file it was read from: that may have changed since.
        return write_urdf(replace(model.nominal, source=None), losses, change, ())
    if name == "mjcf":
        return write_mjcf(arm, losses, ())
    if name == "python":
        nothing: dict[str, list[int]] = {form: [] for form in LOADED}
        return write_module(arm, losses, module_effects(model.named), nothing, dict.fromkeys(LOADED, losses))
    if name == "toml":
        return _parameters(model, arm)
    return {"isaaclab": write_isaac, "ros2_control": write_limits, "cpp": write_cpp}[name](arm, losses)


def _parameters(model: HybridModel, arm: ArmModel) -> str:
    """Figures with their intervals, by joint, and link inertias."""
    joints: dict[str, dict[str, Any]] = {name: {} for name in model.joint_names}
    for figure in model.figures:
        joints[figure.joint][figure.name] = {
            "value": figure.value,
            "low": figure.low,
            "high": figure.high,
            "unit": figure.unit,
        }
    for name, width in zip(model.joint_names, model.loss.transition_speed, strict=True):
        joints[name]["transition_speed"] = {"value": float(width), "unit": "rad/s"}
    links = zip(arm.links, arm.inertial_parameters.reshape(-1, 10), strict=True)
    record = {
        "robot": model.robot.name,
        "joints": joints,
        "link_order": "m mx my mz Ixx Ixy Iyy Ixz Iyz Izz, about the joint frame, SI",
        "links": {name: row.tolist() for name, row in links},
        **({"laws": [_law(law, model.joint_names[law.joint]) for law in model.named]} if model.named else {}),
    }
    return tomli_w.dumps(record)


def _law(law: NamedLaw, joint: str) -> dict[str, Any]:
    """A named law with the intervals of its coefficients."""
    figures = [{"value": value, "low": low, "high": high} for value, low, high in law.figures]
    return {"effect": law.effect, "joint": joint, "shape": dict(law.shape), "coefficients": figures}


def _left_out(model: HybridModel) -> list[str]:
    """What no file says."""
    told = ["a URDF has no place for rotor inertia, nor for the speed over which dry friction turns round"]
    if np.any(model.loss.offset != 0.0):
        told.append("torque offsets are in parameters.toml alone")
    if model.coupling is not None:
        shaft = model.coupling.shaft
        pair = f"{model.joint_names[shaft.first]} and {model.joint_names[shaft.second]}"
        told.append(f"the shaft shared by {pair} is in the model folder alone")
    if model.named:
        laws = ", ".join(f"{law.effect} of {model.joint_names[law.joint]}" for law in model.named)
        told.append(f"in torque_model.py (extra_torque) and parameters.toml alone: {laws}")
    if model.net is not None:
        told.append("the residual net is in the model folder alone")
    return told


def _loaded_back(
    name: str, written: WrittenPatch, arm: ArmModel, losses: Losses, named: Sequence[NamedLaw]
) -> dict[str, Any]:
    """Largest torque difference between the loaded file and the model, net and offsets aside [N m].

    Named laws are held against the module alone: the other files have no words for them.
    """
    path = written.folder / FILES[name]
    if name == "toml":
        return {"loads": bool(_read_toml(path)["joints"])}
    q, dq, ddq = random_states(written.arm, np.random.default_rng(0))
    wanted = arm.inverse_dynamics(q, dq, ddq) + losses.torque(dq, ddq, np.tanh(dq / losses.transition))
    if name == "python":
        module = load_module(path)
        torque = module.modelled_torque(q, dq, ddq) + module.extra_torque(q, dq, ddq)
        wanted = wanted + named_torque(named, q, dq, arm.inverse_dynamics(q, dq, ddq), losses.transition)
    else:
        torque = written.load(name).joint_torque(q, dq, ddq, 0.0)
    return {"loads": True, "torque_difference_Nm": float(np.max(np.abs(torque - wanted)))}


def _read_toml(path: Path) -> dict[str, Any]:
    import tomllib

    return tomllib.loads(path.read_text(encoding="utf-8"))


def _errors(
    formats: Sequence[str], written: WrittenPatch, model: HybridModel, motions: Sequence[Motion]
) -> dict[str, dict[str, float]]:
    """Torque error of each loaded file on recordings, where joints move, and of the URDF as it was given [N m]."""
    squares: dict[str, float] = dict.fromkeys(["before", *formats], 0.0)
    count = 0
    for motion in motions:
        own = motion.select(model.joint_names)
        states = (own.q, own.dq, own.ddq)
        torques = {"before": model.nominal.with_payload(own.payload).inverse_dynamics(*states)}
        for name in formats:
            torques[name] = written.load(name, own.payload).joint_torque(*states, own.interval)
        count += int(own.moving.sum())
        for name, torque in torques.items():
            squares[name] += float(np.sum(np.where(own.moving, own.tau_filtered - own.filtered(torque), 0.0) ** 2))
    before = math.sqrt(squares["before"] / max(1, count))
    return {name: {"before": before, "after": math.sqrt(squares[name] / max(1, count))} for name in formats}
