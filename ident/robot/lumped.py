"""The paper's three-joint model: links 1 to 3, and the wrist as a point mass m4 at the end of link
3.

An `ArmModel` built from the paper's parameters, equal to its equations A5 to A10 with their printed
errors mended. The exact reduction, with the wrist frozen as it really is, is `ArmModel.locked`.

What the lumped model leaves out, and the exact reduction keeps: lateral offsets of the links (so
M12 = M13 = 0 here), products of inertia, the wrist's own inertia and its centre of mass beyond the
J4 axis.

Source: Machines 2023, 11, 350, appendix A; (A2), (A8) M33, (A9) C21 and C32, (A10) G2 corrected.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ident.arrays import Array
from ident.errors import RobotError
from ident.robot.arm import ArmModel


@dataclass(frozen=True)
class LumpedParameters:
    """Figures of the three-joint model, named as in the paper's table A1."""

    m2: float  # masses of link 2, link 3 and the wrist [kg]
    m3: float
    m4: float
    a2: float  # length of upper arm, and of forearm up to the J4 axis [m]
    a3: float
    d1: float  # height of the J2 axis [m]
    l2: float  # distance of the centres of mass from the J2 and J3 axes, along the link [m]
    l3: float
    I1y: float  # moment of link 1 about the vertical [kg m²]
    # principal moments about the centres of mass; x along the link, z along the joint axis [kg m²]
    I2x: float
    I2y: float
    I2z: float
    I3x: float
    I3y: float
    I3z: float
    # Angles of the paper from joint positions: θ = sign · q + offset; θ2 = 0 is an upright upper
    # arm, θ3 = 0 a straight one.
    sign: tuple[int, int, int] = (1, 1, 1)
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)


def lumped_parameters(arm: ArmModel) -> LumpedParameters:
    """The paper's parameters from an arm's first three joints and the masses beyond them.

    Raises:
        RobotError: The arm is not of the paper's kind: joint 1 vertical, joints 2 and 3 horizontal
            and parallel.
    """
    model = arm.model
    n = arm.n
    where = str(arm.source or arm.name)
    if n < 4:
        raise RobotError(
            where,
            f"it has {n} joints",
            "the three-joint model needs an arm with a wrist; use --links 6",
        )
    data = model.createData()
    pin.forwardKinematics(model, data, np.zeros(n))
    poses = [data.oMi[i] for i in range(1, n + 1)]
    axes = [pose.rotation @ axis for pose, axis in zip(poses, arm.joint_axes, strict=True)]
    vertical = np.array([0.0, 0.0, 1.0])
    horizontal = axes[1]
    is_upright = abs(axes[0] @ vertical) > 0.999
    is_level = abs(axes[2] @ horizontal) > 0.999
    parallel = is_upright and is_level
    if not parallel or abs(horizontal @ vertical) >= 1e-3 or np.any(arm.sliding_joints[:3]):
        what = "the first three joints are not vertical, horizontal, parallel"
        raise RobotError(where, what, "use --links 6, or lock joints for the exact reduction")
    return _planar_figures(arm, poses, axes)


def _planar_figures(arm: ArmModel, poses: list[pin.SE3], axes: list[Array]) -> LumpedParameters:
    """Projects the arm at zero onto the plane across the J2 axis."""
    up = np.array([0.0, 0.0, 1.0])
    out = np.cross(axes[1], up)  # a positive turn about J2 leans an upright arm this way
    across = np.eye(3) - np.outer(axes[1], axes[1])
    steps = [poses[k + 1].translation - poses[k].translation for k in (1, 2)]
    upper, fore = (across @ step for step in steps)
    a2 = float(np.linalg.norm(upper))
    a3 = float(np.linalg.norm(fore))
    turn2 = float(np.arctan2(upper @ out, upper @ up))
    turn3 = float(np.arctan2(fore @ out, fore @ up)) - turn2
    links = [arm.model.inertias[i] for i in range(1, arm.n + 1)]
    com2, moments2 = _along_link(links[1], poses[1], upper / a2, axes[1])
    com3, moments3 = _along_link(links[2], poses[2], fore / a3, axes[1])
    first = poses[0].rotation @ links[0].inertia @ poses[0].rotation.T
    same = 1 if axes[2] @ axes[1] > 0 else -1
    # θ is measured the way in which joint 2 turns, so that sign2 = 1; joint 1 enters by squares
    # only.
    return LumpedParameters(
        m2=links[1].mass,
        m3=links[2].mass,
        m4=sum(link.mass for link in links[3:]),
        a2=a2,
        a3=a3,
        d1=float(poses[1].translation[2]),
        l2=com2,
        l3=com3,
        I1y=float(first[2, 2]),
        **dict(zip(("I2x", "I2y", "I2z"), moments2, strict=True)),
        **dict(zip(("I3x", "I3y", "I3z"), moments3, strict=True)),
        sign=(1 if axes[0][2] > 0 else -1, 1, same),
        offset=(0.0, turn2, float((turn3 + np.pi) % (2 * np.pi) - np.pi)),
    )


def _along_link(
    link: pin.Inertia, pose: pin.SE3, direction: Array, axis: Array
) -> tuple[float, tuple[float, ...]]:
    """Distance of the centre of mass along a link, and the moments about it: along the link,
    across, joint axis.
    """
    frame = np.stack([direction, np.cross(axis, direction), axis])
    inertia = frame @ pose.rotation @ link.inertia @ pose.rotation.T @ frame.T
    distance = float(direction @ pose.rotation @ link.lever)
    return distance, tuple(float(moment) for moment in np.diag(inertia))


def build_lumped_arm(arm: ArmModel) -> ArmModel:
    """The lumped model as an `ArmModel` with the names and limits of the arm's first three
    joints.
    """
    p = lumped_parameters(arm)
    half = np.pi / 2
    m34 = p.m3 + p.m4
    com34 = (p.m3 * p.l3 + p.m4 * p.a3) / m34
    # Link 3 and the point mass as one body: parallel axes about the common centre of mass.
    of_elbow = p.m3 * (p.l3 - com34) ** 2
    extra = of_elbow + p.m4 * (p.a3 - com34) ** 2
    links = [
        (1.0, 0.0, (1e-9, 1e-9, p.I1y)),
        (p.m2, p.l2, (p.I2x, p.I2y, p.I2z)),
        (m34, com34, (p.I3x, p.I3y + extra, p.I3z + extra)),
    ]
    # Joint 2's zero is turned within its own plane.
    upright = pin.rpy.rpyToMatrix(np.array((-half, -half, 0.0)))
    turned = upright @ pin.utils.rotate("z", p.offset[1])
    origins = [
        (f"0 0 {p.d1!r}", (0.0, 0.0, p.offset[0])),
        ("0 0 0", tuple(pin.rpy.matrixToRpy(turned))),
        (f"{p.a2!r} 0 0", (0.0, 0.0, p.offset[2])),
    ]
    elements = ['<robot name="' + arm.name + '_lumped">', '  <link name="base"/>']
    pairs = enumerate(zip(links, origins, strict=True))
    for i, ((mass, com, moments), (xyz, rpy)) in pairs:
        ixx, iyy, izz = (repr(float(value)) for value in moments)
        turn = " ".join(repr(float(value)) for value in rpy)
        parent = "base" if i == 0 else f"lumped_{i}"
        elements.append(
            f'  <joint name="{arm.joint_names[i]}" type="revolute"><parent link="{parent}"/>'
            f'<child link="lumped_{i + 1}"/><origin xyz="{xyz}" rpy="{turn}"/>'
            f'<axis xyz="0 0 {p.sign[i]}"/>{_limit_element(arm, i)}'
            f'</joint><link name="lumped_{i + 1}">'
            f'<inertial><origin xyz="{com!r} 0 0"/><mass value="{mass!r}"/>'
            f'<inertia ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"/>'
            "</inertial></link>"
        )
    elements.append("</robot>")
    lumped = ArmModel.from_urdf("\n".join(elements), arm.source)
    return lumped.with_gravity(arm.model.gravity.linear)


def _limit_element(arm: ArmModel, joint: int) -> str:
    """A joint's limits as a URDF writes them."""
    lower = repr(float(arm.lower[joint]))
    upper = repr(float(arm.upper[joint]))
    velocity = repr(float(arm.velocity_limit[joint]))
    effort = repr(float(arm.effort_limit[joint]))
    return f'<limit lower="{lower}" upper="{upper}" velocity="{velocity}" effort="{effort}"/>'
