"""The URDF of a patched arm.

The user's own file is edited, comments and meshes stay. Losses go into <dynamics>; rotor inertia,
for which a URDF has no place, stands in the parameter file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.effects.rigid_body import UnknownPayload
from ident.errors import RobotError
from ident.export.identified import IdentifiedArm
from ident.model.bodies import is_consistent
from ident.model.link_inertia import ball_of, child, moved, numbers, read_inertial, set_inertial
from ident.robot.arm import ArmModel
from ident.robot.rotations import matrix_to_rpy, rotation_about, rpy_to_matrix
from ident.robot.safe_xml import declare_prefixes
from ident.robot.urdf_elements import link_of, read_vector
from ident.safe_read import read_text

Element = ET.Element

NOTE = " written by `ident patch`; patch.json beside this file says what is in it and what is not "
PAYLOAD = UnknownPayload.id
LEVEL = "level"
# Share of its inertia that a link keeps whose mass another link takes over: no joint may move
# nothing.
LEFT = 1e-6
# A payload is reported as a point; simulators need some extent [m].
PAYLOAD_RADIUS = 0.01
# Where gravity pulls in the frame of a level link.
DOWN = np.array([[0.0, 0.0, -1.0]])


def write_urdf(identified: IdentifiedArm) -> str:
    """The patched URDF: the source file is edited where there is one, and losses that it states
    are replaced.
    """
    arm = identified.nominal
    losses = identified.losses
    links = identified.links.total
    text = source_text(arm)
    keeping_comments = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    root = ET.fromstring(declare_prefixes(text), parser=keeping_comments)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    bodies = {link.get("name"): link for link in root.findall("link")}
    for j, name in enumerate(arm.joint_names):
        dynamics = child(joints[name], "dynamics")
        dynamics.set("damping", repr(float(losses.viscous[j])))
        dynamics.set("friction", repr(float(losses.coulomb[j])))
        if np.any(links[j]):
            _add_inertia(root, bodies[arm.links[j]], links[j], arm)
    for change in identified.changes:
        place = change.part("urdf")
        parameters = change.values
        if place == "load":
            centre = np.array([parameters[f"com_{axis}_m"] for axis in "xyz"])
            ball = ball_of(parameters["mass_kg"], centre, PAYLOAD_RADIUS)
            set_inertial(ET.SubElement(root, "link", name=PAYLOAD), ball)
            _fix(root, f"{PAYLOAD}_fixed", arm.links[-1], PAYLOAD, np.eye(3))
        elif place == "zero":
            _turn_joint(joints[arm.joint_names[change.joint]], parameters["offset_rad"])
    if not identified.is_level:
        _stand_on_a_level_link(root, identified.gravity)
    root.insert(0, ET.Comment(NOTE))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def _stand_on_a_level_link(root: Element, gravity: Float[Array, " 3"]) -> None:
    """Puts a level link below the base, which stands on it askew, or hangs: so that gravity pulls
    along the link's -z.
    """
    names = [link.get("name") for link in root.findall("link")]
    below = {link_of(joint, "child") for joint in root.findall("joint")}
    base = next(name for name in names if name not in below)
    ET.SubElement(root, "link", name=LEVEL)
    pull = gravity[None] / np.linalg.norm(gravity)
    turn = Rotation.align_vectors(DOWN, pull)[0]
    _fix(root, f"{LEVEL}_to_base", LEVEL, str(base), turn.as_matrix())


def source_text(arm: ArmModel) -> str:
    """The URDF file that an arm was read from; where there is none any more, the arm's own text.

    Raises:
        RobotError: The file has another arm by now: what was identified is not about that.
    """
    if arm.source is None or not arm.source.is_file():
        return arm.urdf
    text = read_text(arm.source, "put the file back as it was, or away", RobotError)
    as_locked = (arm.source, tuple(arm.locked_joints.items()))
    if _content_of(text, *as_locked, arm.tip) != _content_of(arm.urdf, *as_locked, ""):
        what = "its joints, lengths or inertias are no longer those of the arm that was identified"
        remedy = "identify the arm again, or put the file back as it was, or away"
        raise RobotError(arm.source, what, remedy)
    return text


def tip_in_file(arm: ArmModel) -> str:
    """The last joint by which the arm is found in what is written of it; empty where that has one
    arm alone.
    """
    return arm.tip if arm.source is not None and arm.source.is_file() else ""


@lru_cache(maxsize=4)
def _content_of(text: str, source: Path, locked: tuple[tuple[str, float], ...], tip: str) -> str:
    """What a URDF says of the arm up to a tip with some joints locked; those that it has fixed
    stay so.

    The last are kept: one arm is written in many variants.
    """
    whole = ArmModel.from_whole_urdf(text, source, tip)
    there = {name: position for name, position in locked if name in whole.joint_names}
    return ArmModel.from_urdf(whole.urdf, source, there, tip).content


def _add_inertia(root: Element, link: Element, change: Float[Array, " 10"], arm: ArmModel) -> None:
    """Adds to a link's ten numbers.

    What hangs on the link keeps its own, unless the change takes more than the link itself has:
    then the link gets that of what is fixed to it too, and where this is not enough, of what is
    locked.
    """
    inertia = read_inertial(link) + change
    for held in ({}, arm.locked_joints):
        if is_consistent(inertia):
            break
        for other, pose in list(_hanging_on(root, link, np.eye(4), held)):
            of_other = read_inertial(other)
            if of_other.any():
                turned = moved(of_other, pose[:3, :3], pose[:3, 3])
                inertia = inertia + (1.0 - LEFT) * turned
                set_inertial(other, LEFT * of_other)
    set_inertial(link, inertia)


def _hanging_on(
    root: Element, link: Element, pose: Float[Array, "4 4"], locked: Mapping[str, float]
) -> Iterator[tuple[Element, Array]]:
    """Links that are fixed to a link or held by locked joints, one by one outwards, with their
    frames in its own.
    """
    links = {element.get("name"): element for element in reversed(root.findall("link"))}
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        kind = joint.get("type")
        is_held = kind == "fixed" or name in locked
        if not is_held or link_of(joint, "parent") != link.get("name"):
            continue
        origin = joint.find("origin")
        axis = read_vector(joint.find("axis"), "xyz", "1 0 0")
        placed = np.eye(4)
        position = locked.get(name, 0.0)
        placed[:3, :3] = rpy_to_matrix(read_vector(origin, "rpy"))
        placed[:3, 3] = read_vector(origin, "xyz")
        if kind == "prismatic":
            placed[:3, 3] += placed[:3, :3] @ axis * position
        elif kind != "fixed":  # whose axis may be anything
            placed[:3, :3] = placed[:3, :3] @ rotation_about(axis, position)
        hanging = links[link_of(joint, "child")]
        yield hanging, pose @ placed
        yield from _hanging_on(root, hanging, pose @ placed, locked)


def _fix(root: Element, name: str, parent: str, carried: str, turn: Float[Array, "3 3"]) -> None:
    """Adds a fixed joint between two links, turned at its origin."""
    joint = ET.SubElement(root, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=carried)
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy=numbers(matrix_to_rpy(turn)))


def _turn_joint(joint: Element, offset: float) -> None:
    """Logged angle = true angle − offset: the frame is turned on, the limits move back."""
    origin = child(joint, "origin")
    axis = read_vector(joint.find("axis"), "xyz", "1 0 0")
    turn = rpy_to_matrix(read_vector(origin, "rpy"))
    if joint.get("type") == "prismatic":
        place = read_vector(origin, "xyz") + offset * turn @ axis / np.linalg.norm(axis)
        origin.set("xyz", numbers(place))
    else:
        origin.set("rpy", numbers(matrix_to_rpy(turn @ rotation_about(axis, offset))))
    limit = joint.find("limit")
    for key in ("lower", "upper"):
        if limit is not None and limit.get(key) is not None:
            limit.set(key, repr(float(limit.get(key, "0")) - offset))
