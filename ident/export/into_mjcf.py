"""What was identified, written into a user's own MJCF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from warnings import catch_warnings

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.errors import InputError, first_line
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import CONSTRAINT_TIME, HARDNESS
from ident.export.own_file import REMEDY
from ident.export.written_into import (
    OTHER_LINKS,
    WrittenInto,
    as_digits,
    by_name,
    lend_beside,
    link_changes,
    match_joints,
    new_digits,
)
from ident.export.xml_places import EditedXml, Element, find_all
from ident.model.bodies import is_consistent
from ident.model.link_inertia import ENTRIES, SAME, about_centre, moved
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale

# How far an axis of the file may lie from the URDF's to be the same [m, rad].
SAME_PLACE = 1e-4
# How far inertial numbers may differ to be the same, in the link's own sizes.
SAME_INERTIA = 0.01
# Positions at which axes are compared beside zero [rad].
COMPARED_AT = 0.3
# Order of MuJoCo's moments: xx yy zz xy xz yz.
MUJOCO_ENTRIES = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
# A body of the file, and its frame in that of the arm's link: rotation and place.
Frame = tuple[int, Float[Array, "3 3"], Float[Array, " 3"]]


def edit_mjcf(edited: EditedXml, identified: IdentifiedArm, written: WrittenInto) -> None:
    """Sets friction and rotor inertia of each joint, and changes bodies that are the arm's links.

    Args:
        edited: The user's file; it is changed.
        identified: What was identified.
        written: What was written, and what not; it is filled.

    Raises:
        InputError: The file lacks a joint of the arm, or two joints have one name.
    """
    arm = identified.nominal
    losses = identified.losses
    owners: dict[str, tuple[Element, Element]] = {}
    for body in find_all(edited.root, lambda element: element.tag == "body"):
        for name, element in by_name(body.children, "joint").items():
            if name and name in owners:
                raise InputError(written.path, f"it has two joints {name!r}", REMEDY)
            owners[name] = (body, element)
    names = match_joints(arm.joint_names, list(owners), written.path)
    for j, joint in enumerate(arm.joint_names):
        bend = losses.bend[j]
        damping = [losses.viscous[j], *bend] if np.any(bend) else [losses.viscous[j]]
        values = {
            "damping": float(losses.viscous[j]),
            "frictionloss": float(losses.coulomb[j]),
            "armature": float(losses.motor_inertia[j]),
        }
        numbers = {**{key: [value] for key, value in values.items()}, "damping": damping}
        element = owners[names[joint]][1]
        text = new_digits(element, numbers)
        # Dry friction that is as hard as identified: by the default a light joint creeps.
        text |= {
            "solreffriction": f"{CONSTRAINT_TIME!r} 1",
            "solimpfriction": f"{HARDNESS} {HARDNESS}",
        }
        edited.set(element, text)
        written.joints[names[joint]] = values
    changes = link_changes(identified)
    if not np.any(changes):
        return
    try:
        with lend_beside(written.path, edited.text) as temporary:
            model = compile_file(temporary)
    except ValueError as error:
        written.left.append(OTHER_LINKS.format(f"the file does not load ({first_line(error)})"))
        return
    frames = _frames_of(model, arm, names)
    if frames is None:
        written.left.append(OTHER_LINKS.format("its axes are not where those of --robot are"))
        return
    for j, joint in enumerate(arm.joint_names):
        if np.any(changes[j]):
            body = owners[names[joint]][0]
            _change_mjcf_body(edited, body, model, frames[j], arm, j, changes[j], written)


def compile_file(path: Path) -> mujoco.MjModel:
    """MuJoCo's model of a file, its meshes beside it.

    Raises:
        ValueError: MuJoCo refuses it.
    """
    mujoco.set_mju_user_warning(lambda _: None)
    try:
        with catch_warnings(action="ignore"):
            return mujoco.MjModel.from_xml_path(str(path))
    except mujoco.FatalError as error:
        raise ValueError(first_line(error)) from None


def _frames_of(
    model: mujoco.MjModel, arm: ArmModel, names: Mapping[str, str]
) -> list[Frame] | None:
    """Where each body of the file stands in the arm's link; None where an axis is another one."""
    frames: list[Frame] = []
    for angle in (0.0, COMPARED_AT):
        frames = []
        data = mujoco.MjData(model)
        joints = [model.joint(names[joint]) for joint in arm.joint_names]
        for joint in joints:
            data.qpos[joint.qposadr] = angle
        mujoco.mj_forward(model, data)
        base = int(model.body_parentid[joints[0].bodyid[0]])
        turn = data.xmat[base].reshape(3, 3)
        place = data.xpos[base]
        poses = arm.link_poses(np.full((1, arm.n), angle), arm.links)
        for j, joint in enumerate(joints):
            link_turn, link_place = (values[0] for values in poses[arm.links[j]])
            axis = turn.T @ data.xaxis[joint.id]
            anchor = turn.T @ (data.xanchor[joint.id] - place)
            wanted = link_turn @ arm.joint_axes[j]
            across = np.cross(anchor - link_place, wanted)
            turned = np.linalg.norm(axis - wanted)
            if turned > SAME_PLACE or np.linalg.norm(across) > SAME_PLACE:
                return None
            body = int(joint.bodyid[0])
            own_turn = turn.T @ data.xmat[body].reshape(3, 3)
            own_place = turn.T @ (data.xpos[body] - place)
            frames.append((body, link_turn.T @ own_turn, link_turn.T @ (own_place - link_place)))
    return frames


def _change_mjcf_body(
    edited: EditedXml,
    body: Element,
    model: mujoco.MjModel,
    frame: Frame,
    arm: ArmModel,
    index: int,
    change: Float[Array, " 10"],
    written: WrittenInto,
) -> None:
    """Adds to a body's own inertia, if the file's link with what is fixed to it is the URDF's."""
    name = body.attributes.get("name", arm.links[index])
    number, turn, place = frame
    nominal = arm.inertial_parameters[10 * index : 10 * index + 10]
    whole = moved(_welded_inertia(model, number), turn, place)
    scale = parameter_scale(arm)[10 * index : 10 * index + 10]
    if np.all(np.abs(change) <= SAME * scale):
        return
    off = (whole - nominal) / scale
    beside = off - change / scale  # as it will be once the change is in it
    is_alike = np.all(np.abs(beside) <= SAME_INERTIA)
    if is_alike and np.linalg.norm(beside) < np.linalg.norm(off):
        written.left.append(f"{name}: its inertia is as identified already")
        return
    if np.any(np.abs(off) > SAME_INERTIA):
        written.left.append(f"{name}: its inertia is not that of {arm.links[index]} in --robot")
        return
    back = turn.T
    given = _body_inertia(model, number)
    changed = given + moved(change, back, -back @ place)
    if not is_consistent(changed):
        written.left.append(f"{name}: what was identified is more than the body itself has")
        return
    mass, centre, about = about_centre(changed)
    old = body.child("inertial")
    moments = about_centre(given)[2]
    size = np.abs(about).max()
    place_of_mass: dict[str, Sequence[float] | Array] = {"pos": centre, "mass": [mass]}
    if old is not None and np.abs(about - moments).max() <= SAME * size:
        edited.set(old, new_digits(old, place_of_mass))
    else:
        numbers = {**place_of_mass, "fullinertia": about[MUJOCO_ENTRIES]}
        text = " ".join(f'{key}="{as_digits(value)}"' for key, value in numbers.items())
        if old is None:
            edited.insert(body, f"<inertial {text}/>")
        else:
            edited.replace(old, f"<inertial {text}/>")
    written.links.append(name)


def _body_inertia(model: mujoco.MjModel, body: int) -> Float[Array, " 10"]:
    """Ten numbers of a body about its own frame."""
    principal = np.diag(model.body_inertia[body])
    turn = Rotation.from_quat(model.body_iquat[body], scalar_first=True).as_matrix()
    about = turn @ principal @ turn.T
    ball = np.concatenate([[0.0, 0.0, 0.0, 0.0], about[ENTRIES]])
    ball[0] = model.body_mass[body]
    return moved(ball, np.eye(3), model.body_ipos[body])


def _welded_inertia(model: mujoco.MjModel, body: int) -> Float[Array, " 10"]:
    """Ten numbers, about its frame, of a body and all that is fixed to it."""
    total = _body_inertia(model, body)
    for other in range(body + 1, model.nbody):
        if model.body_parentid[other] == body and model.body_jntnum[other] == 0:
            turn = Rotation.from_quat(model.body_quat[other], scalar_first=True).as_matrix()
            total = total + moved(_welded_inertia(model, other), turn, model.body_pos[other])
    return total
