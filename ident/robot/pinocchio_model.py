"""Pinocchio's model of a chain: built from a URDF, changed, and read as plain arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pinocchio as pin

from ident.arrays import Array, Float, freeze
from ident.errors import RobotError, first_line, join_words
from ident.robot.branches import arm_tips
from ident.robot.chain import PER_LINK, Chain
from ident.robot.meshes import with_mesh_paths
from ident.robot.urdf import parse_urdf
from ident.robot.urdf_elements import followers

# xx xy yy xz yz zz of the ten numbers of a link, as the rows of its inertia.
FULL_INERTIA = (4, 5, 7, 5, 6, 8, 7, 8, 9)
# Of several arms so many are named.
MOST_NAMED = 2


def build_model(urdf: str, where: str) -> pin.Model:
    """The model of a chain of one-axis joints whose every joint moves some mass.

    Args:
        urdf: Text of a normalised URDF.
        where: What errors name.

    Raises:
        RobotError: It is none.
    """
    try:
        model = pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as error:
        what = f"the parser refused it ({first_line(error)})"
        raise RobotError(where, what, "check it with check_urdf") from None
    if model.nv == 0:
        raise RobotError(where, "it has no moving joint", "give an arm")
    if model.nq != model.nv or model.nv != model.njoints - 1:
        what = "it has joints of more than one axis"
        raise RobotError(where, what, "give an arm of revolute and prismatic joints")
    _require_no_fork(model, urdf, where)
    _require_no_followers(urdf, where)
    _require_masses(model, where)
    return model


def _require_no_fork(model: pin.Model, urdf: str, where: str) -> None:
    for joint, parent in enumerate(list(model.parents)[1:], start=1):
        if parent != joint - 1:
            tips = " or ".join(f":{name}" for name in arm_tips(urdf)[:MOST_NAMED])
            remedy = f"name the last joint of the arm that is meant behind the robot: {tips}"
            what = f"not a serial chain: {model.names[joint]} forks off"
            raise RobotError(where, what, remedy)


def _require_no_followers(urdf: str, where: str) -> None:
    coupled = followers(parse_urdf(urdf, where))
    if coupled:
        moves = "moves" if len(coupled) == 1 else "move"
        what = (
            f"{join_words(list(coupled))} {moves} with other joints (<mimic>), which makes no chain"
        )
        remedy = "give an arm of free joints; coupled ones that hardly weigh can be made fixed"
        raise RobotError(where, what, remedy)


def _require_masses(model: pin.Model, where: str) -> None:
    masses = [model.inertias[joint].mass for joint in range(model.njoints - 1, 0, -1)]
    moved = np.cumsum(masses)[::-1]
    without = [model.names[joint] for joint, mass in enumerate(moved, start=1) if not mass > 0.0]
    if without:
        what = f"{join_words(without)} {'moves' if len(without) == 1 else 'move'} no mass"
        raise RobotError(where, what, "give the links beyond their <inertial>, with a mass")


def inertial_parameters(model: pin.Model) -> Float[Array, " 10n"]:
    """Ten numbers a link: m, m c, and inertia about the joint frame, xx xy yy xz yz zz [SI]."""
    links = [model.inertias[joint].toDynamicParameters() for joint in range(1, model.njoints)]
    return np.concatenate(links)


def with_inertial_parameters(model: pin.Model, parameters: Float[Array, " 10n"]) -> pin.Model:
    """A copy of a model with other link inertias, in the order of `inertial_parameters` [SI]."""
    changed = pin.Model(model)
    links = np.asarray(parameters, dtype=float).reshape(model.nv, PER_LINK)
    for joint, link in enumerate(links, start=1):
        # Set piece by piece: the constructor refuses what least squares may find, an inertia that
        # no body could have. A zero mass carries its moments about the joint frame.
        inertia = pin.Inertia.Zero()
        mass = float(link[0])
        lever = link[1:4] / mass if mass != 0.0 else np.zeros(3)
        about_origin = link[list(FULL_INERTIA)].reshape(3, 3)
        cross = pin.skew(lever)
        inertia.mass = mass
        inertia.lever = lever
        about_centre = about_origin + mass * cross @ cross
        inertia.inertia = 0.5 * (about_centre + about_centre.T)
        changed.inertias[joint] = inertia
    return changed


def merge_inertias(
    model: pin.Model, fixed: Mapping[str, float], names: Sequence[str]
) -> Float[Array, " 10m"]:
    """Link inertias of an arm with some joints fixed, those of the links behind these added.

    Args:
        model: The whole arm, whose inertias may have been changed.
        fixed: Joints that are fixed, with their positions [rad or m].
        names: Joints of the reduced arm.
    """
    joints = list(model.names)[1:]
    data = model.createData()
    positions = np.array([fixed.get(name, 0.0) for name in joints])
    pin.forwardKinematics(model, data, positions)
    inertias: dict[str, pin.Inertia] = {}
    anchor = 0
    holder = ""
    for joint, name in enumerate(joints, start=1):
        if name not in fixed:
            anchor = joint
            holder = name
            # a copy: Pinocchio hands out references
            inertias[name] = pin.Inertia(model.inertias[joint])
        elif anchor:
            placement = data.oMi[anchor].actInv(data.oMi[joint])
            inertias[holder] = inertias[holder] + placement.act(model.inertias[joint])
    return np.concatenate([inertias[name].toDynamicParameters() for name in names])


def torque_derivatives(
    model: pin.Model, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
) -> Float[Array, "3 T n n"]:
    """∂τ/∂q, ∂τ/∂dq and ∂τ/∂ddq of inverse dynamics.

    Links may weigh less than nothing. Pinocchio's sums of bodies can't; the derivatives are linear
    in all inertial parameters, so that masses are added to every link, and taken away again.
    """
    parameters = inertial_parameters(model)
    masses = parameters[::PER_LINK]
    if np.any(masses < 0.0):
        more = np.zeros_like(parameters)
        more[::PER_LINK] = 1.0 + np.maximum(-masses, 0.0)
        heavy = with_inertial_parameters(model, parameters + more)
        added = with_inertial_parameters(model, more)
        with_both = torque_derivatives(heavy, q, dq, ddq)
        return with_both - torque_derivatives(added, q, dq, ddq)
    data = model.createData()
    states = [np.ascontiguousarray(values, dtype=float) for values in (q, dq, ddq)]
    out = np.empty((3, len(states[0]), model.nv, model.nv))
    for k, state in enumerate(zip(*states, strict=True)):
        out[0, k], out[1, k], out[2, k] = pin.computeRNEADerivatives(model, data, *state)
    return out


def read_chain(model: pin.Model) -> Chain:
    """Joint placements, axes, which joints slide, gravity and inertias, as plain arrays."""
    placements = list(model.jointPlacements)[1:]
    inertias = list(model.inertias)[1:]
    axes = np.zeros((model.nv, 3))
    sliding = np.zeros(model.nv, dtype=bool)
    rotations = []
    for k, joint in enumerate(list(model.joints)[1:]):
        linear, angular = _subspace(joint)
        sliding[k] = np.linalg.norm(linear) > 0.5
        axes[k] = linear if sliding[k] else angular
        first = placements[k].rotation
        cross = (not sliding[k]) * pin.skew(axes[k])
        rotations.append([first, first @ cross, first @ cross @ cross])
    sliding.setflags(write=False)
    return Chain(
        rotations=freeze(rotations),
        offsets=freeze([placement.translation for placement in placements]),
        axes=freeze(axes),
        sliding=sliding,
        gravity=freeze(model.gravity.linear),
        masses=freeze([inertia.mass for inertia in inertias]),
        centres=freeze([inertia.lever for inertia in inertias]),
        inertias=freeze([inertia.inertia for inertia in inertias]),
    )


def _subspace(joint: pin.JointModel) -> tuple[Float[Array, " 3"], Float[Array, " 3"]]:
    """Linear and angular velocity of a one-axis joint that moves at one."""
    data = joint.createData()
    joint.calc(data, np.zeros(1))
    subspace = data.S.matrix if hasattr(data.S, "matrix") else data.S
    linear, angular = np.asarray(subspace).reshape(2, 3)
    return linear, angular


def read_geometry(
    model: pin.Model, urdf: str, tag: str, source: Path | None, where: str
) -> pin.GeometryModel:
    """The shapes of an arm, of a tag: `collision` or `visual`.

    Raises:
        RobotError: A mesh that the URDF names is not there, or can't be read.

    Args:
        model: The arm's.
        urdf: The URDF's text.
        tag: "collision" or "visual".
        source: The URDF's file, from which relative paths of meshes go on; None without one.
        where: What a message names.
    """
    kinds = {"collision": pin.GeometryType.COLLISION, "visual": pin.GeometryType.VISUAL}
    with ExitStack() as lent:
        text, files = with_mesh_paths(urdf, tag, source, where, lent)
        try:
            shapes = pin.buildGeomFromUrdfString(model, text, kinds[tag], package_dirs=["/"])
        except (ValueError, RuntimeError) as error:
            lines = [line.removeprefix("message: ") for line in str(error).splitlines()]
            telling = [line for line in lines if "resource" in line or "Mesh" in line]
            reason = "".join([*telling, *lines][:1])
            for lent_file, file in files.items():
                reason = reason.replace(lent_file, file)
            what = f"{tag} geometry can't be read ({reason})"
            raise RobotError(where, what, "mend or replace the mesh, or give boxes") from None
        for shape in shapes.geometryObjects:
            shape.meshPath = files.get(shape.meshPath, shape.meshPath)
        return shapes
