"""What a URDF must say before the parsers see it.

Their own complaints go to the terminal, name no file, or never come: a mass that is no number becomes no mass.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections import Counter

import numpy as np

from ident.errors import RobotError

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# Arms on humanoids with all their sensors have some two hundred; a chain of more is deeper than parsers can follow.
MOST_JOINTS = 500
# Humanoids with both hands have some eighty that move; the room that dynamics need grows with the cube of them.
MOST_MOVING = 150
SHAPES = {"box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1}, "mesh": {"scale": 3}}
MOMENTS = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def check_urdf(root: ET.Element, where: str) -> None:
    """Raises RobotError for a URDF whose tree, numbers or limits can't be right.

    Args:
        root: The `<robot>` element.
        where: The file, for the message.
    """
    if not root.get("name"):
        raise RobotError(where, "<robot> has no name", 'add name="…"')
    count = len(root.findall("joint"))
    if count > MOST_JOINTS:
        raise RobotError(where, f"it has {count} joints, fixed ones counted", "give the URDF of one arm")
    moving = sum(joint.get("type") != "fixed" for joint in root.findall("joint"))
    if moving > MOST_MOVING:
        raise RobotError(where, f"it has {moving} joints that move", "give the URDF of one arm")
    for kind in ("link", "joint"):
        counts = Counter(element.get("name") or "" for element in root.findall(kind))
        if "" in counts:
            raise RobotError(where, f"a <{kind}> has no name", 'add name="…"')
        twice = next((name for name, count in counts.items() if count > 1), None)
        if twice is not None:
            raise RobotError(where, f"two {kind}s are named {twice!r}", "rename one")
    for link in root.findall("link"):
        _check_inertial(link, where)
        _check_shapes(link, where)
    for joint in root.findall("joint"):
        _check_joint(joint, where)
    for element in root.findall("transmission/actuator/mechanicalReduction"):
        try:
            usable = np.isfinite(float(element.text or "")) and float(element.text or "") != 0.0
        except ValueError:
            usable = False
        if not usable:
            raise RobotError(where, f"a <mechanicalReduction> is {element.text!r}", "give a number other than zero")
    _check_tree(root, where)


def _numbers(element: ET.Element | None, key: str, default: str, count: int, place: str, where: str) -> np.ndarray:
    """The finite numbers of an attribute."""
    text = default if element is None else element.get(key, default)
    try:
        values = np.array([float(part) for part in text.split()])
    except ValueError:
        values = np.array([])
    if len(values) != count or not np.all(np.isfinite(values)):
        wanted = "a number" if count == 1 else f"{count} numbers"
        raise RobotError(where, f"{place} is {text!r}", f"give {wanted}")
    return values


def _check_inertial(link: ET.Element, where: str) -> None:
    inertial, name = link.find("inertial"), f"link {link.get('name')!r}"
    if inertial is None:
        return
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise RobotError(where, f"{name}: <inertial> lacks <mass> or <inertia>", "add it")
    if _numbers(mass, "value", "", 1, f"{name}: mass", where)[0] < 0:
        raise RobotError(where, f"{name}: mass is {mass.get('value')}", "give a mass of zero or more")
    for key in MOMENTS:
        _numbers(inertia, key, "", 1, f"{name}: {key}", where)
    for key in ("xyz", "rpy"):
        _numbers(origin, key, "0 0 0", 3, f"{name}: origin {key} of <inertial>", where)


def _check_shapes(link: ET.Element, where: str) -> None:
    """Where shapes are, and how large."""
    for kind in ("visual", "collision"):
        for element in link.findall(kind):
            name = f"link {link.get('name')!r}: {kind}"
            for key in ("xyz", "rpy"):
                _numbers(element.find("origin"), key, "0 0 0", 3, f"{name}: origin {key}", where)
            for shape, lengths in SHAPES.items():
                for key, count in lengths.items():
                    if (found := element.find(f"geometry/{shape}")) is not None:
                        default = "1 1 1" if shape == "mesh" else ""
                        _numbers(found, key, default, count, f"{name}: {shape} {key}", where)


def _check_joint(joint: ET.Element, where: str) -> None:
    name, kind = f"joint {joint.get('name')!r}", joint.get("type")
    if kind not in JOINT_TYPES:
        raise RobotError(where, f"{name}: type is {kind!r}", f"use one of: {', '.join(JOINT_TYPES)}")
    for key in ("xyz", "rpy"):
        _numbers(joint.find("origin"), key, "0 0 0", 3, f"{name}: origin {key}", where)
    if kind in ("fixed", "floating"):
        return
    if not np.any(_numbers(joint.find("axis"), "xyz", "1 0 0", 3, f"{name}: axis", where)):
        raise RobotError(where, f"{name}: axis is zero", "give a direction")
    limit = joint.find("limit")
    if limit is None and kind in ("revolute", "prismatic"):
        raise RobotError(where, f"{name} has no <limit>", "add one, or make a revolute joint continuous")
    if limit is None:
        return
    lower, upper = (_numbers(limit, key, "0", 1, f"{name}: limit {key}", where)[0] for key in ("lower", "upper"))
    for key in ("effort", "velocity"):
        _numbers(limit, key, "", 1, f"{name}: limit {key}", where)
    if lower > upper:
        raise RobotError(where, f"{name}: lower limit {lower:g} is above upper limit {upper:g}", "swap them")


def _check_tree(root: ET.Element, where: str) -> None:
    """Every joint joins two links that exist, no link has two parents, and there is one base."""
    links = [link.get("name") for link in root.findall("link")]
    children: set[str] = set()
    for joint in root.findall("joint"):
        for tag in ("parent", "child"):
            end = joint.find(tag)
            link = None if end is None else end.get("link")
            if not link:
                raise RobotError(where, f"joint {joint.get('name')!r} names no {tag} link", f"add <{tag} link=…/>")
            if link not in links:
                what = f"joint {joint.get('name')!r}: there is no {tag} link {link!r}"
                raise RobotError(where, what, "add the link, or correct the name")
            if tag == "child" and link in children:
                raise RobotError(where, f"link {link!r} hangs from two joints", "an arm has no loops: remove one")
            if tag == "child":
                children.add(link)
    bases = [link for link in links if link not in children]
    if len(bases) != 1:
        what = f"it has {len(bases)} base links" + (f" ({', '.join(map(str, bases[:4]))})" if bases else "")
        raise RobotError(where, what, "join all links to one base")
