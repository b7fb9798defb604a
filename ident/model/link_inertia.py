"""Ten inertial numbers of a link: in another frame, about its centre of mass, and in a URDF's text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.robot.urdf import MOMENTS, read_vector, rpy_to_matrix

ENTRIES = ((0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2))


def numbers(values: Sequence[float] | Array) -> str:
    """Numbers of an attribute, to the last digit."""
    return " ".join(repr(float(value)) for value in values)


def moved(link: Float[Array, " 10"], turn: Float[Array, "3 3"], shift: Float[Array, " 3"]) -> Float[Array, " 10"]:
    """Ten inertial numbers in another frame, in which the old one stands at `shift`, turned by `turn`."""
    mass, first = link[0], turn @ link[1:4]
    second = turn @ _matrix(link) @ turn.T
    for a, b in ((shift, first), (first, shift), (shift, mass * shift)):
        second = second + (a @ b) * np.eye(3) - np.outer(a, b)
    return np.concatenate([[mass], first + mass * shift, second[ENTRIES]])


def _matrix(link: Float[Array, " 10"]) -> Float[Array, "3 3"]:
    """Second moments of ten inertial numbers."""
    xx, xy, yy, xz, yz, zz = link[4:]
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def about_centre(link: Float[Array, " 10"]) -> tuple[float, Float[Array, " 3"], Float[Array, "3 3"]]:
    """Mass, centre of mass, and inertia about it, of ten inertial numbers about a frame."""
    mass = float(link[0])
    centre = link[1:4] / mass if mass > 0.0 else np.zeros(3)
    return mass, centre, _matrix(link) - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))


def ball_of(mass: float, centre: Float[Array, " 3"], radius: float) -> Float[Array, " 10"]:
    """Ten numbers of a ball with a radius of gyration [m]."""
    square = mass * radius**2
    return moved(np.array([mass, 0.0, 0.0, 0.0, square, 0.0, square, 0.0, 0.0, square]), np.eye(3), centre)


def child(element: ET.Element, tag: str) -> ET.Element:
    """A child of an element, made if it is not there."""
    found = element.find(tag)
    return ET.SubElement(element, tag) if found is None else found


def read_inertial(link: ET.Element) -> Float[Array, " 10"]:
    """Ten numbers about the frame of a URDF's link; zero where it has no inertia."""
    origin, mass, inertia = (link.find(f"inertial/{name}") for name in ("origin", "mass", "inertia"))
    if mass is None or inertia is None:
        return np.zeros(10)
    own = np.zeros(10)
    own[0] = float(mass.get("value", "0"))
    own[4:] = [float(inertia.get(key, "0")) for key in MOMENTS]
    return moved(own, rpy_to_matrix(read_vector(origin, "rpy")), read_vector(origin, "xyz"))


def set_inertial(link: ET.Element, own: Float[Array, " 10"]) -> None:
    """Gives a URDF's link ten numbers about its frame."""
    inertial, (mass, centre, about) = child(link, "inertial"), about_centre(own)
    origin, moments = child(inertial, "origin"), child(inertial, "inertia")
    origin.set("xyz", numbers(centre))
    origin.set("rpy", "0 0 0")
    child(inertial, "mass").set("value", repr(mass))
    for key, value in zip(MOMENTS, about[ENTRIES], strict=True):
        moments.set(key, repr(float(value)))
