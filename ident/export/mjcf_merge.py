"""What was identified, put into a user's own MJCF: joints and inertias change, all the rest stays as it is.

Geoms, meshes, defaults, actuators, sites, keyframes and comments are the user's. What hangs on a link in the file and
moves with it (a hand, its fingers) keeps its own inertia, and the link takes the rest of what was identified.
"""

from __future__ import annotations

import os
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.export.bodies import moved
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import inertial_attributes
from ident.export.mjcf_joint import joint_elements, numbers
from ident.export.mjcf_match import Match, match_file
from ident.files import atomic_write
from ident.laws.acting import payload_parameters
from ident.laws.motion import Losses
from ident.model.inertia import is_consistent
from ident.robot.arm import ArmModel

# Attributes of a joint that identification knows; its range, limits and what else it has are the user's.
WRITTEN = frozenset(
    {"armature", "damping", "frictionloss", "solreffriction", "solimpfriction", "springref", "stiffness"}
)
# Parts of which such an edit says nothing, and why.
LEFT_OUT = {
    "second joint": "an elastic gear needs a second joint",
    "zero": "a shifted zero would move the ranges, keyframes and actuators of the file",
    **dict.fromkeys(("gain", "bias"), "the file's actuators are left as they are"),
    **dict.fromkeys(("delay", "cutoff"), "the file's sensors are left as they are"),
}
STATES = 50


def merge_mjcf(source: Path, out: Path, identified: IdentifiedArm, placed: Path | None = None) -> dict[str, Any]:
    """Writes a copy of an MJCF with what was identified.

    Args:
        source: The user's file; it is left as it is.
        out: The copy; paths of its meshes point to where they are.
        identified: The arm.
        placed: Where the copy will lie in the end, if `out` is only where it is put together.

    Returns:
        Which joint of the file is which of the arm, what the copy does not say and why, and the largest difference of
        its torque from the identified arm's at random states [N m].

    Raises:
        InputError: The file can't be read, is of another arm, or what hangs on a link weighs more than was identified.
    """
    root, model = _open(source)
    arm, changes = identified.whole, identified.changes
    match = match_file(identified.nominal, model, source)
    links = np.array(arm.inertial_parameters).reshape(-1, 10)
    links[-1] += sum(payload_parameters(one.values) for one in changes if one.part("mjcf") == "load")
    elements = {one.get("name"): one for one in root.iter("joint")}
    for name, own in zip(match.joints, joint_elements(identified), strict=True):
        for key in WRITTEN & own.joint.keys():
            elements[name].set(key, own.joint[key])
    _write_links(root, match, model, links, arm, source)
    if not identified.is_level:
        _child(root, "option").set("gravity", numbers(match.base_turn @ identified.gravity))
    compiler, here = _child(root, "compiler"), Path(source).parent
    folders = {key: compiler.get(key, compiler.get("assetdir", "")) for key in ("meshdir", "texturedir")}
    _point_to_meshes(compiler, folders, here, (placed or out).parent)
    text = ET.tostring(root, encoding="unicode") + "\n"
    with atomic_write(out) as part:
        part.write_text(text, encoding="utf-8")
    left_out = [f"{one.effect}: {LEFT_OUT[left]}" for one in changes if (left := one.part("mjcf")) in LEFT_OUT]
    whole = arm.with_inertial_parameters(links.ravel()).with_gravity(identified.gravity)
    _point_to_meshes(compiler, folders, here, None)
    far = _difference(ET.tostring(root, encoding="unicode"), match, whole, identified.losses, bool(changes))
    joints = dict(zip(arm.joint_names, match.joints, strict=True))
    return {"joints": joints, "left_out": left_out, "torque_difference_Nm": far}


def _child(root: ET.Element, tag: str) -> ET.Element:
    """An element of the file, made at its head if it is not there."""
    found = root.find(tag)
    if found is None:
        found = ET.Element(tag)
        root.insert(0, found)
    return found


def _open(source: Path) -> tuple[ET.Element, mujoco.MjModel]:
    try:
        parser = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
        root = ET.parse(source, parser).getroot()
        if root.find(".//include") is not None:
            raise InputError(source, "it includes other files", "give the file in which the arm's bodies stand")
        return root, mujoco.MjModel.from_xml_path(str(source))
    except (OSError, ET.ParseError, ValueError) as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(source, f"can't be read as MJCF ({reason})", "give a file that MuJoCo loads") from None


def _write_links(
    root: ET.Element, match: Match, model: mujoco.MjModel, links: Float[Array, "n 10"], arm: ArmModel, source: Path
) -> None:
    """Gives each body its link's inertia, less what hangs on it in the file."""
    elements = {one.get("name"): one for one in root.iter("body")}
    own = {model.body(name).id for name in match.bodies}
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for j, name in enumerate(match.bodies):
        left = moved(links[j], match.turns[j], match.shifts[j]) - _hanging(model, data, model.body(name).id, own)
        if not is_consistent(left):
            what = f"{arm.links[j]}: what hangs on body {name!r} leaves no body of what was identified"
            raise InputError(source, what, "give a file without the tool, or a URDF with it")
        body = elements[name]
        for old in body.findall("inertial"):
            body.remove(old)
        body.insert(0, ET.Element("inertial", inertial_attributes(left)))


def _hanging(model: mujoco.MjModel, data: mujoco.MjData, body: int, own: set[int]) -> Float[Array, " 10"]:
    """Inertia in a body's frame of all below it that is no link of the arm, in the file's own pose."""
    total = np.zeros(10)
    turn, place = data.xmat[body].reshape(3, 3), data.xpos[body]
    for other in range(body + 1, model.nbody):
        above = int(model.body_parentid[other])
        while above > body and above not in own:
            above = int(model.body_parentid[above])
        if above != body or other in own:
            continue
        frame = data.ximat[other].reshape(3, 3)
        moments = model.body_inertia[other]
        alone = np.array([model.body_mass[other], 0, 0, 0, moments[0], 0, moments[1], 0, 0, moments[2]], dtype=float)
        total += moved(alone, turn.T @ frame, turn.T @ (data.xipos[other] - place))
    return total


def _point_to_meshes(compiler: ET.Element, folders: Mapping[str, str], here: Path, there: Path | None) -> None:
    """Makes a copy of the file find meshes and textures: from another folder, or from anywhere."""
    for key, folder in folders.items():
        place = here.resolve() / folder
        compiler.set(key, str(place) if there is None else os.path.relpath(place, there.resolve()))
    compiler.attrib.pop("assetdir", None)
    if compiler.get("inertiafromgeom") == "true":  # would overrule what is written
        compiler.set("inertiafromgeom", "auto")


def _difference(text: str, match: Match, arm: ArmModel, losses: Losses, effects: bool) -> float:
    """Largest difference of torque between the merged file and the identified arm, without contacts [N m]."""
    model = mujoco.MjModel.from_xml_string(text)
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= int(off.mjDSBL_CONSTRAINT | off.mjDSBL_SPRING | off.mjDSBL_DAMPER)
    if not effects:  # a base that stands askew in the file is the user's
        model.opt.gravity[:] = match.base_turn @ np.array(arm.model.gravity.linear)
    data = mujoco.MjData(model)
    ids = [model.joint(name).id for name in match.joints]
    places, rates = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
    rng = np.random.default_rng(0)
    low, high = np.maximum(arm.lower, -np.pi), np.minimum(arm.upper, np.pi)
    q = rng.uniform(low, high, (STATES, arm.n))
    dq, ddq = rng.uniform(-1.5, 1.5, q.shape), rng.uniform(-3.0, 3.0, q.shape)
    wanted = arm.inverse_dynamics(q, dq, ddq) + losses.motor_inertia * ddq
    found = np.empty_like(q)
    for k in range(STATES):
        mujoco.mj_resetData(model, data)
        data.qpos[places], data.qvel[rates], data.qacc[rates] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        found[k] = data.qfrc_inverse[rates]
    return float(np.abs(found - wanted).max())
