"""The arm as it really is, drawn for one individual, and its bodies for MuJoCo."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError, RobotError, first_line
from ident.model.link_inertia import ENTRIES, about_centre, moved, read_inertial, set_inertial
from ident.robot.arm import ArmModel
from ident.simulation.laws import (
    Column,
    Contact,
    Law,
    change_law,
    heat_law,
    make_law,
    no_contact,
    plain_friction,
    scale_friction,
)
from ident.simulation.sensing import ReadOnly, Sensing

# Least second moment of mass that a possible body keeps along an axis, as a share of its largest.
LEAST_MOMENT = 1e-6
Point = Sequence[float] | Array
"""Three coordinates [m]."""
DECOYS = {
    "inertia": "masses and inertias of all links off by up to ten per cent, up or down alike",
    "geometry": "joint frames up to a millimetre from where the URDF puts them",
    "friction": (
        "friction half or twice of what an arm of this size has: start values from a data sheet "
        "are wrong"
    ),
    "controller": (
        "a controller of half to one and a half times the bandwidth, with another damping"
    ),
}
"""Differences from the data sheet that are no effect of the catalogue and must not be named as one.
"""


@dataclass(frozen=True)
class AddedBody:
    """A rigid body fixed to a link."""

    link: str  # name of the link
    mass: float  # [kg]; a negative one takes material away from the link
    com: Point  # centre of mass in the link's frame [m]
    radius: float = 0.0  # radius of gyration, the same about every axis [m]

    def fix_to(self, body: Any) -> None:
        """Adds it to a link's body in MuJoCo, or takes it away: masses, first and second moments
        add.
        """
        mass = body.mass + self.mass
        old = np.array(body.ipos)
        com = np.array(self.com)
        centre = (body.mass * old + self.mass * com) / mass
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, np.array(body.iquat))
        turn = axes.reshape(3, 3)
        of_body = turn @ np.diag(body.inertia) @ turn.T
        inertia = of_body + self.mass * self.radius**2 * np.eye(3)
        shares = ((body.mass, old - centre), (self.mass, com - centre))
        for weight, place in shares:
            about = place @ place * np.eye(3) - np.outer(place, place)
            inertia += weight * about
        body.mass = mass
        body.ipos = centre
        values, vectors = np.linalg.eigh(inertia)
        vectors[:, 0] *= np.sign(np.linalg.det(vectors))
        quaternion = np.zeros(4)
        mujoco.mju_mat2Quat(quaternion, np.ascontiguousarray(vectors).reshape(9))
        body.iquat = quaternion
        body.inertia = values


@dataclass(frozen=True)
class Slosh:
    """Liquid in a vessel on the last link: a mass on springs, free in three directions (outside the
    catalogue).
    """

    mass: float  # moving mass [kg]
    place: Point  # its rest in the last link's frame [m]
    frequency: float = 2.0  # of its oscillation [Hz]
    damping_ratio: float = 0.08  # share of critical damping


@dataclass(frozen=True, eq=False)
class RealBodies(ReadOnly):
    """How the real links differ from the URDF's; the n joints' arrays are read-only."""

    mass_scale: Float[Array, " n"]  # factor on each link's mass and inertia
    inertia_scale: Float[Array, " n"]  # further factor on the inertia about the centre of mass
    com_shift: Float[Array, "n 3"]  # shift of the centres of mass [m]
    geometry_shift: Float[Array, "n 3"]  # shift of the joint frames in their parents [m]
    # that the joint itself adds (its rotor, where it is rigid) [kg m²]
    joint_inertia: Float[Array, " n"]
    gravity: Float[Array, " 3"]  # in the base's frame [m/s²]
    added: tuple[AddedBody, ...] = ()  # bodies fixed to links
    slosh: Slosh | None = None  # a swinging load
    # rotors of two joints: joint, other, ratio, inertia [kg m²]
    tied: tuple[tuple[str, str, float, float], ...] = ()


def build_model(
    urdf: str,
    joints: tuple[str, ...],
    links: tuple[str, ...],
    bodies: RealBodies,
    step: float,
    first_order: bool = False,
) -> Any:
    """Compiles the arm.

    Args:
        urdf: URDF text; its geometry is not read.
        joints: Joint names, base to tip.
        links: The link that each joint moves.
        bodies: How the links differ from it.
        step: Step of the simulation [s].
        first_order: Whether to integrate by symplectic Euler steps, as stiff springs from outside
            MuJoCo need it.

    Returns:
        mujoco.MjModel, the n joints first, then those of a swinging load.
    """
    # Fixed links (tool mounts, cameras) become part of the link that carries them; the
    # perturbations then act on all.
    spec = _as_chain(_compile(without_geometry(urdf)), joints, bodies)
    for body in bodies.added:
        body.fix_to(spec.body(joints[links.index(body.link)]))
    if (slosh := bodies.slosh) is not None:
        pulse = 2.0 * np.pi * slosh.frequency
        liquid = spec.body(joints[-1]).add_body(name="slosh", pos=slosh.place)
        spring = slosh.mass * pulse**2
        damper = 2.0 * slosh.damping_ratio * slosh.mass * pulse
        for axis in np.eye(3):
            more = {"stiffness": [spring, 0.0, 0.0], "damping": [damper, 0.0, 0.0]}
            liquid.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis, **more)
        liquid.mass = slosh.mass
        liquid.ipos = np.zeros(3)
        liquid.inertia = np.full(3, 4e-4 * slosh.mass)
        liquid.explicitinertial = True
    for joint, other, ratio, inertia in bodies.tied:
        tendon = spec.add_tendon(name=f"{joint}+{other}")
        tendon.wrap_joint(joint, 1.0)
        tendon.wrap_joint(other, ratio)
        tendon.armature = inertia
    model = spec.compile()
    model.opt.timestep = step
    model.opt.gravity[:] = bodies.gravity
    # Fourth order where it can be: a first-order step shifts velocity by half a step against
    # position. Where springs join two bodies, the symplectic first-order step is the one that
    # neither feeds nor damps their oscillation.
    kinds = mujoco.mjtIntegrator
    off = mujoco.mjtDisableBit
    model.opt.integrator = kinds.mjINT_EULER if first_order else kinds.mjINT_RK4
    # No constraint is left to solve: motions stay within limits, friction and drives are the
    # plant's own.
    for bit in (
        off.mjDSBL_CONSTRAINT,
        off.mjDSBL_SENSOR,
        off.mjDSBL_ACTUATION,
        off.mjDSBL_AUTORESET,
    ):
        model.opt.disableflags |= int(bit)
    return model


def _compile(urdf: str) -> Any:
    """A URDF as MuJoCo reads it, links that no body could be as the nearest ones that could.

    Raises:
        RobotError: MuJoCo refuses it all the same.
    """
    try:
        return mujoco.MjSpec.from_string(urdf).compile()
    except ValueError:
        try:
            return mujoco.MjSpec.from_string(with_possible_bodies(urdf)).compile()
        except ValueError as error:
            what = f"MuJoCo refuses it ({first_line(error)})"
            raise RobotError("URDF", what, "check its <inertial> elements") from None


def with_possible_bodies(urdf: str) -> str:
    """A URDF's text where each link that no body could be is the nearest one of its mass and
    centre.

    With the second moments of mass about the centre, S = tr(I) / 2 - I, a body's are positive
    along every axis: what lies below is raised to next to nothing.
    """
    root = ET.fromstring(urdf)
    for link in root.findall("link"):
        numbers = read_inertial(link)
        mass, centre, about = about_centre(numbers)
        second = 0.5 * np.trace(about) * np.eye(3) - about
        moments, axes = np.linalg.eigh(second)
        least = LEAST_MOMENT * np.abs(moments).max()
        if mass <= 0.0 or moments[0] >= least:
            continue
        second = (axes * np.maximum(moments, least)) @ axes.T
        possible = np.trace(second) * np.eye(3) - second
        body = np.concatenate([[mass], np.zeros(3), possible[ENTRIES]])
        set_inertial(link, moved(body, np.eye(3), centre))
    return ET.tostring(root, encoding="unicode")


def without_geometry(urdf: str) -> str:
    """A URDF's text without what its links look like and collide with."""
    root = ET.fromstring(urdf)
    for link in root.findall("link"):
        for kind in ("visual", "collision"):
            for element in link.findall(kind):
                link.remove(element)
    return ET.tostring(root, encoding="unicode")


def _as_chain(fixed: Any, joints: tuple[str, ...], bodies: RealBodies) -> Any:
    """A fresh spec with one body a joint, named after the joint, the changes of `bodies`
    applied.
    """
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


@dataclass(frozen=True, eq=False)
class Hardware:
    """One individual arm with all that the URDF does not say: inertias, friction, drives and
    sensors.
    """

    arm: ArmModel  # the nominal model, known to everybody
    bodies: RealBodies  # its real links
    friction: Law  # its laws
    drive: Law
    heat: Law
    outside: Law
    contact: Contact
    sensing: Sensing  # its sensors
    bandwidth: float = 80.0  # of its controller, against the nominal inertia [rad/s]
    damping_ratio: float = 0.8
    friction_spread: float = 0.01  # relative change of the friction from run to run
    contact_run: int = -1  # number of the run in which the contact happens; -1 for all
    # factors on dry and viscous friction of each run, beside the spread, (R, 2, n)
    friction_path: Array | None = None
    # what its controller adds: gravity (`none`), the `rigid` model, or that and `friction`
    feed_forward: str = "rigid"
    # share of rated torque that encoder noise becomes in the loop at most
    loop_noise: float | None = None

    @property
    def n(self) -> int:
        """Number of joints."""
        return self.arm.n

    def replace(self, **changes: Any) -> Hardware:
        """A copy with other fields, given by their names."""
        return replace(self, **changes)

    def with_laws(self, group: str, joint: int | None = None, **values: Column) -> Hardware:
        """A copy with columns of one of its laws changed: at one joint, or as a whole where joint
        is None.
        """
        return self.replace(**{group: change_law(getattr(self, group), joint, **values)})


def draw_hardware(arm: ArmModel, rng: np.random.Generator, inertia_error: float = 0.03) -> Hardware:
    """Draws an individual arm: no effect of the catalogue, but nothing exactly as in the data
    sheet.

    Friction and rotor scale with the rated torque, as gear size does: for 157 N m about 12 N m dry
    and 10 N m s/rad viscous with 1 kg m² of rotor, for 43 N m about 2.6 N m, 1.7 N m s/rad and 0.13
    kg m². Measured on a UR10e of like size: 20 and 2.7 N m dry, 27 and 3.4 N m s/rad viscous.
    """
    n = arm.n
    scale = arm.rated_torque
    relative = scale / 157.0
    none = np.zeros((n, 3))
    scatter = rng.standard_normal((3, n))
    coulomb = 12.0 * relative**1.15 * np.exp(0.25 * scatter[0])
    viscous = 10.0 * relative**1.35 * np.exp(0.25 * scatter[1])
    rotor = 1.0 * relative**1.55 * np.exp(0.15 * scatter[2])
    levers = [arm.model.inertias[i].lever for i in range(1, n + 1)]
    size = np.linalg.norm(levers, axis=1)
    mass, inertia = (1.0 + inertia_error * rng.standard_normal(n) for _ in range(2))
    shift = inertia_error * size[:, None] * rng.standard_normal((n, 3))
    gravity = np.array(arm.model.gravity.linear)
    bodies = RealBodies(mass, inertia, shift, none, np.zeros(n), gravity)
    rated_loss = coulomb * 0.6 + viscous * 0.6**2
    # Gear ratios: 100 at the strong joints, 80 at the weak ones, as strain-wave gears of these
    # sizes have.
    ratio = np.where(scale > 0.5 * scale.max(), 100.0, 80.0)
    drive = make_law("drive", n, rotor_inertia=rotor, effort_limit=scale, ripple_order=2.0 * ratio)
    return Hardware(
        arm=arm,
        bodies=bodies,
        friction=plain_friction(coulomb, viscous, rotor),
        drive=drive,
        heat=heat_law(rated_loss),
        outside=make_law("outside", n),
        contact=no_contact(),
        sensing=Sensing.typical(scale, ratio),
    )


def add_decoy(hardware: Hardware, name: str, rng: np.random.Generator) -> Hardware:
    """The hardware with a decoy.

    Raises:
        InputError: No such decoy.
    """
    n = hardware.n
    bodies = hardware.bodies
    if name == "inertia":
        mass, inertia = 1.0 + rng.uniform(-0.1, 0.1, (2, n))
        shifted = {
            "mass_scale": bodies.mass_scale * mass,
            "inertia_scale": bodies.inertia_scale * inertia,
        }
        return hardware.replace(bodies=bodies.replace(**shifted))
    if name == "geometry":
        shift = bodies.geometry_shift + rng.uniform(-1e-3, 1e-3, (n, 3))
        return hardware.replace(bodies=bodies.replace(geometry_shift=shift))
    if name == "friction":
        factor = np.exp(rng.uniform(-np.log(2.0), np.log(2.0), (2, n)))
        return hardware.replace(friction=scale_friction(hardware.friction, *factor))
    if name == "controller":
        bandwidth = hardware.bandwidth * float(rng.uniform(0.5, 1.5))
        return hardware.replace(bandwidth=bandwidth, damping_ratio=float(rng.uniform(0.6, 1.1)))
    raise InputError("--decoy", f"unknown decoy {name!r}", f"choose from: {', '.join(DECOYS)}")
