"""What a URDF's elements say, read from its tree."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from contextlib import suppress
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float

if TYPE_CHECKING:
    from ident.robot.arm import ArmModel

VISCOUS = "viscous_Nms_rad"
COULOMB = "coulomb_Nm"
# Attributes of <dynamics>, by what they are called in results.
STATED = {VISCOUS: "damping", COULOMB: "friction"}
# Attributes of <inertia>.
MOMENTS = ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
# Types of joints that move about, or along, one axis.
MOVING = ("revolute", "continuous", "prismatic")


def name_of(element: ET.Element) -> str:
    """An element's name; empty where it has none."""
    return element.get("name", "")


def link_of(joint: ET.Element, end: str) -> str:
    """Name of a joint's link, at its end `parent` or `child`.

    Empty where there is none, which `parse_urdf` refuses.
    """
    element = joint.find(end)
    return "" if element is None else element.get("link", "")


def read_vector(element: ET.Element | None, key: str, default: str = "0 0 0") -> Float[Array, " k"]:
    """The numbers of an attribute.

    Args:
        element: The element; None stands for one that is left out.
        key: The attribute's name.
        default: Text that stands for an attribute that is left out.

    Raises:
        ValueError: One of them is no number.
    """
    text = default if element is None else element.get(key, default)
    return np.array([float(number) for number in text.split()])


def is_moving(joint: ET.Element) -> bool:
    """Whether a joint has a degree of freedom."""
    return joint.get("type") in MOVING


def moving_joints(root: ET.Element) -> list[ET.Element]:
    """Joint elements with a degree of freedom, in document order."""
    return [joint for joint in root.findall("joint") if is_moving(joint)]


def children_of_links(root: ET.Element) -> dict[str, list[ET.Element]]:
    """Joints that hang from each link, by the link's name, in document order.

    A link without joints has no entry.
    """
    children: dict[str, list[ET.Element]] = {}
    for joint in root.findall("joint"):
        children.setdefault(link_of(joint, "parent"), []).append(joint)
    return children


def followers(root: ET.Element) -> dict[str, ET.Element]:
    """Joints that move with another one, and their `<mimic>`."""
    mimics = {}
    for joint in moving_joints(root):
        mimic = joint.find("mimic")
        if mimic is not None:
            mimics[name_of(joint)] = mimic
    return mimics


def read_reductions(text: str) -> dict[str, float]:
    """Gear ratio of each joint that a URDF's `<transmission>` elements name.

    What is no ratio is not known.
    """
    ratios = {}
    for transmission in ET.fromstring(text).findall("transmission"):
        joint = transmission.find("joint")
        reduction = transmission.findtext("actuator/mechanicalReduction", "")
        if joint is None:
            continue
        with suppress(ValueError):
            ratio = abs(float(reduction))
            if np.isfinite(ratio) and ratio > 0.0:
                ratios[name_of(joint)] = ratio
    return ratios


def stated_friction(arm: ArmModel) -> dict[str, dict[str, float]]:
    """What the URDF's `<dynamics>` say of each joint, empty where they say nothing.

    Returns:
        By joint: `viscous_Nms_rad` and `coulomb_Nm`, each where it is stated.
    """
    stated: dict[str, dict[str, float]] = {joint: {} for joint in arm.joint_names}
    for element in ET.fromstring(arm.urdf).iter("joint"):
        dynamics = element.find("dynamics")
        name = element.get("name", "")
        if dynamics is None or name not in stated:
            continue
        for key, attribute in STATED.items():
            if dynamics.get(attribute) is not None:
                stated[name][key] = float(dynamics.get(attribute, "nan"))
    return stated
