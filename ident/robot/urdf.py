"""A URDF brought into the one form that the rest works on: a chain of one-axis joints."""

from __future__ import annotations

import difflib
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping

import numpy as np

from ident.errors import RobotError
from ident.robot.branches import gripper_joints, joints_to_base
from ident.robot.rotations import matrix_to_rpy, rotation_about, rpy_to_matrix
from ident.robot.safe_xml import read_xml
from ident.robot.urdf_checks import OPTIONAL, check_urdf
from ident.robot.urdf_elements import followers, moving_joints, name_of, read_vector

# What a fixed joint has no use for.
OF_MOVING = ("axis", "limit", "dynamics", "mimic", "safety_controller", "calibration")


def parse_urdf(text: str, where: str) -> ET.Element:
    """The `<robot>` element of a URDF text.

    Raises:
        RobotError: It is none, or can't be right.
    """
    root = read_xml(text, where, "give a URDF file", RobotError)
    if root.tag != "robot":
        what = f"the root element is <{root.tag}>, not <robot>"
        raise RobotError(where, what, "give a URDF file (expand xacro)")
    check_urdf(root, where)
    return root


def lock_beside(text: str, tip: str, where: str) -> tuple[str, dict[str, float]]:
    """A URDF with every joint locked at zero that is not on the way from the base to one joint.

    Args:
        text: The URDF.
        tip: Name of that joint.
        where: What errors name.

    Returns:
        The URDF, and the joints that were locked, with their positions [rad or m].

    Raises:
        RobotError: It has no such joint.
    """
    root = parse_urdf(text, where)
    joints = {name_of(joint): joint for joint in moving_joints(root)}
    if tip not in joints:
        near = difflib.get_close_matches(tip, joints, n=3) or joints
        raise _no_joint(where, tip, near)
    on_the_way = joints_to_base(root, joints[tip])
    beside = {name: 0.0 for name in joints if name not in on_the_way}
    lock_joints(root, beside)
    return ET.tostring(root, encoding="unicode"), beside


def lock_joints(root: ET.Element, positions: Mapping[str, float]) -> None:
    """Turns joints into fixed ones at the given positions [rad or m], in place.

    Done in the URDF, not with Pinocchio's `buildReducedModel`, so that every later reader of the
    text (Pinocchio, Coal, MuJoCo) sees the same arm.
    """
    for joint in moving_joints(root):
        if name_of(joint) in positions:
            _lock_joint(joint, positions[name_of(joint)])


def _lock_joint(joint: ET.Element, position: float) -> None:
    """Turns a joint into a fixed one at a position [rad or m], in place."""
    origin = joint.find("origin")
    if origin is None:
        origin = ET.SubElement(joint, "origin")
    xyz = read_vector(origin, "xyz")
    rotation = rpy_to_matrix(read_vector(origin, "rpy"))
    axis = read_vector(joint.find("axis"), "xyz", "1 0 0")
    if joint.get("type") == "prismatic":
        xyz = xyz + rotation @ (axis / np.linalg.norm(axis)) * position
    else:
        rotation = rotation @ rotation_about(axis, position)
    origin.set("xyz", _in_full(xyz))
    origin.set("rpy", _in_full(matrix_to_rpy(rotation)))
    joint.set("type", "fixed")
    for tag in OF_MOVING:
        for element in joint.findall(tag):
            joint.remove(element)


def _in_full(values: Iterable[float]) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(value)) for value in values)


def normalise_urdf(
    text: str, where: str, locked: Mapping[str, float]
) -> tuple[str, dict[str, float]]:
    """Locks joints and makes continuous joints revolute without limits, so that nq = nv = n.

    Args:
        text: The URDF.
        where: What errors name.
        locked: Joints to be locked, with their positions [rad or m].

    Returns:
        The URDF, and the joints that are locked in it: those given, and a gripper's at zero [rad or
            m].

    Raises:
        RobotError: It is no URDF, or has no such joint.
    """
    root = parse_urdf(text, where)
    names = [name_of(joint) for joint in moving_joints(root)]
    for name in locked:
        if name not in names:
            raise _no_joint(where, name, names)
    gripper = dict.fromkeys(gripper_joints(root), 0.0)
    fixed = _with_followers(root, {**gripper, **locked})
    lock_joints(root, fixed)
    for joint in moving_joints(root):
        if joint.get("type") == "continuous":
            _make_revolute(joint)
    return ET.tostring(root, encoding="unicode"), fixed


def _make_revolute(joint: ET.Element) -> None:
    """A continuous joint as a revolute one that never reaches its limits, in place."""
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = ET.SubElement(joint, "limit", effort="1e6", velocity="1e3")
    limit.set("lower", "-1e9")
    limit.set("upper", "1e9")


def _with_followers(root: ET.Element, fixed: Mapping[str, float]) -> dict[str, float]:
    """Fixed joints [rad or m], with those that follow one of them (`<mimic>`)."""
    positions = dict(fixed)
    leaders = followers(root)
    for _ in leaders:  # one may follow another that follows
        for name, mimic in leaders.items():
            leader = mimic.get("joint", "")
            if name not in positions and leader in positions:
                numbers = [
                    float(mimic.get(key, default)) for key, default in OPTIONAL["mimic"].items()
                ]
                multiplier, offset = numbers
                positions[name] = float(multiplier * positions[leader] + offset)
    return positions


def _no_joint(where: str, name: str, known: Iterable[str]) -> RobotError:
    """There is no joint of that name."""
    remedy = f"its joints are: {', '.join(known)}"
    return RobotError(where, f"no moving joint {name!r}", remedy)
