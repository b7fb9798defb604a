"""The MJCF of a patched arm.

One body a joint, fixed links merged into what carries them; boxes, cylinders and spheres are kept
to be seen, without contacts. Each joint has a motor and a force sensor. Gain and offset of a log
stand in the motor, its lateness and its flat tops in the sensor: `ctrl` is a logged torque, taken
earlier by the sensor's delay, and the sensor reads one.

Source: MuJoCo's XML reference (joint: armature, polynomial damping, frictionloss, ref; sensor:
delay, cutoff).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from math import ceil, factorial
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.export.identified import Change, IdentifiedArm
from ident.export.urdf_file import NOTE, PAYLOAD, PAYLOAD_RADIUS
from ident.laws.acting import payload_parameters
from ident.model.link_inertia import about_centre, numbers
from ident.robot.arm import ArmModel

# Below this a principal moment is that of a body without extent [kg m²].
LEAST_MOMENT = 1e-9
# Dry friction and stops are constraints that soften over this time; twice the step is the least
# that is stable [s].
CONSTRAINT_TIME = 0.002
# How hard dry friction is: by MuJoCo's own 0.9 a light joint rubs in full only beyond a tenth of a
# radian a second.
HARDNESS = 0.999
CONSTRAINT = {
    "solreffriction": f"{CONSTRAINT_TIME!r} 1",
    "solimpfriction": f"{HARDNESS} {HARDNESS}",
}
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
# What is shown only: it touches nothing and weighs nothing.
SHOWN = {"contype": "0", "conaffinity": "0", "mass": "0"}

Elements = dict[str, dict[str, str]]
"""Attributes of a joint's elements: `joint`, `motor`, `sensor`, and `spring`, a second joint behind
the motor's, empty where the gear does not give way."""


def write_mjcf(identified: IdentifiedArm) -> str:
    """The patched MJCF."""
    arm = identified.whole
    root = ET.Element("mujoco", model=arm.name)
    root.append(ET.Comment(NOTE))
    ET.SubElement(root, "compiler", angle="radian", balanceinertia="true", autolimits="true")
    gravity = numbers(identified.gravity)
    option = {"timestep": repr(TIMESTEP), "integrator": "implicitfast", "gravity": gravity}
    ET.SubElement(root, "option", option)
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
    for change in identified.changes:
        if change.part("mjcf") == "load":
            body = ET.SubElement(parent, "body", name=PAYLOAD)
            ET.SubElement(body, "inertial", _point(payload_parameters(change.values)))
    motors = ET.SubElement(root, "actuator")
    sensors = ET.SubElement(root, "sensor")
    for name, of_joint in zip(arm.joint_names, elements, strict=True):
        ET.SubElement(motors, "general", {"name": name, "joint": name, **of_joint["motor"]})
        read = {"name": f"{name}_log", "actuator": name, **of_joint["sensor"]}
        ET.SubElement(sensors, "actuatorfrc", read)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _point(link: Float[Array, " 10"]) -> dict[str, str]:
    """Attributes of a body of hardly any extent."""
    mass = float(link[0])
    moment = repr(mass * PAYLOAD_RADIUS**2)
    return {
        "pos": numbers(link[1:4] / mass),
        "mass": repr(mass),
        "diaginertia": f"{moment} {moment} {moment}",
    }


def joint_elements(identified: IdentifiedArm) -> list[Elements]:
    """Elements of every joint: its losses, its limits, and its effects on top."""
    arm = identified.nominal
    losses = identified.losses
    limits = arm.known_limits
    late = _lateness(_total(identified.changes, "delay", "delay_s"))
    elements = []
    for j in range(arm.n):
        joint = {
            "armature": repr(float(losses.motor_inertia[j])),
            "damping": numbers([losses.viscous[j], *losses.bend[j]]),
            **CONSTRAINT,
            "frictionloss": repr(float(losses.coulomb[j])),
        }
        motor = {"gear": repr(1.0), "gaintype": "fixed", "gainprm": "1"}
        of_joint: Elements = {"joint": joint, "motor": motor, "sensor": dict(late), "spring": {}}
        changes = [change for change in identified.changes if change.joint == j]
        for change in changes:
            for name, attributes in _changed_elements(change).items():
                of_joint[name].update(attributes)
        # qpos is the logged angle, qpos − ref the true one.
        zero = -_total(changes, "zero", "offset_rad")
        if zero:
            joint["ref"] = repr(zero)
        lower = float(limits.lower[j]) + zero
        upper = float(limits.upper[j]) + zero
        effort = float(limits.effort[j])
        if max(abs(lower), abs(upper)) < UNLIMITED:
            joint["range"] = f"{lower!r} {upper!r}"
        if 0.0 < effort < UNLIMITED:
            joint["actuatorfrcrange"] = f"{-effort!r} {effort!r}"
        elements.append(of_joint)
    return elements


def _total(changes: Sequence[Change], place: str, parameter: str) -> float:
    """Sum of a parameter over the effects that a place of the file carries."""
    return sum(change.values[parameter] for change in changes if change.part("mjcf") == place)


def _lateness(delay: float) -> dict[str, str]:
    """Attributes of a sensor that is late [s]."""
    if delay <= 0.0:
        return {}
    samples = ceil(delay / TIMESTEP) + MORE_SAMPLES
    return {"delay": repr(delay), "nsample": str(samples), "interp": "linear"}


def _changed_elements(change: Change) -> Elements:
    """Which element of its joint an effect changes, and how."""
    place = change.part("mjcf")
    parameters = change.values
    if place == "gain":
        return {"motor": {"gear": repr(1.0 / (1.0 + parameters["gain"]))}}
    if place == "bias":
        offset = f"{-parameters['offset_Nm']!r} 0 0"
        return {"motor": {"biastype": "affine", "biasprm": offset}}
    if place == "cutoff":
        return {"sensor": {"cutoff": repr(parameters["limit_Nm"])}}
    if place == "spring":
        rest, stiffness = spring_at_rest(parameters)
        return {"joint": {"springref": numbers(rest), "stiffness": numbers(stiffness)}}
    if place == "second joint":
        stiffness_of_gear = repr(parameters["stiffness_Nm_rad"])
        damping = repr(parameters["damping_Nms_rad"])
        return {"spring": {"stiffness": stiffness_of_gear, "damping": damping}}
    return {}


def spring_at_rest(parameters: Mapping[str, float]) -> tuple[tuple[float], tuple[float, ...]]:
    """Rest angle of a cubic spring and its coefficients there, as MuJoCo reads them:
    k₀ x + k₁ x² + k₂ x³.

    A spring without a rest, which no cubic with a cube is, counts as none.
    """
    names = ("constant_Nm", "linear_Nm_rad", "square_Nm_rad2", "cube_Nm_rad3")
    law = np.polynomial.Polynomial([parameters[name] for name in names]).trim()
    every = np.atleast_1d(law.roots())
    roots = [float(root.real) for root in every if abs(root.imag) < REAL]
    if not roots:
        return (parameters["centre_rad"],), (0.0,)
    rest = min(roots, key=abs)
    terms = []
    for k in range(1, law.degree() + 1):
        slope = float(law.deriv(k)(rest))
        terms.append(slope / factorial(k))
    return (parameters["centre_rad"] + rest,), tuple(terms)


def quaternion(rotation: Float[Array, "3 3"]) -> str:
    """Unit quaternion (w, x, y, z) of a rotation."""
    return numbers(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _pose(placement: Any) -> dict[str, str]:
    """Attributes `pos` [m] and `quat` (w, x, y, z) that place an element in its parent.

    Args:
        placement: Pinocchio's SE3 from the element to its parent.
    """
    return {"pos": numbers(placement.translation), "quat": quaternion(placement.rotation)}


def _add_body(parent: ET.Element, arm: ArmModel, j: int, of_joint: Elements) -> ET.Element:
    """Adds the link that a joint moves, with the joint."""
    place = {"name": arm.links[j], **_pose(arm.model.jointPlacements[j + 1])}
    body = ET.SubElement(parent, "body", place)
    link = arm.inertial_parameters[10 * j : 10 * j + 10]
    ET.SubElement(body, "inertial", inertial_attributes(link))
    sliding = bool(arm.sliding_joints[j])
    common = {"type": "slide" if sliding else "hinge", "axis": numbers(arm.joint_axes[j])}
    name = arm.joint_names[j]
    ET.SubElement(body, "joint", {"name": name, **common, **of_joint["joint"]})
    if of_joint["spring"]:
        behind = {"name": name + SPRING_SUFFIX, **common, **of_joint["spring"]}
        ET.SubElement(body, "joint", behind)
    return body


def inertial_attributes(link: Float[Array, " 10"]) -> dict[str, str]:
    """Attributes of an MJCF body's `inertial`: "pos", "quat", "mass" and "diaginertia", as text.

    Args:
        link: Mass, first moments and inertia about the link's frame.

    A body without extent is given the least that MuJoCo takes.
    """
    mass, centre, inertia = about_centre(link)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return {
        "pos": numbers(centre),
        "quat": quaternion(axes),
        "mass": repr(max(mass, LEAST_MOMENT)),
        "diaginertia": numbers(np.maximum(moments, LEAST_MOMENT)),
    }


def _shapes(
    arm: ArmModel,
) -> tuple[dict[int, list[dict[str, str]]], dict[str, Float[Array, "k 3"]]]:
    """The collision geometry by the joint that moves it, and the corners of its meshes' hulls
    [m].
    """
    shapes: dict[int, list[dict[str, str]]] = {}
    hulls: dict[str, Float[Array, "k 3"]] = {}
    try:
        objects = arm.geometry.geometryObjects
    except RobotError:
        return shapes, hulls
    for number, item in enumerate(objects):
        kind = type(item.geometry).__name__.lower()
        if kind in SIZES:
            shape = {"type": kind, "size": numbers(SIZES[kind](item.geometry))}
        elif hasattr(item.geometry, "vertices"):
            corners = np.array(item.geometry.vertices())
            hulls[f"hull_{number}"] = corners[ConvexHull(corners).vertices]
            shape = {"type": "mesh", "mesh": f"hull_{number}"}
        else:
            continue
        of_joint = shapes.setdefault(int(item.parentJoint), [])
        of_joint.append({**shape, **SHOWN, **_pose(item.placement)})
    return shapes, hulls
