"""The MJCF of a patched arm.

One body a joint, fixed links merged into what carries them; boxes, cylinders and spheres are kept to be seen, without
contacts. Each joint has a motor and a force sensor. Gain and offset of a log stand in the motor, its lateness and its
flat tops in the sensor: `ctrl` is a logged torque, taken earlier by the sensor's delay, and the sensor reads one.

Source: MuJoCo's XML reference (joint: armature, polynomial damping, frictionloss, ref; sensor: delay, cutoff).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from math import ceil, factorial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.effects.rigid_body import UnknownPayload
from ident.errors import RobotError
from ident.export.identified import IdentifiedArm
from ident.laws.acting import payload_parameters
from ident.model.bodies import is_consistent
from ident.model.link_inertia import about_centre, ball_of, child, moved, numbers, read_inertial, set_inertial
from ident.robot.arm import ArmModel
from ident.robot.rotations import matrix_to_rpy, rotation_about, rpy_to_matrix
from ident.robot.urdf_elements import link_of, read_vector
from ident.safe_read import declare_prefixes

# Below this a principal moment is that of a body without extent [kg m²].
LEAST_MOMENT = 1e-9
# Dry friction and stops are constraints that soften over this time; twice the step is the least that is stable [s].
CONSTRAINT_TIME = 0.002
# How hard dry friction is: by MuJoCo's own 0.9 a light joint rubs in full only beyond a tenth of a radian a second.
HARDNESS = 0.999
SPRING_SUFFIX = "_spring"
TIMESTEP = 0.001  # [s]
# Further samples of a delayed sensor's memory.
MORE_SAMPLES = 4
# Joints without limits have these or wider ones [rad].
UNLIMITED = 1e8
# Imaginary part below which a root is real [rad].
REAL = 1e-9
# Sizes of the shapes that MuJoCo has by the same name.
SIZES: dict[str, Callable[[Any], Sequence[float]]] = {
    "box": lambda shape: shape.halfSide,
    "cylinder": lambda shape: [shape.radius, shape.halfLength],
    "capsule": lambda shape: [shape.radius, shape.halfLength],
    "sphere": lambda shape: [shape.radius],
}
# The URDF with named effects written into it.
# The user's own file is edited, comments and meshes stay. Losses go into <dynamics>; rotor inertia, for which a URDF
# has no place, stands in the parameter file.
NOTE = " written by `ident patch`; patch.json beside this file says what is in it and what is not "
PAYLOAD = UnknownPayload.id
LEVEL = "level"
# Share of its inertia that a link keeps whose mass another link takes over: no joint may move nothing.
LEFT = 1e-6
# A payload is reported as a point; simulators need some extent [m].
PAYLOAD_RADIUS = 0.01


def write_mjcf(identified: IdentifiedArm) -> str:
    """The patched MJCF."""
    arm = identified.whole
    changes = identified.changes
    root = ET.Element("mujoco", model=arm.name)
    root.append(ET.Comment(NOTE))
    ET.SubElement(root, "compiler", angle="radian", balanceinertia="true", autolimits="true")
    gravity = numbers(identified.gravity)
    ET.SubElement(root, "option", timestep=repr(TIMESTEP), integrator="implicitfast", gravity=gravity)
    parent = ET.SubElement(root, "worldbody")
    shapes, hulls = _shapes(arm)
    if hulls:
        assets = ET.SubElement(root, "asset")
        for name, corners in hulls.items():
            ET.SubElement(assets, "mesh", name=name, vertex=numbers(corners.reshape(-1)))
    for shape in shapes.get(0, []):
        ET.SubElement(parent, "geom", shape)
    elements = joint_elements(identified)
    for j in range(arm.n):
        parent = _add_body(parent, arm, j, elements[j])
        for shape in shapes.get(j + 1, []):
            ET.SubElement(parent, "geom", shape)
    for change in changes:
        if change.part("mjcf") == "load":
            link = payload_parameters(change.values)
            mass = float(link[0])
            moment = repr(float(link[0]) * PAYLOAD_RADIUS**2)
            point = {"pos": numbers(link[1:4] / mass), "mass": repr(mass), "diaginertia": f"{moment} {moment} {moment}"}
            ET.SubElement(ET.SubElement(parent, "body", name=PAYLOAD), "inertial", point)
    motors = ET.SubElement(root, "actuator")
    sensors = ET.SubElement(root, "sensor")
    for name, own in zip(arm.joint_names, elements, strict=True):
        ET.SubElement(motors, "general", {"name": name, "joint": name, **own["motor"]})
        ET.SubElement(sensors, "actuatorfrc", {"name": f"{name}_log", "actuator": name, **own["sensor"]})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


# Attributes of a joint's elements: `joint`, `motor`, `sensor`, and `spring`, a second joint behind the motor's, empty
# where the gear does not give way.
Elements = dict[str, dict[str, str]]


# Which element of its joint an effect's part of the file changes, and how, by its parameters.
PARTS: dict[str, tuple[str, Callable[[Mapping[str, float]], dict[str, str]]]] = {
    "gain": ("motor", lambda p: {"gear": repr(1.0 / (1.0 + p["gain"]))}),
    "bias": ("motor", lambda p: {"biastype": "affine", "biasprm": f"{-p['offset_Nm']!r} 0 0"}),
    "cutoff": ("sensor", lambda p: {"cutoff": repr(p["limit_Nm"])}),
    "spring": ("joint", lambda p: dict(zip(("springref", "stiffness"), map(numbers, spring_at_rest(p)), strict=True))),
    "second joint": (
        "spring",
        lambda p: {"stiffness": repr(p["stiffness_Nm_rad"]), "damping": repr(p["damping_Nms_rad"])},
    ),
}


def joint_elements(identified: IdentifiedArm) -> list[Elements]:
    """Elements of every joint: its losses, its limits, and its effects on top."""
    arm = identified.nominal
    losses = identified.losses
    limits = arm.known_limits
    delay = sum(change.values["delay_s"] for change in identified.changes if change.part("mjcf") == "delay")
    samples = str(ceil(delay / TIMESTEP) + MORE_SAMPLES)
    late = {"delay": repr(delay), "nsample": samples, "interp": "linear"} if delay > 0.0 else {}
    constraint = {"solreffriction": f"{CONSTRAINT_TIME!r} 1", "solimpfriction": f"{HARDNESS} {HARDNESS}"}
    found = []
    for j in range(arm.n):
        damping = numbers([losses.viscous[j], *losses.bend[j]])
        joint = {"armature": repr(float(losses.motor_inertia[j])), "damping": damping, **constraint}
        joint["frictionloss"] = repr(float(losses.coulomb[j]))
        motor = {"gear": repr(1.0), "gaintype": "fixed", "gainprm": "1"}
        own: Elements = {"joint": joint, "motor": motor, "sensor": dict(late), "spring": {}}
        changes = [change for change in identified.changes if change.joint == j]
        for change in changes:
            if (part := change.part("mjcf")) in PARTS:
                own[PARTS[part][0]].update(PARTS[part][1](change.values))
        # qpos is the logged angle, qpos − ref the true one.
        if zero := -sum(change.values["offset_rad"] for change in changes if change.part("mjcf") == "zero"):
            joint["ref"] = repr(zero)
        lower = float(limits.lower[j]) + zero
        upper = float(limits.upper[j]) + zero
        effort = float(limits.effort[j])
        if max(abs(lower), abs(upper)) < UNLIMITED:
            joint["range"] = f"{lower!r} {upper!r}"
        if 0.0 < effort < UNLIMITED:
            joint["actuatorfrcrange"] = f"{-effort!r} {effort!r}"
        found.append(own)
    return found


def spring_at_rest(parameters: Mapping[str, float]) -> tuple[tuple[float], tuple[float, ...]]:
    """Rest angle of a cubic spring and its coefficients there, as MuJoCo reads them: k₀ x + k₁ x² + k₂ x³.

    A spring without a rest, which no cubic with a cube is, counts as none.
    """
    names = ("constant_Nm", "linear_Nm_rad", "square_Nm_rad2", "cube_Nm_rad3")
    law = np.polynomial.Polynomial([parameters[name] for name in names]).trim()
    roots = [float(root.real) for root in np.atleast_1d(law.roots()) if abs(root.imag) < REAL]
    if not roots:
        return (parameters["centre_rad"],), (0.0,)
    rest = min(roots, key=abs)
    terms = [float(law.deriv(k)(rest)) / factorial(k) for k in range(1, law.degree() + 1)]
    return (parameters["centre_rad"] + rest,), tuple(terms)


def quaternion(rotation: Float[Array, "3 3"]) -> str:
    """Unit quaternion (w, x, y, z) of a rotation."""
    return numbers(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _pose(placement: Any) -> dict[str, str]:
    return {"pos": numbers(placement.translation), "quat": quaternion(placement.rotation)}


def _add_body(parent: ET.Element, arm: ArmModel, j: int, own: Elements) -> ET.Element:
    body = ET.SubElement(parent, "body", {"name": arm.links[j], **_pose(arm.model.jointPlacements[j + 1])})
    ET.SubElement(body, "inertial", inertial_attributes(arm.inertial_parameters[10 * j : 10 * j + 10]))
    sliding = bool(arm.sliding_joints[j])
    common = {"type": "slide" if sliding else "hinge", "axis": numbers(arm.joint_axes[j])}
    ET.SubElement(body, "joint", {"name": arm.joint_names[j], **common, **own["joint"]})
    if own["spring"]:
        ET.SubElement(body, "joint", {"name": arm.joint_names[j] + SPRING_SUFFIX, **common, **own["spring"]})
    return body


def inertial_attributes(link: Float[Array, " 10"]) -> dict[str, str]:
    """Principal moments and axes; a body without extent is given the least that MuJoCo takes."""
    mass, centre, inertia = about_centre(link)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return {
        "pos": numbers(centre),
        "quat": quaternion(axes),
        "mass": repr(max(mass, LEAST_MOMENT)),
        "diaginertia": numbers(np.maximum(moments, LEAST_MOMENT)),
    }


def _shapes(arm: ArmModel) -> tuple[dict[int, list[dict[str, str]]], dict[str, Float[Array, "k 3"]]]:
    """The collision geometry by the joint that moves it, and the corners of its meshes' hulls [m]."""
    found: dict[int, list[dict[str, str]]] = {}
    hulls: dict[str, Float[Array, "k 3"]] = {}
    try:
        objects = arm.geometry.geometryObjects
    except RobotError:
        return found, hulls
    for number, item in enumerate(objects):
        kind = type(item.geometry).__name__.lower()
        if kind in SIZES:
            own = {"type": kind, "size": numbers(SIZES[kind](item.geometry))}
        elif hasattr(item.geometry, "vertices"):
            corners = np.array(item.geometry.vertices())
            hulls[f"hull_{number}"] = corners[ConvexHull(corners).vertices]
            own = {"type": "mesh", "mesh": f"hull_{number}"}
        else:
            continue
        own |= {"contype": "0", "conaffinity": "0", "mass": "0", **_pose(item.placement)}
        found.setdefault(int(item.parentJoint), []).append(own)
    return found, hulls


def write_urdf(identified: IdentifiedArm) -> str:
    """The patched URDF: the arm's source file is edited where there is one, and losses that it states are replaced."""
    arm = identified.nominal
    losses = identified.losses
    links = identified.links.total
    text = source_text(arm)
    keeping_comments = ET.XMLParser(target=ET.TreeBuilder(insert_comments=True))
    root = ET.fromstring(declare_prefixes(text), parser=keeping_comments)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    bodies = {link.get("name"): link for link in root.findall("link")}
    for j, name in enumerate(arm.joint_names):
        dynamics = child(joints[name], "dynamics")
        dynamics.set("damping", repr(float(losses.viscous[j])))
        dynamics.set("friction", repr(float(losses.coulomb[j])))
        if np.any(links[j]):
            _add_inertia(root, bodies[arm.links[j]], links[j], arm.locked_joints)
    for change in identified.changes:
        part = change.part("urdf")
        p = change.values
        if part == "load":
            ball = ball_of(p["mass_kg"], np.array([p[f"com_{axis}_m"] for axis in "xyz"]), PAYLOAD_RADIUS)
            set_inertial(ET.SubElement(root, "link", name=PAYLOAD), ball)
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


def source_text(arm: ArmModel) -> str:
    """The URDF file that an arm was read from; where there is none any more, the arm's own text.

    Raises:
        RobotError: The file has another arm by now: what was identified is not about that.
    """
    if arm.source is None or not arm.source.is_file():
        return arm.urdf
    text = arm.source.read_text(encoding="utf-8")
    as_locked = (arm.source, tuple(arm.locked_joints.items()), arm.tip)
    if _content_of(text, *as_locked) != _content_of(arm.urdf, *as_locked):
        what = "its joints, lengths or inertias are no longer those of the arm that was identified"
        remedy = "identify the arm again, or put the file back as it was, or away"
        raise RobotError(arm.source, what, remedy)
    return text


@lru_cache(maxsize=4)
def _content_of(text: str, source: Path, locked: tuple[tuple[str, float], ...], tip: str) -> str:
    """What a URDF says of an arm with some joints locked; those that it has fixed stay so.

    The last are kept: one arm is written in many variants.
    """
    whole = ArmModel.from_urdf(text, source, {}, tip)
    there = {name: position for name, position in locked if name in whole.joint_names}
    return ArmModel.from_urdf(text, source, there, tip).content


def _add_inertia(root: ET.Element, link: ET.Element, change: Float[Array, " 10"], locked: Mapping[str, float]) -> None:
    """Adds to a link's ten numbers.

    What hangs on the link keeps its own, unless the change takes more than the link itself has: then the link gets that
    of what is fixed to it too, and where this is not enough, of what is locked.
    """
    numbers = read_inertial(link) + change
    for held in ({}, locked):
        if is_consistent(numbers):
            break
        for other, pose in list(_hanging_on(root, link, np.eye(4), held)):
            own = read_inertial(other)
            if own.any():
                numbers = numbers + (1.0 - LEFT) * moved(own, pose[:3, :3], pose[:3, 3])
                set_inertial(other, LEFT * own)
    set_inertial(link, numbers)


def _hanging_on(
    root: ET.Element, link: ET.Element, pose: Float[Array, "4 4"], locked: Mapping[str, float]
) -> Iterator[tuple[ET.Element, Array]]:
    """Links that are fixed to a link or held by locked joints, one by one outwards, with their frames in its own."""
    for joint in root.findall("joint"):
        name = joint.get("name", "")
        kind = joint.get("type")
        if link_of(joint, "parent") != link.get("name") or not (kind == "fixed" or name in locked):
            continue
        origin = joint.find("origin")
        axis = read_vector(joint.find("axis"), "xyz", "1 0 0")
        placed = np.eye(4)
        position = locked.get(name, 0.0)
        placed[:3, :3] = rpy_to_matrix(read_vector(origin, "rpy"))
        placed[:3, 3] = read_vector(origin, "xyz")
        if kind == "prismatic":
            placed[:3, 3] += placed[:3, :3] @ axis * position
        elif kind != "fixed":  # whose axis may be anything
            placed[:3, :3] = placed[:3, :3] @ rotation_about(axis, position)
        child = next(one for one in root.findall("link") if one.get("name") == link_of(joint, "child"))
        yield child, pose @ placed
        yield from _hanging_on(root, child, pose @ placed, locked)


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
