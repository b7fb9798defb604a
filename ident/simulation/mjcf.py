"""The arm's bodies for MuJoCo: the URDF's links as they really are, and what hangs on them."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ident.arrays import Array, Float, freeze

STANDARD_GRAVITY = (0.0, 0.0, -9.81)
Point = tuple[float, float, float]


def as_point(values: Sequence[float] | Array) -> Point:
    """Three coordinates [m]."""
    x, y, z = values
    return float(x), float(y), float(z)


@dataclass(frozen=True)
class AddedBody:
    """A rigid body fixed to a link."""

    link: str  # name of the link
    mass: float  # [kg]; a negative one takes material away from the link
    com: Point  # centre of mass in the link's frame [m]
    radius: float = 0.0  # radius of gyration, the same about every axis [m]


@dataclass(frozen=True)
class Slosh:
    """Liquid in a vessel on the last link: a mass on springs, free in three directions (outside the catalogue)."""

    mass: float  # moving mass [kg]
    place: Point  # its rest in the last link's frame [m]
    frequency: float = 2.0  # of its oscillation [Hz]
    damping_ratio: float = 0.08  # share of critical damping


@dataclass(frozen=True, eq=False)
class Bodies:
    """How the real links differ from the URDF's; the n joints' arrays are read-only."""

    mass_scale: Float[Array, " n"]  # factor on each link's mass and inertia
    inertia_scale: Float[Array, " n"]  # further factor on the inertia about the centre of mass
    com_shift: Float[Array, "n 3"]  # shift of the centres of mass [m]
    geometry_shift: Float[Array, "n 3"]  # shift of the joint frames in their parents [m]
    joint_inertia: Float[Array, " n"]  # that the joint itself adds (its rotor, where it is rigid) [kg m²]
    gravity: Float[Array, " 3"]  # in the base frame [m/s²]
    added: tuple[AddedBody, ...] = ()  # bodies fixed to links
    slosh: Slosh | None = None  # a swinging load
    tied: tuple[tuple[str, str, float, float], ...] = ()  # rotors of two joints: joint, other, ratio, inertia [kg m²]

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if isinstance(value, np.ndarray):
                object.__setattr__(self, name, freeze(value))

    def replace(self, **changes: Any) -> Bodies:
        return replace(self, **changes)


def nominal_bodies(n: int) -> Bodies:
    """The links exactly as the URDF says."""
    one, zero = np.ones(n), np.zeros(n)
    return Bodies(one, one, np.zeros((n, 3)), np.zeros((n, 3)), zero, np.array(STANDARD_GRAVITY))


def build_model(
    urdf: str, joints: tuple[str, ...], links: tuple[str, ...], bodies: Bodies, step: float, first_order: bool = False
) -> Any:
    """Compiles the arm.

    Args:
        urdf: URDF text; its geometry is not read.
        joints: Joint names, base to tip.
        links: The link that each joint moves.
        bodies: How the links differ from it.
        step: Step of the simulation [s].
        first_order: Whether to integrate by symplectic Euler steps, as stiff springs from outside MuJoCo need it.

    Returns:
        mujoco.MjModel, the n joints first, then those of a swinging load.
    """
    spec = mujoco.MjSpec.from_string(without_geometry(urdf))
    # Fixed links (tool mounts, cameras) become part of the link that carries them; the perturbations then act on all.
    fixed = spec.compile()
    spec = _as_chain(fixed, joints, bodies)
    for body in bodies.added:
        _add_body(spec.body(joints[links.index(body.link)]), body)
    if bodies.slosh is not None:
        _add_slosh(spec, joints[-1], bodies.slosh)
    for joint, other, ratio, inertia in bodies.tied:
        tendon = spec.add_tendon(name=f"{joint}+{other}")
        tendon.wrap_joint(joint, 1.0)
        tendon.wrap_joint(other, ratio)
        tendon.armature = inertia
    model = spec.compile()
    _set_options(model, bodies, step, first_order)
    return model


def without_geometry(urdf: str) -> str:
    """A URDF's text without what its links look like and collide with."""
    root = ET.fromstring(urdf)
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    return ET.tostring(root, encoding="unicode")


def _as_chain(fixed: Any, joints: tuple[str, ...], bodies: Bodies) -> Any:
    """A fresh spec with one body a joint, named after the joint, the changes of `bodies` applied."""
    spec = mujoco.MjSpec()
    spec.compiler.degree = False
    parent = spec.worldbody
    for j, name in enumerate(joints):
        joint = mujoco.mj_name2id(fixed, mujoco.mjtObj.mjOBJ_JOINT, name)
        body = int(fixed.jnt_bodyid[joint])
        scale = bodies.mass_scale[j]
        parent = parent.add_body(
            name=name,
            pos=fixed.body_pos[body] + bodies.geometry_shift[j],
            quat=fixed.body_quat[body],
            mass=scale * fixed.body_mass[body],
            ipos=fixed.body_ipos[body] + bodies.com_shift[j],
            iquat=fixed.body_iquat[body],
            inertia=scale * bodies.inertia_scale[j] * fixed.body_inertia[body],
            explicitinertial=True,
        )
        parent.add_joint(
            name=name,
            type=mujoco.mjtJoint(int(fixed.jnt_type[joint])),
            pos=fixed.jnt_pos[joint],
            axis=fixed.jnt_axis[joint],
            armature=bodies.joint_inertia[j],
        )
    return spec


def _add_body(body: Any, added: AddedBody) -> None:
    """Fixes a body to a link, or takes one away: masses, first and second moments add."""
    mass = body.mass + added.mass
    old, com = np.array(body.ipos), np.array(added.com)
    centre = (body.mass * old + added.mass * com) / mass
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, np.array(body.iquat))
    turn = axes.reshape(3, 3)
    inertia = turn @ np.diag(body.inertia) @ turn.T + added.mass * added.radius**2 * np.eye(3)
    for part, place in ((body.mass, old - centre), (added.mass, com - centre)):
        inertia += part * (place @ place * np.eye(3) - np.outer(place, place))
    body.mass, body.ipos = mass, centre
    values, vectors = np.linalg.eigh(inertia)
    vectors[:, 0] *= np.sign(np.linalg.det(vectors))
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(vectors).reshape(9))
    body.iquat, body.inertia = quaternion, values


def _add_slosh(spec: Any, link: str, slosh: Slosh) -> None:
    pulse = 2.0 * np.pi * slosh.frequency
    liquid = spec.body(link).add_body(name="slosh", pos=slosh.place)
    for axis in np.eye(3):
        liquid.add_joint(
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            stiffness=[slosh.mass * pulse**2, 0.0, 0.0],
            damping=[2.0 * slosh.damping_ratio * slosh.mass * pulse, 0.0, 0.0],
        )
    liquid.mass, liquid.ipos = slosh.mass, np.zeros(3)
    liquid.inertia = np.full(3, 4e-4 * slosh.mass)
    liquid.explicitinertial = True


def _set_options(model: Any, bodies: Bodies, step: float, first_order: bool) -> None:
    model.opt.timestep = step
    model.opt.gravity[:] = bodies.gravity
    # Fourth order where it can be: a first-order step shifts velocity by half a step against position. Where springs
    # join two bodies, the symplectic first-order step is the one that neither feeds nor damps their oscillation.
    kinds = mujoco.mjtIntegrator
    model.opt.integrator = kinds.mjINT_EULER if first_order else kinds.mjINT_RK4
    off = mujoco.mjtDisableBit
    # No constraint is left to solve: motions stay within limits, friction and drives are the plant's own.
    for bit in (off.mjDSBL_CONSTRAINT, off.mjDSBL_SENSOR, off.mjDSBL_ACTUATION, off.mjDSBL_AUTORESET):
        model.opt.disableflags |= int(bit)
