"""What was identified, written into a user's own URDF."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError, first_line
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import CONSTRAINT_TIME, HARDNESS
from ident.export.own_file import REMEDY
from ident.export.written_into import (
    OTHER_LINKS,
    WrittenInto,
    as_digits,
    by_name,
    link_changes,
    match_joints,
    new_digits,
)
from ident.export.xml_places import EditedXml, Element
from ident.model.bodies import is_consistent
from ident.model.link_inertia import new_numbers, read_inertial
from ident.robot.arm import ArmModel
from ident.robot.safe_xml import declare_prefixes

# Of a simulator's own softness of dry friction, by which a standing joint creeps.
SOFT_FRICTION = (
    "how hard dry friction is, for which a URDF has no place: in MuJoCo joints that stand creep "
    f'without solreffriction="{CONSTRAINT_TIME!r} 1" solimpfriction="{HARDNESS} {HARDNESS}" at '
    "each joint, as robot.xml has them"
)


def edit_urdf(edited: EditedXml, identified: IdentifiedArm, written: WrittenInto) -> None:
    """Sets friction of each joint, and changes links that are the arm's.

    Args:
        edited: The user's file; it is changed.
        identified: What was identified.
        written: What was written, and what not; it is filled.

    Raises:
        InputError: The file lacks a joint of the arm, or two joints have one name.
    """
    arm = identified.nominal
    losses = identified.losses
    joints = by_name(edited.root.children, "joint")
    _require_single(joints, edited.root.children, written.path)
    names = match_joints(arm.joint_names, list(joints), written.path)
    for j, joint in enumerate(arm.joint_names):
        values = {"damping": float(losses.viscous[j]), "friction": float(losses.coulomb[j])}
        element = joints[names[joint]]
        dynamics = element.child("dynamics")
        new = new_digits(dynamics, {key: [value] for key, value in values.items()})
        if dynamics is not None:
            edited.set(dynamics, new)
        else:
            attributes = " ".join(f'{key}="{text}"' for key, text in new.items())
            edited.insert(element, f"<dynamics {attributes}/>")
        written.joints[names[joint]] = values
    units = ["kg" if slides else "kg m²" for slides in arm.sliding_joints]
    rotors = []
    for name, inertia, unit in zip(arm.joint_names, losses.motor_inertia, units, strict=True):
        rotors.append(f"{name} {inertia:.4g} {unit}")
    written.left.append(f"rotor inertia, for which a URDF has no place: {', '.join(rotors)}")
    if np.any(losses.coulomb):
        written.left.append(SOFT_FRICTION)
    reason = _other_urdf(edited, arm, written)
    if reason:
        written.left.append(OTHER_LINKS.format(reason))
        return
    links = by_name(edited.root.children, "link")
    for name, change in zip(arm.links, link_changes(identified), strict=True):
        if np.any(change):
            _change_urdf_link(edited, links[name], change, written)


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
        values = {key: as_digits(value) for key, value in numbers.items()}
        element = elements[tag]
        if element is not None:
            edited.set(element, values)
        else:
            text = " ".join(f'{key}="{value}"' for key, value in values.items())
            edited.insert(inertial, f"<{tag} {text}/>")
    if new:
        written.links.append(name)
