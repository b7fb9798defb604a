"""Gears that are planted: they twist, have play, ripple; and a spring beside one."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array
from ident.simulation.real.moved_arm import MovedArm, rigid_torque, twist_of
from ident.simulation.real.planting import Draw, Parameters, PlantedChange, at_joint


def _turned(
    arm: MovedArm, j: int, states: tuple[Array, Array, Array], parameters: Parameters
) -> PlantedChange:
    """The link stands a twist behind the motor, whose encoder is read: the bodies' torque is that
    of the link.
    """
    q = arm.q.copy()
    v = arm.v.copy()
    a = arm.a.copy()
    for channel, twist in zip((q, v, a), states, strict=True):
        channel[:, j] -= twist
    return PlantedChange(parameters, rigid_torque(arm.model, q, v, a) - arm.rigid)


def plant_elasticity(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A gear that twists by so much under a torque [rad/(N m)], little damped."""
    stiffness = 1.0 / size
    ratio = float(draw.uniform(0.03, 0.15))
    states, damping = twist_of(arm, j, stiffness, ratio)
    truth: Parameters = {"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping}
    return _turned(arm, j, states, truth)


def plant_backlash(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Play of a gear beside one that only twists: that twist is no play."""
    stiffness = 400.0 * float(arm.peak[j])
    with_play, _ = twist_of(arm, j, stiffness, 0.3, size)
    without, _ = twist_of(arm, j, stiffness, 0.3, 0.0)
    loose = _turned(arm, j, with_play, {}).torque
    tight = _turned(arm, j, without, {}).torque
    return PlantedChange({"gap_rad": size}, loose - tight)


def plant_ripple(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Teeth that pass 1.5 to 5 times a second at the joint's usual speed."""
    usual = float(np.quantile(np.abs(arm.v[:, j]), 0.6)) + 1e-3
    frequency = draw.uniform(1.5, 5.0)
    order = float(np.clip(round(2.0 * np.pi * frequency / usual), 5, 160))
    phase = float(draw.uniform(-np.pi, np.pi))
    truth: Parameters = {"amplitude_Nm": size, "order": order, "phase_rad": phase}
    torque = size * np.cos(order * arm.q[:, j] - phase)
    return at_joint(arm, j, torque, truth)


def plant_spring(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A spring of a stiffness [N m/rad], at rest at an angle within the motion."""
    low, high = np.quantile(arm.q[:, j], [0.05, 0.95])
    rest = float(draw.uniform(low, high))
    truth: Parameters = {"stiffness_Nm_rad": size, "rest_rad": rest}
    return at_joint(arm, j, size * (arm.q[:, j] - rest), truth)
