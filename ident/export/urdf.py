"""The URDF with named effects written into it.

The user's own file is edited, comments and meshes stay. Losses go into <dynamics>; rotor inertia, for which a URDF has
no place, stands in the parameter file.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.effects.rigid_body import UnknownPayload
from ident.export.bodies import about_centre, moved, numbers
from ident.export.identified import IdentifiedArm
from ident.model.inertia import is_consistent
from ident.robot.urdf import link_of, matrix_to_rpy, read_vector, rotation_about, rpy_to_matrix

NOTE = " written by `ident patch`; patch.json beside this file says what is in it and what is not "
PAYLOAD, LEVEL = UnknownPayload.id, "level"
# Share of its inertia that a link keeps whose mass another link takes over: no joint may move nothing.
LEFT = 1e-6
# A payload is told as a point; simulators need some extent [m].
PAYLOAD_RADIUS = 0.01
MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
ENTRIES = (np.array([0, 0, 1, 0, 1, 2]), np.array([0, 1, 1, 2, 2, 2]))


def write_urdf(identified: IdentifiedArm) -> str:
    """The patched URDF: the arm's source file is edited where there is one, and losses that it states are replaced."""
    arm, losses, links = identified.nominal, identified.losses, identified.links.total
    text = arm.source.read_text(encoding="utf-8") if arm.source is not None else arm.urdf
    root = ET.fromstring(text, parser=ET.XMLParser(target=ET.TreeBuilder(insert_comments=True)))
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    bodies = {link.get("name"): link for link in root.findall("link")}
    for j, name in enumerate(arm.joint_names):
        dynamics = child(joints[name], "dynamics")
        dynamics.set("damping", repr(float(losses.viscous[j])))
        dynamics.set("friction", repr(float(losses.coulomb[j])))
        if np.any(links[j]):
            _add_inertia(root, bodies[arm.links[j]], links[j], arm.locked_joints)
    for change in identified.changes:
        part, p = change.part("urdf"), change.values
        if part == "load":
            inertial = ET.SubElement(ET.SubElement(root, "link", name=PAYLOAD), "inertial")
            mass, centre = p["mass_kg"], np.array([p[f"com_{axis}_m"] for axis in "xyz"])
            _set_inertial(inertial, mass, centre, mass * PAYLOAD_RADIUS**2 * np.eye(3))
            _fix(root, f"{PAYLOAD}_fixed", arm.links[-1], PAYLOAD, np.eye(3))
        elif part == "zero":
            _turn_joint(joints[arm.joint_names[change.joint]], p["offset_rad"])
    if not identified.is_level:
        # A level link below the base, which stands on it askew, or hangs: so that gravity pulls along the link's -z.
        below = {joint.find("child").get("link") for joint in root.findall("joint")}  # type: ignore[union-attr]
        base = next(link.get("name") for link in root.findall("link") if link.get("name") not in below)
        ET.SubElement(root, "link", name=LEVEL)
        down = identified.gravity[None] / np.linalg.norm(identified.gravity)
        turn = Rotation.align_vectors(np.array([[0.0, 0.0, -1.0]]), down)[0]
        _fix(root, f"{LEVEL}_to_base", LEVEL, str(base), turn.as_matrix())
    root.insert(0, ET.Comment(NOTE))
    ET.indent(root)
    return '<?xml version="1.0"?>\n' + ET.tostring(root, encoding="unicode") + "\n"


def child(element: ET.Element, tag: str) -> ET.Element:
    """A child of an element, made if it is not there."""
    found = element.find(tag)
    return ET.SubElement(element, tag) if found is None else found


def _add_inertia(root: ET.Element, link: ET.Element, change: Float[Array, " 10"], locked: Mapping[str, float]) -> None:
    """Adds to a link's ten numbers.

    What hangs on the link keeps its own, unless the change takes more than the link itself has: then the link gets that
    of what is fixed to it too, and where this is not enough, of what is locked.
    """
    inertial = child(link, "inertial")
    numbers = _ten_numbers(inertial) + change
    for held in ({}, locked):
        if is_consistent(numbers):
            break
        for other, pose in list(_hanging_on(root, link, np.eye(4), held)):
            own = other.find("inertial")
            if own is not None:
                taken = (1.0 - LEFT) * _ten_numbers(own)
                numbers = numbers + moved(taken, pose[:3, :3], pose[:3, 3])
                _set_inertial(own, *about_centre(LEFT / (1.0 - LEFT) * taken))
    _set_inertial(inertial, *about_centre(numbers))


def _hanging_on(
    root: ET.Element, link: ET.Element, pose: Float[Array, "4 4"], locked: Mapping[str, float]
) -> Iterator[tuple[ET.Element, Array]]:
    """Links that are fixed to a link or held by locked joints, one by one outwards, with their frames in its own."""
    for joint in root.findall("joint"):
        name, kind = joint.get("name", ""), joint.get("type")
        if link_of(joint, "parent") != link.get("name") or not (kind == "fixed" or name in locked):
            continue
        origin, axis = joint.find("origin"), read_vector(joint.find("axis"), "xyz", "1 0 0")
        placed, position = np.eye(4), locked.get(name, 0.0) if kind != "fixed" else 0.0
        placed[:3, :3], placed[:3, 3] = rpy_to_matrix(read_vector(origin, "rpy")), read_vector(origin, "xyz")
        if kind == "prismatic":
            placed[:3, 3] += placed[:3, :3] @ axis * position
        else:
            placed[:3, :3] = placed[:3, :3] @ rotation_about(axis, position)
        child = next(one for one in root.findall("link") if one.get("name") == link_of(joint, "child"))
        yield child, pose @ placed
        yield from _hanging_on(root, child, pose @ placed, locked)


def _ten_numbers(inertial: ET.Element) -> Float[Array, " 10"]:
    """Mass, first and second moments about the link's frame; zero for an empty element."""
    origin, mass, inertia = inertial.find("origin"), inertial.find("mass"), inertial.find("inertia")
    if mass is None or inertia is None:
        return np.zeros(10)
    own = np.zeros(10)
    own[0] = float(mass.get("value", "0"))
    own[4:] = [float(inertia.get(key, "0")) for key in MOMENTS]
    return moved(own, rpy_to_matrix(read_vector(origin, "rpy")), read_vector(origin, "xyz"))


def _set_inertial(inertial: ET.Element, mass: float, centre: Array, inertia: Float[Array, "3 3"]) -> None:
    origin = child(inertial, "origin")
    origin.set("xyz", numbers(centre))
    origin.set("rpy", "0 0 0")
    child(inertial, "mass").set("value", repr(mass))
    moments = child(inertial, "inertia")
    for key, value in zip(MOMENTS, inertia[ENTRIES], strict=True):
        moments.set(key, repr(float(value)))


def _fix(root: ET.Element, name: str, parent: str, child: str, turn: Float[Array, "3 3"]) -> None:
    joint = ET.SubElement(root, "joint", name=name, type="fixed")
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=child)
    ET.SubElement(joint, "origin", xyz="0 0 0", rpy=numbers(matrix_to_rpy(turn)))


def _turn_joint(joint: ET.Element, offset: float) -> None:
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
