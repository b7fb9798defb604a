"""The MJCF of a patched arm.

One body a joint, fixed links merged into what carries them; boxes, cylinders and spheres are kept to be seen, without
contacts. Each joint has a motor and a force sensor. Gain and offset of a log stand in the motor, its lateness and its
flat tops in the sensor: `ctrl` is a logged torque, taken earlier by the sensor's delay, and the sensor reads one.

Source: MuJoCo's XML reference (joint: armature, polynomial damping, frictionloss, ref; sensor: delay, cutoff).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence

import numpy as np
from scipy.spatial import ConvexHull

from ident.arrays import Array, Float
from ident.errors import RobotError
from ident.patches.change import Change
from ident.patches.mjcf_joint import JointFigures, joint_figures
from ident.patches.standalone.chain import payload_parameters, turned_gravity
from ident.patches.standalone.motion import Losses
from ident.patches.urdf import NOTE, PAYLOAD, PAYLOAD_RADIUS
from ident.robot.arm import ArmModel

TIMESTEP = 0.001  # [s]
# Below this a principal moment is that of a body without extent [kg m²].
LEAST_MOMENT = 1e-9
# Spare samples of a delayed sensor's memory.
SPARE_SAMPLES = 4


def write_mjcf(arm: ArmModel, losses: Losses, changes: Sequence[Change]) -> str:
    """The patched MJCF.

    Args:
        arm: The arm with its patched link inertias.
        losses: Losses of each joint.
        changes: Named effects; link errors are in the arm already.
    """
    root = ET.Element("mujoco", model=arm.name)
    root.append(ET.Comment(NOTE))
    ET.SubElement(root, "compiler", angle="radian", balanceinertia="true", autolimits="true")
    ET.SubElement(
        root, "option", timestep=repr(TIMESTEP), integrator="implicitfast", gravity=_text(gravity_of(arm, changes))
    )
    parent = ET.SubElement(root, "worldbody")
    shapes, hulls = _shapes(arm)
    if hulls:
        assets = ET.SubElement(root, "asset")
        for name, corners in hulls.items():
            ET.SubElement(assets, "mesh", name=name, vertex=_text(corners.reshape(-1)))
    _add_shapes(parent, shapes.get(0, []))
    figures = joint_figures(arm, losses, changes)
    for j in range(arm.n):
        parent = _add_body(parent, arm, j, figures[j])
        _add_shapes(parent, shapes.get(j + 1, []))
    for change in changes:
        if change.effect == "payload":
            parent = _add_payload(parent, payload_parameters(change.values))
    _add_drives(root, figures)
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _text(values: Sequence[float] | Array) -> str:
    return " ".join(repr(float(value)) for value in values)


def gravity_of(arm: ArmModel, changes: Sequence[Change]) -> Float[Array, " 3"]:
    """Gravity in the arm's base, turned by a named tilt [m/s²]."""
    gravity = np.array(arm.model.gravity.linear)
    for change in changes:
        if change.effect == "gravity_misalignment":
            gravity = turned_gravity(gravity, change.values)
    return gravity


def quaternion(rotation: Float[Array, "3 3"]) -> Float[Array, " 4"]:
    """Unit quaternion (w, x, y, z) of a rotation: the eigenvector to the largest eigenvalue of Bar-Itzhack's matrix.

    Source: Bar-Itzhack 2000, New method for extracting the quaternion from a rotation matrix.
    """
    r = rotation
    k = np.array(
        [
            [r[0, 0] + r[1, 1] + r[2, 2], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [0.0, r[0, 0] - r[1, 1] - r[2, 2], r[0, 1] + r[1, 0], r[0, 2] + r[2, 0]],
            [0.0, 0.0, r[1, 1] - r[0, 0] - r[2, 2], r[1, 2] + r[2, 1]],
            [0.0, 0.0, 0.0, r[2, 2] - r[0, 0] - r[1, 1]],
        ]
    )
    found = np.linalg.eigh(k, UPLO="U")[1][:, -1]
    return found if found[0] >= 0.0 else -found


def _add_body(parent: ET.Element, arm: ArmModel, j: int, figures: JointFigures) -> ET.Element:
    placement = arm.model.jointPlacements[j + 1]
    body = ET.SubElement(
        parent, "body", name=arm.links[j], pos=_text(placement.translation), quat=_text(quaternion(placement.rotation))
    )
    _add_inertial(body, arm.inertial_parameters[10 * j : 10 * j + 10])
    sliding = bool(arm.sliding_joints[j])
    common = {"type": "slide" if sliding else "hinge", "axis": _text(arm.joint_axes[j])}
    ET.SubElement(body, "joint", {"name": arm.joint_names[j], **common, **figures.joint})
    if figures.spring is not None:
        ET.SubElement(body, "joint", {"name": figures.spring_name, **common, **figures.spring})
    return body


def _add_inertial(body: ET.Element, link: Float[Array, " 10"]) -> None:
    ET.SubElement(body, "inertial", inertial_attributes(link))


def inertial_attributes(link: Float[Array, " 10"]) -> dict[str, str]:
    """Principal moments and axes; a body without extent is given the least that MuJoCo takes."""
    mass, first = float(link[0]), link[1:4]
    centre = first / mass if mass > 0.0 else np.zeros(3)
    xx, xy, yy, xz, yz, zz = link[4:]
    about_frame = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    moments, axes = np.linalg.eigh(about_frame - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre)))
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return {
        "pos": _text(centre),
        "quat": _text(quaternion(axes)),
        "mass": repr(max(mass, LEAST_MOMENT)),
        "diaginertia": _text(np.maximum(moments, LEAST_MOMENT)),
    }


def _add_payload(parent: ET.Element, link: Float[Array, " 10"]) -> ET.Element:
    body = ET.SubElement(parent, "body", name=PAYLOAD)
    mass = float(link[0])
    moment = repr(mass * PAYLOAD_RADIUS**2)
    ET.SubElement(
        body, "inertial", pos=_text(link[1:4] / mass), mass=repr(mass), diaginertia=f"{moment} {moment} {moment}"
    )
    return parent


def _add_drives(root: ET.Element, figures: Sequence[JointFigures]) -> None:
    motors, sensors = ET.SubElement(root, "actuator"), ET.SubElement(root, "sensor")
    for item in figures:
        ET.SubElement(motors, "general", {"name": item.name, "joint": item.name, **item.motor})
        sensor = ET.SubElement(sensors, "actuatorfrc", name=f"{item.name}_log", actuator=item.name)
        if item.delay > 0.0:
            samples = int(np.ceil(item.delay / TIMESTEP)) + SPARE_SAMPLES
            for key, value in (("delay", repr(item.delay)), ("nsample", str(samples)), ("interp", "linear")):
                sensor.set(key, value)
        if item.cutoff is not None:
            sensor.set("cutoff", repr(item.cutoff))


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
            pose = {"pos": _text(item.placement.translation), "quat": _text(quaternion(item.placement.rotation))}
            found.setdefault(int(item.parentJoint), []).append({**size, **pose})
    return found, hulls


def _size(shape: object) -> dict[str, str] | None:
    kind = type(shape).__name__
    if kind == "Box":
        return {"type": "box", "size": _text(shape.halfSide)}  # type: ignore[attr-defined]
    if kind == "Cylinder":
        return {"type": "cylinder", "size": _text([shape.radius, shape.halfLength])}  # type: ignore[attr-defined]
    if kind == "Capsule":
        return {"type": "capsule", "size": _text([shape.radius, shape.halfLength])}  # type: ignore[attr-defined]
    if kind == "Sphere":
        return {"type": "sphere", "size": _text([shape.radius])}  # type: ignore[attr-defined]
    return None


def _add_shapes(body: ET.Element, shapes: Sequence[dict[str, str]]) -> None:
    for shape in shapes:
        ET.SubElement(body, "geom", {"contype": "0", "conaffinity": "0", "mass": "0", **shape})
