"""Ten inertial numbers of a link: in another frame, about its centre of mass, and in URDF text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.robot.rotations import rpy_to_matrix
from ident.robot.urdf_elements import MOMENTS, read_vector

ENTRIES = ((0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2))
# Share of a body's own size below which a number is the same: more digits than recordings know.
SAME = 1e-7
# What an <inertial> says, by tags and their attributes.
Inertial = dict[str, dict[str, Array]]


def numbers(values: Sequence[float] | Array) -> str:
    """Numbers of an attribute, to the last digit."""
    return " ".join(repr(float(value)) for value in values)


def moved(
    link: Float[Array, " 10"], turn: Float[Array, "3 3"], shift: Float[Array, " 3"]
) -> Float[Array, " 10"]:
    """Ten inertial numbers in another frame: the old one stands at `shift`, turned by `turn`."""
    mass = link[0]
    first = turn @ link[1:4]
    second = turn @ _matrix(link) @ turn.T
    for left, right in ((shift, first), (first, shift), (shift, mass * shift)):
        second = second + (left @ right) * np.eye(3) - np.outer(left, right)
    return np.concatenate([[mass], first + mass * shift, second[ENTRIES]])


def _matrix(link: Float[Array, " 10"]) -> Float[Array, "3 3"]:
    """Second moments of ten inertial numbers."""
    xx, xy, yy, xz, yz, zz = link[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def about_centre(
    link: Float[Array, " 10"],
) -> tuple[float, Float[Array, " 3"], Float[Array, "3 3"]]:
    """Mass, centre of mass, and inertia about it, of ten inertial numbers about a frame."""
    mass = float(link[0])
    centre = link[1:4] / mass if mass > 0.0 else np.zeros(3)
    of_point = mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return mass, centre, _matrix(link) - of_point


def ball_of(mass: float, centre: Float[Array, " 3"], radius: float) -> Float[Array, " 10"]:
    """Ten numbers of a ball with a radius of gyration [m]."""
    square = mass * radius**2
    ball = np.array([mass, 0.0, 0.0, 0.0, square, 0.0, square, 0.0, 0.0, square])
    return moved(ball, np.eye(3), centre)


def child(element: ET.Element, tag: str) -> ET.Element:
    """A child of an element, made if it is not there."""
    present = element.find(tag)
    return ET.SubElement(element, tag) if present is None else present


def read_inertial(link: ET.Element) -> Float[Array, " 10"]:
    """Ten numbers about the frame of a URDF's link; zero where it has no inertia."""
    origin = link.find("inertial/origin")
    mass = link.find("inertial/mass")
    inertia = link.find("inertial/inertia")
    if mass is None or inertia is None:
        return np.zeros(10)
    about_origin = np.zeros(10)
    about_origin[0] = float(mass.get("value", "0"))
    about_origin[4:] = [float(inertia.get(key, "0")) for key in MOMENTS]
    turn = rpy_to_matrix(read_vector(origin, "rpy"))
    return moved(about_origin, turn, read_vector(origin, "xyz"))


def inertial_of(about_frame: Float[Array, " 10"], turn: Float[Array, "3 3"]) -> Inertial:
    """What a URDF's <inertial> says of a body.

    Args:
        about_frame: Its ten numbers about its link's frame.
        turn: How the <origin> turns the axes of <inertia>.
    """
    mass, centre, about = about_centre(about_frame)
    moments = (turn.T @ about @ turn)[ENTRIES]
    each = {key: moments[k : k + 1] for k, key in enumerate(MOMENTS)}
    return {"origin": {"xyz": centre}, "mass": {"value": np.array([mass])}, "inertia": each}


def new_numbers(
    stated: Mapping[str, Mapping[str, str]], about_frame: Float[Array, " 10"]
) -> Inertial:
    """Of an <inertial>'s numbers those that it does not state already.

    Args:
        stated: Attributes that are there, by the tags of their elements.
        about_frame: Ten numbers about the link's frame.
    """
    rpy = stated.get("origin", {}).get("rpy", "0 0 0")
    turn = rpy_to_matrix(np.array(rpy.split(), dtype=float))
    wanted = inertial_of(about_frame, turn)
    mass = float(wanted["mass"]["value"][0])
    moment = max(float(abs(value[0])) for value in wanted["inertia"].values())
    length = float(np.sqrt(moment / mass)) if mass > 0.0 else 0.0
    sizes = {"origin": length, "mass": mass, "inertia": moment}
    new: Inertial = {}
    for tag, attributes in wanted.items():
        there = stated.get(tag, {})
        for key, values in attributes.items():
            if not is_stated(there.get(key), values, sizes[tag]):
                new.setdefault(tag, {})[key] = values
    return new


def is_stated(text: str | None, values: Sequence[float] | Array, size: float = 0.0) -> bool:
    """Whether an attribute's text says such numbers already.

    Args:
        text: The text; None where there is none.
        values: The numbers.
        size: What they are measured by, where they may be small beside it.
    """
    try:
        stated = np.array((text or "").split(), dtype=float)
    except ValueError:
        return False
    wanted = np.asarray(values, dtype=float)
    if stated.shape != wanted.shape:
        return False
    scale = max(size, float(np.abs(wanted).max(initial=0.0)))
    return bool((np.abs(stated - wanted) <= SAME * scale).all())


def set_inertial(link: ET.Element, about_frame: Float[Array, " 10"]) -> None:
    """Gives a URDF's link ten numbers about its frame; those that it states already stay."""
    inertial = child(link, "inertial")
    parts = {tag: child(inertial, tag) for tag in ("origin", "mass", "inertia")}
    stated = {tag: element.attrib for tag, element in parts.items()}
    for tag, attributes in new_numbers(stated, about_frame).items():
        for key, values in attributes.items():
            parts[tag].set(key, numbers(values))
    if "rpy" not in parts["origin"].attrib:
        parts["origin"].set("rpy", "0 0 0")
