"""A URDF brought into the one form that the rest works on: a chain of one-axis joints.

It is checked here: parsers' complaints go to the terminal, name no file, or never come.
"""

from __future__ import annotations

import difflib
import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Mapping
from contextlib import suppress

import numpy as np

from ident.errors import RobotError
from ident.safe_read import read_xml

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")
# Arms on humanoids with all their sensors have some two hundred; a chain of more is deeper than
# parsers can follow.
MOST_JOINTS = 500
# Humanoids with both hands have some eighty that move; the room that dynamics need grows with the
# cube of them.
MOST_MOVING = 150
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
MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
MOVING = ("revolute", "continuous", "prismatic")
# A branch with more joints than a finger has is another arm.
MOST_FINGER_JOINTS = 4


def check_urdf(root: ET.Element, where: str) -> None:
    """Raises RobotError for a URDF whose tree, numbers or limits can't be right."""
    _require(root.get("name"), where, "<robot> has no name", 'add name="…"')
    joints = root.findall("joint")
    moving = sum(joint.get("type") != "fixed" for joint in joints)
    one_arm = "give the URDF of one arm"
    _require(
        len(joints) <= MOST_JOINTS,
        where,
        f"it has {len(joints)} joints, fixed ones counted",
        one_arm,
    )
    _require(moving <= MOST_MOVING, where, f"it has {moving} joints that move", one_arm)
    for kind in ("link", "joint"):
        counts = Counter(element.get("name") or "" for element in root.findall(kind))
        _require("" not in counts, where, f"a <{kind}> has no name", 'add name="…"')
        for name, count in counts.items():
            _require(count == 1, where, f"two {kind}s are named {name!r}", "rename one")
    for link in root.findall("link"):
        _check_inertial(link, where)
        _check_shapes(link, where)
    for joint in joints:
        _check_joint(joint, where)
    _check_tree(root, where)


def _require(fine: object, where: str, what: str, remedy: str) -> None:
    if not fine:
        raise RobotError(where, what, remedy)


def _numbers(
    element: ET.Element | None, key: str, default: str, count: int, place: str, where: str
) -> np.ndarray:
    """The finite numbers of an attribute, which is then written as every parser reads it.

    Blanks around a number are taken away: the parsers' own check of `2.443 ` fails, and the link
    weighs nothing. Digits of other alphabets, `2_443` and hexadecimals are refused.
    """
    text = default if element is None else element.get(key, default)
    words = text.split()
    plain = len(words) == count and all(PLAIN_NUMBER.fullmatch(word) for word in words)
    values = np.array([float(word) for word in words]) if plain else np.array([np.nan])
    fine = np.all(np.isfinite(values))
    _require(
        fine,
        where,
        f"{place} is {text!r}",
        "give a number" if count == 1 else f"give {count} numbers",
    )
    if element is not None and key in element.attrib:
        element.set(key, " ".join(words))
    return values


def _check_inertial(link: ET.Element, where: str) -> None:
    inertial = link.find("inertial")
    name = f"link {link.get('name')!r}"
    if inertial is None:
        return
    mass, inertia, origin = (inertial.find(tag) for tag in ("mass", "inertia", "origin"))
    if mass is None or inertia is None:
        raise RobotError(where, f"{name}: <inertial> lacks <mass> or <inertia>", "add it")
    weight = _numbers(mass, "value", "", 1, f"{name}: mass", where)[0]
    _require(
        weight >= 0, where, f"{name}: mass is {mass.get('value')}", "give a mass of zero or more"
    )
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
                    if (form := element.find(f"geometry/{shape}")) is not None:
                        default = "1 1 1" if shape == "mesh" else ""
                        _numbers(form, key, default, count, f"{name}: {shape} {key}", where)


def _check_joint(joint: ET.Element, where: str) -> None:
    name = f"joint {joint.get('name')!r}"
    kind = joint.get("type")
    _require(
        kind in JOINT_TYPES,
        where,
        f"{name}: type is {kind!r}",
        f"use one of: {', '.join(JOINT_TYPES)}",
    )
    for key in ("xyz", "rpy"):
        _numbers(joint.find("origin"), key, "0 0 0", 3, f"{name}: origin {key}", where)
    for tag, keys in OPTIONAL.items():
        if (element := joint.find(tag)) is not None:
            for key, default in keys.items():
                _numbers(element, key, default, 1, f"{name}: {tag} {key}", where)
    if kind in ("fixed", "floating"):
        return
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0", 3, f"{name}: axis", where)
    limit = joint.find("limit")
    _require(np.any(axis), where, f"{name}: axis is zero", "give a direction")
    if limit is None:
        bounded = kind in ("revolute", "prismatic")
        _require(
            not bounded,
            where,
            f"{name} has no <limit>",
            "add one, or make a revolute joint continuous",
        )
        return
    lower, upper = (
        _numbers(limit, key, "0", 1, f"{name}: limit {key}", where)[0] for key in ("lower", "upper")
    )
    for key in ("effort", "velocity"):
        _numbers(limit, key, "", 1, f"{name}: limit {key}", where)
    _require(
        lower <= upper,
        where,
        f"{name}: lower limit {lower:g} is above upper limit {upper:g}",
        "swap them",
    )


def _check_tree(root: ET.Element, where: str) -> None:
    """Every joint joins two links that exist, no link has two parents, and there is one base."""
    links = [link.get("name") for link in root.findall("link")]
    children: set[str] = set()
    for joint in root.findall("joint"):
        for tag in ("parent", "child"):
            link = link_of(joint, tag)
            name = f"joint {joint.get('name')!r}"
            _require(link, where, f"{name} names no {tag} link", f"add <{tag} link=…/>")
            known = link in links
            _require(
                known,
                where,
                f"{name}: there is no {tag} link {link!r}",
                "add the link, or correct the name",
            )
        _require(
            link not in children,
            where,
            f"link {link!r} hangs from two joints",
            "an arm has no loops: remove one",
        )
        children.add(link)
    bases = [link for link in links if link not in children]
    what = f"it has {len(bases)} base links" + (
        f" ({', '.join(map(str, bases[:4]))})" if bases else ""
    )
    _require(len(bases) == 1, where, what, "join all links to one base")
    reached = _below(root, bases[0])
    lost = next((link for link in links if link not in reached), None)
    _require(
        lost is None,
        where,
        f"link {lost!r} hangs from itself",
        "an arm has no loops: correct a parent",
    )


def _below(root: ET.Element, base: str | None) -> set[str | None]:
    """A link and all that hang from it."""
    children: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        children.setdefault(link_of(joint, "parent"), []).append(link_of(joint, "child"))
    reached: set[str | None] = {base}
    waiting = [base]
    while waiting:
        link = waiting.pop()
        for child in children.get(link or "", []):
            if child not in reached:
                reached.add(child)
                waiting.append(child)
    return reached


def parse_urdf(text: str, where: str) -> ET.Element:
    """The `<robot>` element of a URDF text."""
    root = read_xml(text, where, "give a URDF file", RobotError)
    what = f"the root element is <{root.tag}>, not <robot>"
    _require(root.tag == "robot", where, what, "give a URDF file (expand xacro)")
    check_urdf(root, where)
    return root


def moving_joints(root: ET.Element) -> list[ET.Element]:
    """Joint elements with a degree of freedom, in document order."""
    return [joint for joint in root.findall("joint") if joint.get("type") in MOVING]


def gripper_joints(root: ET.Element) -> list[str]:
    """Names of the joints beside and beyond the arm: fingers, a head, wheels, by which it is no
    longer a chain.

    At a fork the arm goes on in the branch that is as long as an arm (more than
    `MOST_FINGER_JOINTS` joints one after the other). Where no branch is, or the joints before the
    fork are an arm already, they are fingers. Empty where which branch is the arm can't be known:
    several are long enough, or none is and they begin at the base.
    """
    children: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        children.setdefault(link_of(joint, "parent"), []).append(joint)

    def moves(joint: ET.Element) -> bool:
        return joint.get("type") in MOVING

    def below(joint: ET.Element) -> list[str]:
        names = []
        coming = [joint]
        while coming:
            element = coming.pop()
            names += [element.get("name") or ""] if moves(element) else []
            coming += reversed(children.get(link_of(element, "child"), []))
        return names

    def length(joint: ET.Element) -> int:
        longest = 0
        coming = [(joint, 0)]
        while coming:
            element, so_far = coming.pop()
            so_far += moves(element)
            longest = max(longest, so_far)
            coming += [(child, so_far) for child in children.get(link_of(element, "child"), [])]
        return longest

    child_links = {link_of(joint, "child") for joint in root.findall("joint")}
    link = next(
        (item.get("name") for item in root.findall("link") if item.get("name") not in child_links),
        None,
    )
    beside: list[str] = []
    arm_joints = 0
    while link is not None:
        alive = [joint for joint in children.get(link, []) if below(joint)]
        long = [joint for joint in alive if length(joint) > MOST_FINGER_JOINTS]
        hand = bool(arm_joints) and (not long or arm_joints > MOST_FINGER_JOINTS)
        if len(alive) > 1 and hand:
            return [*beside, *(name for joint in alive for name in below(joint))]
        if len(alive) > 1 and len(long) != 1:
            return []
        onward = long if len(alive) > 1 else alive
        beside += [name for joint in alive if joint not in onward for name in below(joint)]
        arm_joints += bool(onward) and moves(onward[0])
        link = link_of(onward[0], "child") if onward else None
    return beside


def lock_beside(text: str, tip: str, where: str) -> tuple[str, dict[str, float]]:
    """A URDF with every joint locked at zero that is not on the way from the base to one joint, and
    these joints.

    Returns:
        The URDF, and the joints that were locked, with their positions [rad or m].

    Raises:
        RobotError: It has no such joint.
    """
    root = parse_urdf(text, where)
    names = [joint.get("name") or "" for joint in moving_joints(root)]
    if tip not in names:
        near = difflib.get_close_matches(tip, names, n=3) or names
        raise RobotError(where, f"no moving joint {tip!r}", f"its joints are: {', '.join(near)}")
    on_the_way = set(
        _way(root, next(element for element in moving_joints(root) if element.get("name") == tip))
    )
    beside = {name: 0.0 for name in names if name not in on_the_way}
    lock_joints(root, beside)
    return ET.tostring(root, encoding="unicode"), beside


def arm_tips(text: str) -> list[str]:
    """The last joint of each arm of a robot of several, longest first; fingers at an arm's end are
    none of it.
    """
    root = ET.fromstring(text)
    chains = [_way(root, joint) for joint in moving_joints(root)]
    branches = Counter(names[1] for names in chains if len(names) > 1)

    def without_fingers(names: list[str]) -> list[str]:
        start = 0
        for k, name in enumerate(names[1:], start=1):
            if branches[name] > 1 and k - start <= MOST_FINGER_JOINTS < len(names) - k:
                start = k
        return names[start:]

    arms = [without_fingers(names) for names in chains if names[0] not in branches]
    return list(dict.fromkeys(names[0] for names in sorted(arms, key=len, reverse=True)))


def _way(root: ET.Element, joint: ET.Element) -> list[str]:
    """Names of the moving joints from one of them back to the base."""
    above = {link_of(element, "child"): element for element in root.findall("joint")}
    names: list[str] = []
    current: ET.Element | None = joint
    while current is not None:
        names += [current.get("name") or ""] if current.get("type") in MOVING else []
        current = above.get(link_of(current, "parent"))
    return names


def link_of(joint: ET.Element, end: str) -> str:
    """Name of a joint's parent or child link; empty where there is none, which `parse_urdf`
    refuses.
    """
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def rotation_about(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation matrix by Rodrigues' formula, shape (3, 3)."""
    x, y, z = axis / np.linalg.norm(axis)
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return np.asarray(turn)


def rpy_to_matrix(rpy: np.ndarray) -> np.ndarray:
    """Rotation of URDF's fixed-axis roll, pitch and yaw [rad]."""
    unit = np.eye(3)
    roll = rotation_about(unit[0], rpy[0])
    pitch = rotation_about(unit[1], rpy[1])
    yaw = rotation_about(unit[2], rpy[2])
    return np.asarray(yaw @ pitch @ roll)


def matrix_to_rpy(rotation: np.ndarray) -> np.ndarray:
    """Inverse of `rpy_to_matrix` [rad]."""
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    if np.hypot(rotation[0, 0], rotation[1, 0]) < 1e-12:  # gimbal lock: yaw is free, set to zero
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def read_vector(element: ET.Element | None, key: str, default: str = "0 0 0") -> np.ndarray:
    text = default if element is None else element.get(key, default)
    return np.array([float(number) for number in text.split()])


def lock_joints(root: ET.Element, positions: Mapping[str, float]) -> None:
    """Turns joints into fixed ones at the given positions [rad or m], in place.

    Done in the URDF, not with Pinocchio's `buildReducedModel`, so that every later reader of the
    text (Pinocchio, Coal, MuJoCo) sees the same arm.
    """
    for joint in moving_joints(root):
        name = joint.get("name") or ""
        if name not in positions:
            continue
        origin = joint.find("origin")
        if origin is None:
            origin = ET.SubElement(joint, "origin")
        xyz = read_vector(origin, "xyz")
        rotation = rpy_to_matrix(read_vector(origin, "rpy"))
        axis = read_vector(joint.find("axis"), "xyz", "1 0 0")
        if joint.get("type") == "prismatic":
            xyz = xyz + rotation @ (axis / np.linalg.norm(axis)) * positions[name]
        else:
            rotation = rotation @ rotation_about(axis, positions[name])
        origin.set("xyz", " ".join(repr(float(value)) for value in xyz))
        origin.set("rpy", " ".join(repr(float(value)) for value in matrix_to_rpy(rotation)))
        joint.set("type", "fixed")
        for tag in ("axis", "limit", "dynamics", "mimic", "safety_controller", "calibration"):
            for element in joint.findall(tag):
                joint.remove(element)


def normalise_urdf(
    text: str, where: str, locked: Mapping[str, float]
) -> tuple[str, dict[str, float]]:
    """Locks joints and makes continuous joints revolute without limits, so that nq = nv = n.

    Returns:
        The URDF, and the joints that are locked in it: those given, and a gripper's at zero [rad or
            m].
    """
    root = parse_urdf(text, where)
    names = [joint.get("name") or "" for joint in moving_joints(root)]
    unknown = [name for name in locked if name not in names]
    if unknown:
        raise RobotError(
            where, f"no moving joint {unknown[0]!r}", f"its joints are: {', '.join(names)}"
        )
    fixed = _with_followers(root, {**dict.fromkeys(gripper_joints(root), 0.0), **locked}, where)
    lock_joints(root, fixed)
    for joint in moving_joints(root):
        if joint.get("type") == "continuous":
            joint.set("type", "revolute")
            limit = joint.find("limit")
            if limit is None:
                limit = ET.SubElement(joint, "limit", effort="1e6", velocity="1e3")
            limit.set("lower", "-1e9")
            limit.set("upper", "1e9")
    return ET.tostring(root, encoding="unicode"), fixed


def _with_followers(root: ET.Element, fixed: Mapping[str, float], where: str) -> dict[str, float]:
    """Fixed joints, with those that follow one of them (`<mimic>`), at the positions where it holds
    them [rad or m].
    """
    values = dict(fixed)
    leaders = followers(root)
    for _ in leaders:  # one may follow another that follows
        for name, mimic in leaders.items():
            if name not in values and (leader := mimic.get("joint", "")) in values:
                size, offset = (
                    float(mimic.get(key, default)) for key, default in OPTIONAL["mimic"].items()
                )
                values[name] = float(size * values[leader] + offset)
    return values


def followers(root: ET.Element) -> dict[str, ET.Element]:
    """Joints that move with another one, and their `<mimic>`."""
    pairs = ((joint.get("name") or "", joint.find("mimic")) for joint in moving_joints(root))
    return {name: mimic for name, mimic in pairs if mimic is not None}


def read_reductions(text: str) -> dict[str, float]:
    """Gear ratio of each joint that a URDF's `<transmission>` elements name; what is no ratio is
    not known.
    """
    ratios = {}
    for transmission in ET.fromstring(text).findall("transmission"):
        joint = transmission.find("joint")
        reduction = transmission.findtext("actuator/mechanicalReduction", "")
        with suppress(ValueError):
            if joint is not None and np.isfinite(ratio := abs(float(reduction))) and ratio > 0.0:
                ratios[joint.get("name", "")] = ratio
    return ratios
