"""An identified arm as a USD layer for Newton: bodies, joints with losses, and a motor a joint.

A joint's rotor inertia, damping and dry friction stand in `NewtonJointAPI`, its motor is a
`NewtonActuator` without gains of its own, so that it gives the effort that it is told, up to the
effort limit; gains are the user's. USD joints turn about an axis of their frame: frames are turned
so that it is z. Angles are degrees in `PhysicsJoint` and `NewtonJointAPI`, radians in actuators.

Source: UsdPhysics (OpenUSD); newton-usd-schemas 0.6 (NewtonJointAPI, NewtonActuator,
NewtonPDControlAPI, NewtonMaxEffortClampingAPI).
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from ident.arrays import Array, Float
from ident.export.bodies import random_states
from ident.export.controllers import UNLIMITED
from ident.export.identified import IdentifiedArm
from ident.export.mjcf import LEAST_MOMENT
from ident.laws.motion import Arm, rigid_torque
from ident.model.carried import describe_arm
from ident.model.link_inertia import about_centre

if TYPE_CHECKING:
    from pxr import UsdPhysics
    from pxr.Gf import Quatf as Quaternion

FILE = "robot.usda"
SCHEMAS = "newton_usd_schemas"
UNREAD = "not loaded back: pip install usd-core newton-usd-schemas"
# A JSON text is one of USD as long as letters stay themselves: of \u00e9 USD makes u00e9.
quoted = partial(json.dumps, ensure_ascii=False)


def write_newton(identified: IdentifiedArm) -> str:
    """The layer's text."""
    arm = identified.whole
    chain = describe_arm(arm)
    names = prim_names(["base", *arm.links])
    joints = prim_names(arm.joint_names)
    pull = float(np.linalg.norm(identified.gravity))
    down = identified.gravity / pull if pull > 0.0 else np.array([0.0, 0.0, -1.0])
    lines = [
        "#usda 1.0",
        '(\n    defaultPrim = "robot"\n    metersPerUnit = 1\n    kilogramsPerUnit = 1',
        '    upAxis = "Z"\n)',
        'def PhysicsScene "scene"\n{',
        f"    vector3f physics:gravityDirection = {_tuple(down)}",
        f"    float physics:gravityMagnitude = {pull!r}\n}}",
        'def Xform "robot" (\n    prepend apiSchemas = ["PhysicsArticulationRootAPI"]',
        f"    displayName = {quoted(arm.name)}\n)\n{{",
        *_body("base", "base", np.eye(3), np.zeros(3), None),
        '    def PhysicsFixedJoint "base_fixed"\n    {',
        "        rel physics:body1 = </robot/base>\n    }",
    ]
    turn = np.eye(3)
    place = np.zeros(3)
    for j in range(arm.n):
        place = place + turn @ chain.offsets[j]
        turn = turn @ chain.rotations[j]
        lines += _body(names[j + 1], arm.links[j], turn, place, chain.links[j])
        lines += _joint(identified, chain, j, joints[j], names[j : j + 2])
    for j in range(arm.n):
        lines += _motor(arm.joint_names[j], joints[j], float(arm.known_limits.effort[j]))
    return "\n".join([*lines, "}", ""])


def prim_names(names: Sequence[str]) -> list[str]:
    """Names that a prim can have, all different; a space or a hyphen becomes a low line."""
    made: list[str] = []
    for name in names:
        plain = re.sub(r"\W", "_", name, flags=re.ASCII)
        plain = f"_{plain}" if not plain or plain[0].isdigit() else plain
        while plain in made:
            plain += "_"
        made.append(plain)
    return made


def _tuple(values: Array | Sequence[float]) -> str:
    return f"({', '.join(repr(float(value)) for value in values)})"


def _quaternion(rotation: Float[Array, "3 3"]) -> str:
    """Real part first, as USD has it."""
    turned = Rotation.from_matrix(rotation)
    return _tuple(turned.as_quat(canonical=True, scalar_first=True))


def _body(
    name: str,
    shown: str,
    turn: Float[Array, "3 3"],
    place: Float[Array, " 3"],
    link: Float[Array, " 10"] | None,
) -> list[str]:
    """A link where it is with all joints at zero; without mass if `link` is None."""
    if link is None:
        link = np.zeros(10)
    mass, centre, inertia = about_centre(link)
    moments, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.sign(np.linalg.det(axes))
    return [
        f'    def Xform "{name}" (',
        '        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]',
        f"        displayName = {quoted(shown)}\n    )\n    {{",
        f"        double3 xformOp:translate = {_tuple(place)}",
        f"        quatd xformOp:orient = {_quaternion(turn)}",
        '        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]',
        f"        float physics:mass = {max(float(mass), LEAST_MOMENT)!r}",
        f"        point3f physics:centerOfMass = {_tuple(centre)}",
        f"        float3 physics:diagonalInertia = {_tuple(np.maximum(moments, LEAST_MOMENT))}",
        f"        quatf physics:principalAxes = {_quaternion(axes)}",
        "    }",
    ]


def _joint(
    identified: IdentifiedArm,
    chain: Arm,
    j: int,
    name: str,
    bodies: Sequence[str],
) -> list[str]:
    """A joint with its losses and limits."""
    arm = identified.nominal
    losses = identified.losses
    sliding = bool(chain.sliding[j])
    kind = "PhysicsPrismaticJoint" if sliding else "PhysicsRevoluteJoint"
    unit = 1.0 if sliding else np.degrees(1.0)
    upright = np.array([[0.0, 0.0, 1.0]])
    z_to_axis = Rotation.align_vectors(chain.axes[j][None], upright)[0].as_matrix()
    lines = [
        f'    def {kind} "{name}" (\n        prepend apiSchemas = ["NewtonJointAPI"]',
        f"        displayName = {quoted(arm.joint_names[j])}\n    )\n    {{",
        f"        rel physics:body0 = </robot/{bodies[0]}>",
        f"        rel physics:body1 = </robot/{bodies[1]}>",
        '        uniform token physics:axis = "Z"',
        f"        point3f physics:localPos0 = {_tuple(chain.offsets[j])}",
        f"        quatf physics:localRot0 = {_quaternion(chain.rotations[j] @ z_to_axis)}",
        "        point3f physics:localPos1 = (0, 0, 0)",
        f"        quatf physics:localRot1 = {_quaternion(z_to_axis)}",
    ]
    limits = arm.known_limits
    for key, value in (("lower", limits.lower[j]), ("upper", limits.upper[j])):
        if abs(value) < UNLIMITED:
            lines.append(f"        float physics:{key}Limit = {float(unit * value)!r}")
    if 0.0 < limits.speed[j] < UNLIMITED:
        lines.append(f"        float newton:velocityLimit = {float(unit * limits.speed[j])!r}")
    return [
        *lines,
        f"        float newton:armature = {float(losses.motor_inertia[j])!r}",
        f"        float newton:damping = {float(losses.viscous[j] / unit)!r}",
        f"        float newton:friction = {float(losses.coulomb[j])!r}",
        "    }",
    ]


def _motor(shown: str, name: str, effort: float) -> list[str]:
    """An actuator that gives the effort that it is told, up to the limit."""
    limited = 0.0 < effort < UNLIMITED
    schemas = ["NewtonPDControlAPI", *(["NewtonMaxEffortClampingAPI"] if limited else [])]
    lines = [
        f'    def NewtonActuator "{name}_motor" (',
        f"        prepend apiSchemas = {quoted(schemas)}",
        f"        displayName = {quoted(shown)}\n    )\n    {{",
        f"        rel newton:targets = </robot/{name}>",
        "        float newton:kp = 0",
        "        float newton:kd = 0",
    ]
    if limited:
        lines.append(f"        float newton:maxEffort = {effort!r}")
    return [*lines, "    }"]


def check_newton(path: Path, identified: IdentifiedArm) -> dict[str, object]:
    """How near a written layer, loaded back by OpenUSD, is to the arm.

    Returns:
        Whether it loads, and the largest difference of torque, bodies and losses, at random states
        [N m]; without that where OpenUSD or Newton's schemas are not installed.
    """
    if find_spec("pxr") is None or find_spec(SCHEMAS) is None:
        return {"loads": None, "told": UNREAD}
    q, dq, ddq = random_states(identified.nominal, np.random.default_rng(0))
    chain, losses = read_newton(path)
    said = rigid_torque(chain, q, dq, ddq) + losses[0] * ddq + losses[1] * dq
    said = said + losses[2] * np.sign(dq)
    wanted = identified.whole.inverse_dynamics(q, dq, ddq)
    wanted = wanted + identified.losses.torque(dq, ddq, np.sign(dq))
    return {"loads": True, "torque_difference_Nm": float(np.max(np.abs(said - wanted)))}


def read_newton(path: Path) -> tuple[Arm, Float[Array, "3 n"]]:
    """The chain of a layer and its joints' rotor inertia, viscous and dry friction, by OpenUSD.

    Prims are asked by Newton's registered schemas: an attribute that none of them has is not found.
    """
    import newton_usd_schemas  # noqa: F401  (registers the schemas; before OpenUSD looks for them)
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(path))
    scene = UsdPhysics.Scene(stage.GetPrimAtPath("/scene"))
    down = np.array(scene.GetGravityDirectionAttr().Get()) * scene.GetGravityMagnitudeAttr().Get()
    driven = {}
    for prim in stage.Traverse():
        if prim.GetTypeName() == "NewtonActuator" and prim.HasAPI("NewtonActuatorControlBaseAPI"):
            driven[prim.GetRelationship("newton:targets").GetTargets()[0]] = prim
    rotations = []
    offsets = []
    axes = []
    links = []
    sliding = []
    losses = []
    for prim in stage.Traverse():
        if prim.GetTypeName() not in ("PhysicsRevoluteJoint", "PhysicsPrismaticJoint"):
            continue
        assert prim.GetPath() in driven, "a joint without a motor"
        assert prim.HasAPI("NewtonJointAPI"), "a joint without losses"
        joint = UsdPhysics.Joint(prim)
        turn = _matrix(joint.GetLocalRot0Attr().Get())
        turn_of_body = _matrix(joint.GetLocalRot1Attr().Get())
        rotations.append(turn @ turn_of_body.T)
        offsets.append(np.array(joint.GetLocalPos0Attr().Get(), dtype=float))
        axes.append(turn_of_body[:, 2])
        slides = prim.GetTypeName() == "PhysicsPrismaticJoint"
        sliding.append(slides)
        body = UsdPhysics.MassAPI(stage.GetPrimAtPath(joint.GetBody1Rel().GetTargets()[0]))
        links.append(_link(body))
        unit = 1.0 if slides else np.degrees(1.0)
        armature, damping, friction = (
            prim.GetAttribute(f"newton:{key}").Get() for key in ("armature", "damping", "friction")
        )
        losses.append([armature, damping * unit, friction])
    chain = Arm(
        rotations=np.array(rotations),
        offsets=np.array(offsets),
        axes=np.array(axes),
        sliding=np.array(sliding),
        links=np.array(links),
        gravity=down,
        gears=None,
        rated=np.zeros(len(links)),
    )
    return chain, np.array(losses).T


def _matrix(quaternion: Quaternion) -> Float[Array, "3 3"]:
    numbers = [quaternion.GetReal(), *quaternion.GetImaginary()]
    return np.asarray(Rotation.from_quat(numbers, scalar_first=True).as_matrix())


def _link(body: UsdPhysics.MassAPI) -> Float[Array, " 10"]:
    """A body's ten numbers about its frame."""
    mass = float(body.GetMassAttr().Get())
    centre = np.array(body.GetCenterOfMassAttr().Get(), dtype=float)
    axes = _matrix(body.GetPrincipalAxesAttr().Get())
    diagonal = np.array(body.GetDiagonalInertiaAttr().Get(), dtype=float)
    about = axes @ np.diag(diagonal) @ axes.T
    of_point = centre @ centre * np.eye(3) - np.outer(centre, centre)
    inertia = about + mass * of_point
    rows = [0, 0, 1, 0, 1, 2]
    columns = [0, 1, 1, 2, 2, 2]
    return np.array([mass, *(mass * centre), *inertia[rows, columns]])
