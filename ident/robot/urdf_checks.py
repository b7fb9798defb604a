"""Checks of a URDF's tree, numbers and limits.

They are made here: parsers' complaints go to the terminal, name no file, or never come.
"""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter

import numpy as np

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.robot.urdf_elements import MOMENTS, children_of_links, link_of

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# Arms on humanoids with all their sensors have some two hundred; a chain of more is deeper than
# parsers can follow.
MOST_JOINTS = 500
# Humanoids with both hands have some eighty that move; the room that dynamics need grows with the
# cube of them.
MOST_MOVING = 150
# Lengths of a shape, and how many numbers each has.
SHAPES = {
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
}
# Numbers of a joint that may be left out, and what they are then.
OPTIONAL = {
    "dynamics": {"damping": "0", "friction": "0"},
    "mimic": {"multiplier": "1", "offset": "0"},
    "calibration": {"rising": "0", "falling": "0"},
    "safety_controller": {
        "soft_lower_limit": "0",
        "soft_upper_limit": "0",
        "k_position": "0",
        "k_velocity": "0",
    },
}
# As every parser of URDFs reads it.
PLAIN_NUMBER = re.compile(r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
# Of several base links so many are named.
MOST_NAMED = 4


def check_urdf(root: ET.Element, where: str) -> None:
    """Raises RobotError for a URDF whose tree, numbers or limits can't be right.

    Args:
        root: Its `<robot>`, whose numbers are written as every parser reads them.
        where: What the errors name.
    """
    _require(root.get("name"), where, "<robot> has no name", 'add name="…"')
    _check_size(root, where)
    for kind in ("link", "joint"):
        _check_names(root, kind, where)
    for link in root.findall("link"):
        _check_inertial(link, where)
        _check_shapes(link, where)
    for joint in root.findall("joint"):
        _check_joint(joint, where)
    _check_tree(root, where)


def _require(fine: object, where: str, what: str, remedy: str) -> None:
    if not fine:
        raise RobotError(where, what, remedy)


def _check_size(root: ET.Element, where: str) -> None:
    joints = root.findall("joint")
    moving = sum(joint.get("type") != "fixed" for joint in joints)
    remedy = "give the URDF of one arm"
    what = f"it has {len(joints)} joints, fixed ones counted"
    _require(len(joints) <= MOST_JOINTS, where, what, remedy)
    _require(moving <= MOST_MOVING, where, f"it has {moving} joints that move", remedy)


def _check_names(root: ET.Element, kind: str, where: str) -> None:
    """Every link, or joint, has a name of its own."""
    counts = Counter(element.get("name") or "" for element in root.findall(kind))
    _require("" not in counts, where, f"a <{kind}> has no name", 'add name="…"')
    for name, count in counts.items():
        _require(count == 1, where, f"two {kind}s are named {name!r}", "rename one")


def _numbers(
    element: ET.Element | None, key: str, default: str, count: int, place: str, where: str
) -> Float[Array, " k"]:
    """The finite numbers of an attribute, which is then written as every parser reads it.

    Blanks around a number are taken away: the parsers' own check of `2.443 ` fails, and the link
    weighs nothing. Digits of other alphabets, `2_443` and hexadecimals are refused.
    """
    text = default if element is None else element.get(key, default)
    words = text.split()
    values = np.array([np.nan])
    if len(words) == count and all(PLAIN_NUMBER.fullmatch(word) for word in words):
        values = np.array([float(word) for word in words])
    remedy = "give a number" if count == 1 else f"give {count} numbers"
    _require(np.all(np.isfinite(values)), where, f"{place} is {text!r}", remedy)
    if element is not None and key in element.attrib:
        element.set(key, " ".join(words))
    return values


def _number(element: ET.Element | None, key: str, default: str, place: str, where: str) -> float:
    """The same of a single number."""
    return float(_numbers(element, key, default, 1, place, where)[0])


def _check_origin(element: ET.Element, place: str, behind: str, where: str) -> None:
    """Place and orientation of what an element holds."""
    origin = element.find("origin")
    for key in ("xyz", "rpy"):
        _numbers(origin, key, "0 0 0", 3, f"{place}: origin {key}{behind}", where)


def _check_inertial(link: ET.Element, where: str) -> None:
    inertial = link.find("inertial")
    name = f"link {link.get('name')!r}"
    if inertial is None:
        return
    mass = inertial.find("mass")
    inertia = inertial.find("inertia")
    if mass is None or inertia is None:
        raise RobotError(where, f"{name}: <inertial> lacks <mass> or <inertia>", "add it")
    weight = _number(mass, "value", "", f"{name}: mass", where)
    what = f"{name}: mass is {mass.get('value')}"
    _require(weight >= 0, where, what, "give a mass of zero or more")
    for key in MOMENTS:
        _number(inertia, key, "", f"{name}: {key}", where)
    _check_origin(inertial, name, " of <inertial>", where)


def _check_shapes(link: ET.Element, where: str) -> None:
    """Where shapes are, and how large."""
    for kind in ("visual", "collision"):
        for element in link.findall(kind):
            place = f"link {link.get('name')!r}: {kind}"
            _check_origin(element, place, "", where)
            for shape, lengths in SHAPES.items():
                form = element.find(f"geometry/{shape}")
                if form is None:
                    continue
                default = "1 1 1" if shape == "mesh" else ""
                for key, count in lengths.items():
                    _numbers(form, key, default, count, f"{place}: {shape} {key}", where)


def _check_joint(joint: ET.Element, where: str) -> None:
    name = f"joint {joint.get('name')!r}"
    kind = joint.get("type")
    types = ", ".join(JOINT_TYPES)
    _require(kind in JOINT_TYPES, where, f"{name}: type is {kind!r}", f"use one of: {types}")
    _check_origin(joint, name, "", where)
    for tag, keys in OPTIONAL.items():
        element = joint.find(tag)
        if element is None:
            continue
        for key, default in keys.items():
            _number(element, key, default, f"{name}: {tag} {key}", where)
    if kind in ("fixed", "floating"):
        return
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0", 3, f"{name}: axis", where)
    _require(np.any(axis), where, f"{name}: axis is zero", "give a direction")
    limit = joint.find("limit")
    if limit is not None:
        _check_limit(limit, name, where)
        return
    remedy = "add one, or make a revolute joint continuous"
    _require(kind not in ("revolute", "prismatic"), where, f"{name} has no <limit>", remedy)


def _check_limit(limit: ET.Element, name: str, where: str) -> None:
    lower = _number(limit, "lower", "0", f"{name}: limit lower", where)
    upper = _number(limit, "upper", "0", f"{name}: limit upper", where)
    for key in ("effort", "velocity"):
        _number(limit, key, "", f"{name}: limit {key}", where)
    what = f"{name}: lower limit {lower:g} is above upper limit {upper:g}"
    _require(lower <= upper, where, what, "swap them")


def _check_tree(root: ET.Element, where: str) -> None:
    """Every joint joins two links that exist, no link has two parents, and there is one base."""
    links = [link.get("name") for link in root.findall("link")]
    no_loops = "an arm has no loops"
    children: set[str] = set()
    for joint in root.findall("joint"):
        place = f"joint {joint.get('name')!r}"
        for tag in ("parent", "child"):
            link = link_of(joint, tag)
            _require(link, where, f"{place} names no {tag} link", f"add <{tag} link=…/>")
            what = f"{place}: there is no {tag} link {link!r}"
            _require(link in links, where, what, "add the link, or correct the name")
        child = link_of(joint, "child")
        what = f"link {child!r} hangs from two joints"
        _require(child not in children, where, what, f"{no_loops}: remove one")
        children.add(child)
    bases = [link for link in links if link not in children]
    what = f"it has {len(bases)} base links"
    if bases:
        what += f" ({', '.join(map(str, bases[:MOST_NAMED]))})"
    _require(len(bases) == 1, where, what, "join all links to one base")
    reached = _below(root, bases[0])
    for name in links:
        what = f"link {name!r} hangs from itself"
        _require(name in reached, where, what, f"{no_loops}: correct a parent")


def _below(root: ET.Element, base: str | None) -> set[str | None]:
    """A link and all that hang from it."""
    children = children_of_links(root)
    reached: set[str | None] = {base}
    waiting = [base]
    while waiting:
        link = waiting.pop()
        for joint in children.get(link or "", []):
            child = link_of(joint, "child")
            if child not in reached:
                reached.add(child)
                waiting.append(child)
    return reached
