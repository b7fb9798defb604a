"""The MJCF of a patched arm.

One body a joint, fixed links merged into what carries them; boxes, cylinders and spheres are kept to be seen, without
contacts. Each joint has a motor and a force sensor. Gain and offset of a log stand in the motor, its lateness and its
flat tops in the sensor: `ctrl` is a logged torque, taken earlier by the sensor's delay, and the sensor reads one.

Source: MuJoCo's XML reference (joint: armature, polynomial damping, frictionloss, ref; sensor: delay, cutoff).
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
from ident.export.bodies import about_centre, numbers
from ident.export.identified import IdentifiedArm
from ident.export.urdf import NOTE, PAYLOAD, PAYLOAD_RADIUS
from ident.laws.acting import payload_parameters
from ident.robot.arm import ArmModel

# Below this a principal moment is that of a body without extent [kg m²].
LEAST_MOMENT = 1e-9
# Dry friction and stops are constraints that soften over this time; twice the step is the least that is stable [s].
CONSTRAINT_TIME = 0.002
# How hard dry friction is: by MuJoCo's own 0.9 a light joint rubs in full only beyond a tenth of a radian a second.
HARDNESS = 0.999
SPRING_SUFFIX = "_spring"
TIMESTEP = 0.001  # [s]
# Spare samples of a delayed sensor's memory.
SPARE_SAMPLES = 4
# Joints without limits have these or wider ones [rad].
UNLIMITED = 1e8
# Imaginary part below which a root is real [rad].
REAL = 1e-9


def write_mjcf(identified: IdentifiedArm) -> str:
    """The patched MJCF."""
    arm, changes = identified.whole, identified.changes
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
    _add_shapes(parent, shapes.get(0, []))
    elements = joint_elements(identified)
    for j in range(arm.n):
        parent = _add_body(parent, arm, j, elements[j])
        _add_shapes(parent, shapes.get(j + 1, []))
    for change in changes:
        if change.part("mjcf") == "load":
            link = payload_parameters(change.values)
            mass, moment = float(link[0]), repr(float(link[0]) * PAYLOAD_RADIUS**2)
            told = {"pos": numbers(link[1:4] / mass), "mass": repr(mass), "diaginertia": f"{moment} {moment} {moment}"}
            ET.SubElement(ET.SubElement(parent, "body", name=PAYLOAD), "inertial", told)
    motors, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    for name, own in zip(arm.joint_names, elements, strict=True):
        ET.SubElement(motors, "general", {"name": name, "joint": name, **own["motor"]})
        ET.SubElement(sensors, "actuatorfrc", {"name": f"{name}_log", "actuator": name, **own["sensor"]})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


# Attributes of a joint's elements: `joint`, `motor`, `sensor`, and `spring`, a second joint behind the motor's, empty
# where the gear does not give way.
Elements = dict[str, dict[str, str]]


# Which element of its joint an effect's part of the file changes, and how, by its figures.
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
    arm, losses = identified.nominal, identified.losses
    delay = sum(change.values["delay_s"] for change in identified.changes if change.part("mjcf") == "delay")
    samples = str(ceil(delay / TIMESTEP) + SPARE_SAMPLES)
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
        lower, upper, effort = float(arm.lower[j]) + zero, float(arm.upper[j]) + zero, float(arm.effort_limit[j])
        if max(abs(lower), abs(upper)) < UNLIMITED:
            joint["range"] = f"{lower!r} {upper!r}"
        if 0.0 < effort < UNLIMITED:
            joint["actuatorfrcrange"] = f"{-effort!r} {effort!r}"
        found.append(own)
    return found


def spring_at_rest(figures: Mapping[str, float]) -> tuple[tuple[float], tuple[float, ...]]:
    """Rest angle of a cubic spring and its coefficients there, as MuJoCo reads them: k₀ x + k₁ x² + k₂ x³.

    A spring without a rest, which no cubic with a cube is, counts as none.
    """
    names = ("constant_Nm", "linear_Nm_rad", "square_Nm_rad2", "cube_Nm_rad3")
    law = np.polynomial.Polynomial([figures[name] for name in names]).trim()
    roots = [float(root.real) for root in np.atleast_1d(law.roots()) if abs(root.imag) < REAL]
    if not roots:
        return (figures["centre_rad"],), (0.0,)
    rest = min(roots, key=abs)
    terms = [float(law.deriv(k)(rest)) / factorial(k) for k in range(1, law.degree() + 1)]
    return (figures["centre_rad"] + rest,), tuple(terms)


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


# Sizes of the shapes that MuJoCo has by the same name.
SIZES: dict[str, Callable[[Any], Sequence[float]]] = {
    "box": lambda shape: shape.halfSide,
    "cylinder": lambda shape: [shape.radius, shape.halfLength],
    "capsule": lambda shape: [shape.radius, shape.halfLength],
    "sphere": lambda shape: [shape.radius],
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
            size = {"type": kind, "size": numbers(SIZES[kind](item.geometry))}
        elif hasattr(item.geometry, "vertices"):
            corners = np.array(item.geometry.vertices())
            hulls[f"hull_{number}"] = corners[ConvexHull(corners).vertices]
            size = {"type": "mesh", "mesh": f"hull_{number}"}
        else:
            continue
        found.setdefault(int(item.parentJoint), []).append({**size, **_pose(item.placement)})
    return found, hulls


def _add_shapes(body: ET.Element, shapes: Sequence[dict[str, str]]) -> None:
    for shape in shapes:
        ET.SubElement(body, "geom", {"contype": "0", "conaffinity": "0", "mass": "0", **shape})
