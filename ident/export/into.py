"""What was identified, written into the user's own URDF or MJCF; every other byte stays as it is.

Friction and rotor inertia of each joint are set. Links are changed by what was identified of them,
so far as the file's links are the URDF's: same frames, same inertias. What is not written is told,
with the reason. Meshes, actuators, sensors, keyframes and comments are not touched.
"""

from __future__ import annotations

import difflib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from warnings import catch_warnings
from xml.etree import ElementTree

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError, first_line
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import CONSTRAINT_TIME, HARDNESS
from ident.export.own_file import REMEDY
from ident.export.xml_places import EditedXml, Element, find_all
from ident.files import atomic_write
from ident.laws.acting import payload_parameters
from ident.model.bodies import is_consistent
from ident.model.link_inertia import (
    ENTRIES,
    SAME,
    about_centre,
    is_stated,
    moved,
    new_numbers,
    read_inertial,
)
from ident.robot.arm import ArmModel
from ident.robot.tolerance import parameter_scale
from ident.safe_read import AGAIN, CHANGED, declare_prefixes, read_bytes

# How far an axis of the file may lie from the URDF's to be the same [m, rad].
SAME_PLACE = 1e-4
# How far inertial numbers may differ to be the same, in the link's own sizes.
SAME_INERTIA = 0.01
# Positions at which axes are compared beside zero [rad].
COMPARED_AT = 0.3
# Significant digits that are written into a user's own file.
DIGITS = 7
# Order of MuJoCo's moments: xx yy zz xy xz yz.
MUJOCO_ENTRIES = ((0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2))
OTHER_LINKS = "links are left as they are: {}"


@dataclass
class WrittenInto:
    """What was written into a file, and what was not."""

    path: Path
    form: str  # urdf or mjcf
    tip: str = ""  # the arm's last joint, where its robot has several arms
    joints: dict[str, dict[str, float]] = field(default_factory=dict)  # by its name in the file
    links: list[str] = field(default_factory=list)  # that were changed, by their names in the file
    left: list[str] = field(default_factory=list)  # what was not written, and why

    def to_dict(self) -> dict[str, Any]:
        """Its record: "file", "format", "joints", "links", "left" (what was not written)."""
        return {
            "file": str(self.path),
            "format": self.form,
            "joints": self.joints,
            "links": self.links,
            "left": self.left,
        }


def write_into(path: Path, data: bytes, identified: IdentifiedArm) -> tuple[bytes, WrittenInto]:
    """A user's file with what was identified: its bytes, and what is in them.

    Args:
        path: The user's URDF or MJCF; it is not opened again.
        data: Its bytes, as `read_own_file` looked them through.
        identified: The arm, with losses that stand in for what the format has no words for.

    Raises:
        InputError: It is neither, or lacks a joint of the arm.
    """
    edited = EditedXml(data, str(path))
    forms = {"robot": ("urdf", _edit_urdf), "mujoco": ("mjcf", _edit_mjcf)}
    if edited.root.tag not in forms:
        raise InputError(path, f"its root is <{edited.root.tag}>, not <robot> or <mujoco>", REMEDY)
    form, edit = forms[edited.root.tag]
    written = WrittenInto(path, form, identified.nominal.tip)
    edit(edited, identified, written)
    if not identified.is_level:
        written.left.append("gravity and the base's mount: set them where your scene has them")
    for change in identified.changes:
        if change.joint >= 0 and change.part(form) not in ("", "inertial"):
            what = f"{change.effect} of {identified.nominal.joint_names[change.joint]}"
            written.left.append(f"{what}: its part of robot.{'urdf' if form == 'urdf' else 'xml'}")
    return edited.edited(), written


def is_mjcf(path: Path, data: bytes) -> bool:
    """Whether a user's file, of which these are the bytes, is an MJCF, by its root.

    Raises:
        InputError: It is no XML.
    """
    return EditedXml(data, str(path)).root.tag == "mujoco"


def require_loadable(path: Path, text: bytes, written: WrittenInto) -> None:
    """Passes if the edited text can take the place of the user's file: its simulator loads it.

    It is tried beside the file, where its meshes are found; nothing of that stays.

    Raises:
        InputError: It does not load, or nothing can be written there.
    """
    try:
        with _beside(path, text) as temporary:
            if written.form == "mjcf":
                _compile(temporary)
            else:
                ArmModel.from_whole_urdf(text.decode(), path, written.tip)
    except (RobotError, ValueError) as error:
        what = f"with what was identified it does not load ({first_line(error)})"
        raise InputError(path, what, "take robot.urdf and robot.xml of --out") from None


class _Tried(Exception):
    """Ends the lending of a file that is not to be kept."""


@contextmanager
def _beside(path: Path, text: bytes) -> Iterator[Path]:
    """Lends a file of a text beside a user's own, where meshes are found; nothing of it stays.

    Raises:
        InputError: Nothing can be written there.
    """
    with suppress(_Tried), atomic_write(path) as temporary:
        temporary.write_bytes(text)
        yield temporary
        raise _Tried


def require_as_read(path: Path, data: bytes) -> None:
    """Passes if a user's file still is what was read.

    What somebody wrote into it since must not be lost.

    Raises:
        InputError: It is not.
    """
    if read_bytes(path, REMEDY) != data:
        raise InputError(path, f"{CHANGED}: nothing is written into it", AGAIN)


def save_into(path: Path, data: bytes, text: bytes) -> None:
    """Puts the edited text in the place of the user's file, whole or not at all.

    Args:
        path: The file.
        data, text: Its bytes as they were read, and as they are edited.

    Raises:
        InputError: It is no longer what was read.
    """
    with atomic_write(path) as temporary:
        temporary.write_bytes(text)
        require_as_read(path, data)


def match_joints(wanted: Sequence[str], there: Sequence[str], where: Path) -> dict[str, str]:
    """The name in the file of each joint of the arm: its own, or the only one that ends in it or in
    which it ends.

    Raises:
        InputError: A joint has none, or several.
    """
    matched = {}
    for joint in wanted:
        names = [name for name in there if name == joint]
        names = names or [name for name in there if _ends_alike(name, joint)]
        if len(names) != 1:
            near = difflib.get_close_matches(joint, there, 3, 0.0)
            what = f"it has no joint {joint!r}"
            if names:
                what = f"{', '.join(names)} may each be {joint!r}"
            elif near:
                what += f", only {', '.join(near)}"
            remedy = "name the joints as the URDF does; <include> is not followed"
            raise InputError(where, what, remedy)
        matched[joint] = names[0]
    several = [name for name, count in Counter(matched.values()).items() if count > 1]
    if several:
        what = f"{several[0]!r} would be two joints of the arm"
        raise InputError(where, what, "name the joints as the URDF does")
    return matched


def _ends_alike(first: str, second: str) -> bool:
    return bool(first and second) and (first.endswith(second) or second.endswith(first))


def _digits(values: Sequence[float] | Array) -> str:
    """Numbers to as many digits as any recording knows them, for who reads what changed."""
    return " ".join(f"{float(value):.{DIGITS}g}" for value in values)


def _new_digits(
    element: Element | None, numbers: Mapping[str, Sequence[float] | Array]
) -> dict[str, str]:
    """Numbers of an element as text; those that it states already are left out."""
    there = {} if element is None else element.attributes
    return {
        key: _digits(values)
        for key, values in numbers.items()
        if not is_stated(there.get(key), values)
    }


def link_changes(identified: IdentifiedArm) -> Float[Array, "n 10"]:
    """Change of every link against the URDF, a named payload on the last one."""
    changes = np.array(identified.links.total)
    for change in identified.changes:
        if change.effect == "payload":
            changes[-1] += payload_parameters(change.values)
    return changes


# URDF.


def _edit_urdf(edited: EditedXml, identified: IdentifiedArm, written: WrittenInto) -> None:
    arm = identified.nominal
    losses = identified.losses
    joints = _named(edited.root.children, "joint")
    _require_single(joints, edited.root.children, written.path)
    names = match_joints(arm.joint_names, list(joints), written.path)
    for j, joint in enumerate(arm.joint_names):
        values = {"damping": float(losses.viscous[j]), "friction": float(losses.coulomb[j])}
        element = joints[names[joint]]
        dynamics = element.child("dynamics")
        new = _new_digits(dynamics, {key: [value] for key, value in values.items()})
        if dynamics is not None:
            edited.set(dynamics, new)
        else:
            attributes = " ".join(f'{key}="{text}"' for key, text in new.items())
            edited.insert(element, f"<dynamics {attributes}/>")
        written.joints[names[joint]] = values
    inertias = zip(arm.joint_names, losses.motor_inertia, strict=True)
    units = ["kg" if slides else "kg m²" for slides in arm.sliding_joints]
    rotors = ", ".join(
        f"{name} {inertia:.4g} {unit}"
        for (name, inertia), unit in zip(inertias, units, strict=True)
    )
    written.left.append(f"rotor inertia, for which a URDF has no place: {rotors}")
    reason = _other_urdf(edited, arm, written)
    if reason:
        written.left.append(OTHER_LINKS.format(reason))
        return
    links = _named(edited.root.children, "link")
    for name, change in zip(arm.links, link_changes(identified), strict=True):
        if np.any(change):
            _change_urdf_link(edited, links[name], change, written)


def _named(elements: Sequence[Element], tag: str) -> dict[str, Element]:
    """Elements of a tag by their names."""
    return {each.attributes.get("name", ""): each for each in elements if each.tag == tag}


def _require_single(named: Mapping[str, Element], elements: Sequence[Element], where: Path) -> None:
    """Raises where two joints have one name: one of them would be left as it is."""
    joints = sum(each.tag == "joint" for each in elements)
    if joints > len(named):
        raise InputError(where, f"two of its {joints} joints have one name", REMEDY)


def _other_urdf(edited: EditedXml, arm: ArmModel, written: WrittenInto) -> str:
    """Why the file's links are not those of the arm; empty where they are."""
    try:
        in_file = ArmModel.from_whole_urdf(edited.text.decode(), written.path, arm.tip)
    except (RobotError, UnicodeDecodeError) as error:
        return f"the file does not load alone ({first_line(error)})"
    if not in_file.is_same(arm.with_gravity(in_file.model.gravity.linear)):
        return "its lengths or inertias are not those of --robot"
    if not set(arm.links) <= set(in_file.links):
        return "its links have other names than those of --robot"
    return ""


def _change_urdf_link(
    edited: EditedXml, link: Element, change: Float[Array, " 10"], written: WrittenInto
) -> None:
    """Adds to a link's own inertia; where nothing of it would be a body, it is left."""
    name = link.attributes.get("name", "")
    text = edited.text[link.start : link.end].decode()
    given = read_inertial(ElementTree.fromstring(declare_prefixes(text)))
    changed = given + change
    inertial = link.child("inertial")
    if inertial is None or not is_consistent(changed):
        written.left.append(f"{name}: what was identified is more than the link itself has")
        return
    elements = {tag: inertial.child(tag) for tag in ("origin", "mass", "inertia")}
    stated = {tag: each.attributes for tag, each in elements.items() if each is not None}
    new = new_numbers(stated, changed)
    for tag, numbers in new.items():
        values = {key: _digits(value) for key, value in numbers.items()}
        element = elements[tag]
        if element is not None:
            edited.set(element, values)
        else:
            text = " ".join(f'{key}="{value}"' for key, value in values.items())
            edited.insert(inertial, f"<{tag} {text}/>")
    if new:
        written.links.append(name)


# MJCF.


def _edit_mjcf(edited: EditedXml, identified: IdentifiedArm, written: WrittenInto) -> None:
    arm = identified.nominal
    losses = identified.losses
    owners: dict[str, tuple[Element, Element]] = {}
    for body in find_all(edited.root, lambda element: element.tag == "body"):
        for name, element in _named(body.children, "joint").items():
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
        text = _new_digits(element, numbers)
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
        with _beside(written.path, edited.text) as temporary:
            model = _compile(temporary)
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


def _compile(path: Path) -> mujoco.MjModel:
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


# A body of the file, and its frame in that of the arm's link: rotation and place.
Frame = tuple[int, Float[Array, "3 3"], Float[Array, " 3"]]


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
            if np.linalg.norm(axis - wanted) > SAME_PLACE or np.linalg.norm(across) > SAME_PLACE:
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
    if np.all(np.abs(beside) <= SAME_INERTIA) and np.linalg.norm(beside) < np.linalg.norm(off):
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
        edited.set(old, _new_digits(old, place_of_mass))
    else:
        numbers = {**place_of_mass, "fullinertia": about[MUJOCO_ENTRIES]}
        text = " ".join(f'{key}="{_digits(value)}"' for key, value in numbers.items())
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
