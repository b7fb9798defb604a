"""The MJCF of a patched arm.

One body a joint, fixed links merged into what carries them; boxes, cylinders and spheres are kept to be seen, without
contacts. Each joint has a motor and a force sensor. Gain and offset of a log stand in the motor, its lateness and its
flat tops in the sensor: `ctrl` is a logged torque, taken earlier by the sensor's delay, and the sensor reads one.

Source: MuJoCo's XML reference (joint: armature, polynomial damping, frictionloss, ref; sensor: delay, cutoff).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.export.bodies import about_centre
from ident.export.identified import IdentifiedArm
from ident.export.mjcf_joint import TIMESTEP, JointElements, joint_elements, numbers
from ident.export.urdf import NOTE, PAYLOAD, PAYLOAD_RADIUS
from ident.laws.acting import payload_parameters
from ident.robot.arm import ArmModel

# Below this a principal moment is that of a body without extent [kg m²].
LEAST_MOMENT = 1e-9


def write_mjcf(identified: IdentifiedArm) -> str:
    """The patched MJCF."""
    arm, changes = identified.whole, identified.changes
    root = ET.Element("mujoco", model=arm.name)
    root.append(ET.Comment(NOTE))
    ET.SubElement(root, "compiler", angle="radian", balanceinertia="true", autolimits="true")
    ET.SubElement(
        root, "option", timestep=repr(TIMESTEP), integrator="implicitfast", gravity=numbers(identified.gravity)
    )
    parent = ET.SubElement(root, "worldbody")
    shapes, hulls = _shapes(arm)
    if hulls:
        assets = ET.SubElement(root, "asset")
        for name, corners in hulls.items():
            ET.SubElement(assets, "mesh", name=name, vertex=numbers(corners.reshape(-1)))
    _add_shapes(parent, shapes.get(0, []))
    joints = joint_elements(identified)
    for j in range(arm.n):
        parent = _add_body(parent, arm, j, joints[j])
        _add_shapes(parent, shapes.get(j + 1, []))
    for change in changes:
        if change.part("mjcf") == "load":
            parent = _add_payload(parent, payload_parameters(change.values))
    motors, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    for one in joints:
        ET.SubElement(motors, "general", {"name": one.name, "joint": one.name, **one.motor})
        ET.SubElement(sensors, "actuatorfrc", {"name": f"{one.name}_log", "actuator": one.name, **one.sensor})
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def quaternion(rotation: Float[Array, "3 3"]) -> Float[Array, " 4"]:
    """Unit quaternion (w, x, y, z) of a rotation."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def _add_body(parent: ET.Element, arm: ArmModel, j: int, own: JointElements) -> ET.Element:
    placement = arm.model.jointPlacements[j + 1]
    place = {"pos": numbers(placement.translation), "quat": numbers(quaternion(placement.rotation))}
    body = ET.SubElement(parent, "body", {"name": arm.links[j], **place})
    ET.SubElement(body, "inertial", inertial_attributes(arm.inertial_parameters[10 * j : 10 * j + 10]))
    sliding = bool(arm.sliding_joints[j])
    common = {"type": "slide" if sliding else "hinge", "axis": numbers(arm.joint_axes[j])}
    ET.SubElement(body, "joint", {"name": arm.joint_names[j], **common, **own.joint})
    if own.spring:
        ET.SubElement(body, "joint", {"name": own.spring_name, **common, **own.spring})
    return body


def inertial_attributes(link: Float[Array, " 10"]) -> dict[str, str]:
    """Principal moments and axes; a body without extent is given the least that MuJoCo takes."""
    mass, centre, inertia = about_centre(link)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return {
        "pos": numbers(centre),
        "quat": numbers(quaternion(axes)),
        "mass": repr(max(mass, LEAST_MOMENT)),
        "diaginertia": numbers(np.maximum(moments, LEAST_MOMENT)),
    }


def _add_payload(parent: ET.Element, link: Float[Array, " 10"]) -> ET.Element:
    body = ET.SubElement(parent, "body", name=PAYLOAD)
    mass = float(link[0])
    moment = repr(mass * PAYLOAD_RADIUS**2)
    ET.SubElement(
        body, "inertial", pos=numbers(link[1:4] / mass), mass=repr(mass), diaginertia=f"{moment} {moment} {moment}"
    )
    return parent


def _shapes(arm: ArmModel) -> tuple[dict[int, list[dict[str, str]]], dict[str, Float[Array, "k 3"]]]:
    """The collision geometry by the joint that moves it, and the corners of its meshes' hulls [m]."""
    found: dict[int, list[dict[str, str]]] = {}
    hulls: dict[str, Float[Array, "k 3"]] = {}
    try:
        objects = arm.geometry.geometryObjects
    except RobotError:
        return found, hulls
    for number, item in enumerate(objects):
        size = _size(item.geometry)
        if size is None and hasattr(item.geometry, "vertices"):
            corners = np.array(item.geometry.vertices())
            hulls[f"hull_{number}"] = corners[ConvexHull(corners).vertices]
            size = {"type": "mesh", "mesh": f"hull_{number}"}
        if size is not None:
            pose = {"pos": numbers(item.placement.translation), "quat": numbers(quaternion(item.placement.rotation))}
            found.setdefault(int(item.parentJoint), []).append({**size, **pose})
    return found, hulls


def _size(shape: Any) -> dict[str, str] | None:
    """A primitive's type and size; None for what is none."""
    kind = type(shape).__name__.lower()
    if kind == "box":
        return {"type": kind, "size": numbers(shape.halfSide)}
    if kind in ("cylinder", "capsule"):
        return {"type": kind, "size": numbers([shape.radius, shape.halfLength])}
    return {"type": kind, "size": numbers([shape.radius])} if kind == "sphere" else None


def _add_shapes(body: ET.Element, shapes: Sequence[dict[str, str]]) -> None:
    for shape in shapes:
        ET.SubElement(body, "geom", {"contype": "0", "conaffinity": "0", "mass": "0", **shape})
