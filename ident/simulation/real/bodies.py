"""A URDF with a body more on one of its links."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np

from ident.arrays import Array, Float


def with_body(urdf: str, joint: str, mass: float, place: Float[Array, " 3"], radius: float) -> str:
    """The URDF's text with a ball on the link that a joint moves.

    Args:
        urdf: Text of the URDF.
        joint: The joint before the link.
        mass: Of the ball; negative takes it away [kg].
        place: Its centre in the link's frame [m].
        radius: Of gyration [m].
    """
    root = ET.fromstring(urdf)
    child = next(one for one in root.findall("joint") if one.get("name") == joint).find("child")
    link = next(one for one in root.findall("link") if child is not None and one.get("name") == child.get("link"))
    old_mass, old_centre, old_inertia = _read(link)
    total = old_mass + mass
    centre = (old_mass * old_centre + mass * place) / total
    about = old_inertia + _shifted(old_mass, old_centre - centre) + _shifted(mass, place - centre)
    _write(link, total, centre, about + mass * radius**2 * np.eye(3))
    return ET.tostring(root, encoding="unicode")


def _shifted(mass: float, by: Array) -> Array:
    return mass * (by @ by * np.eye(3) - np.outer(by, by))


def _numbers(element: ET.Element | None, key: str) -> Array:
    return np.array([float(x) for x in (element.get(key, "0 0 0") if element is not None else "0 0 0").split()])


def _read(link: ET.Element) -> tuple[float, Array, Array]:
    """Mass, centre, and inertia about it in the link's axes; zeros of a link without."""
    inertial = link.find("inertial")
    if inertial is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    origin, mass, inertia = (inertial.find(name) for name in ("origin", "mass", "inertia"))
    roll, pitch, yaw = _numbers(origin, "rpy")
    cr, sr, cp, sp, cy, sy = np.cos(roll), np.sin(roll), np.cos(pitch), np.sin(pitch), np.cos(yaw), np.sin(yaw)
    turn = np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )
    xx, xy, xz, yy, yz, zz = (0.0 if inertia is None else float(inertia.get(f"i{k}", 0.0)) for k in _KEYS)
    own = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return 0.0 if mass is None else float(mass.get("value", 0.0)), _numbers(origin, "xyz"), turn @ own @ turn.T


_KEYS = ("xx", "xy", "xz", "yy", "yz", "zz")


def _write(link: ET.Element, mass: float, centre: Array, about: Array) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "origin", xyz=" ".join(f"{x:.12g}" for x in centre), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=f"{mass:.12g}")
    values = (about[0, 0], about[0, 1], about[0, 2], about[1, 1], about[1, 2], about[2, 2])
    ET.SubElement(inertial, "inertia", {f"i{k}": f"{x:.12g}" for k, x in zip(_KEYS, values, strict=True)})
