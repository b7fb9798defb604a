"""Friction that is planted: by speed, load, warmth, travel, place, direction, or of two joints."""

from __future__ import annotations

import numpy as np

from ident.simulation.real.moved_arm import MovedArm
from ident.simulation.real.planting import Draw, Parameters, PlantedChange, at_joint, bristle, decay


def plant_stribeck(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction that falls as motion sets in, by so much at rest [N m]."""
    speed = float(np.exp(draw.uniform(np.log(0.02), np.log(0.15))))
    exponent = float(draw.uniform(0.9, 2.0))
    v = arm.v[:, j]
    level = size * np.exp(-(np.abs(v / speed) ** exponent))
    truth: Parameters = {
        "amplitude_Nm": size,
        "stribeck_velocity_rad_s": speed,
        "exponent": exponent,
    }
    return at_joint(arm, j, level * bristle(arm, v), truth)


def plant_curved(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A power of the speed, or the lubricant's own law (Eyring), which has no such parameters."""
    v = arm.v[:, j]
    exponent = float(draw.uniform(0.3, 0.8))
    if draw.random() < 0.5:
        knee = float(draw.uniform(0.03, 0.2))
        return at_joint(arm, j, size * np.arcsinh(v / knee), {"eyring_Nm": size})
    torque = size * np.abs(v) ** exponent * bristle(arm, v)
    return at_joint(arm, j, torque, {"coefficient": size, "exponent": exponent})


def plant_load(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that grows with the load, by a share of it [1]."""
    torque = size * np.abs(arm.load[:, j]) * bristle(arm, arm.v[:, j])
    return at_joint(arm, j, torque, {"mu": size})


def plant_thermal(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction warms the gear; viscous friction falls by `size` from the coldest to the warmest
    moment.
    """
    constant = float(np.exp(draw.uniform(np.log(30.0), np.log(200.0))))
    dry = float(draw.uniform(0.1, 0.4))
    v = arm.v[:, j]
    turn = bristle(arm, v)
    friction = arm.coulomb[j] * turn + arm.viscous[j] * v
    warmth = decay(arm, np.maximum(friction * v, 0.0), constant)
    shown = np.concatenate([warmth[rows] for rows in arm.given])
    coldest = shown[0]
    span = max(float(shown.max() - coldest), 1e-9)
    share = np.clip((warmth - coldest) / span, 0.0, 1.0)
    torque = -size * share * (arm.viscous[j] * v + dry * arm.coulomb[j] * turn)
    truth: Parameters = {
        "viscous_change": -size,
        "coulomb_change": -dry * size,
        "time_constant_s": constant,
    }
    return at_joint(arm, j, torque, truth)


def plant_hysteresis(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction of a size [N m] that builds up over a travel drawn by chance."""
    travel = float(np.exp(draw.uniform(np.log(2e-3), np.log(3e-2))))
    q = arm.q[:, j]
    within_run = np.isfinite(arm.steps)
    dt = np.where(within_run, arm.steps, 1.0)
    speed = np.where(within_run, np.diff(q, prepend=q[0]), 0.0) / dt
    truth: Parameters = {"amplitude_Nm": size, "displacement_rad": travel}
    return at_joint(arm, j, size * bristle(arm, speed, travel), truth)


def plant_seat(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that waves by a size [N m] once or twice a turn."""
    order = int(draw.integers(1, 3))
    phase = float(draw.uniform(-np.pi, np.pi))
    level = size * np.cos(order * arm.q[:, j] - phase)
    truth: Parameters = {"amplitude_Nm": size, "order": order, "phase_rad": phase}
    return at_joint(arm, j, level * bristle(arm, arm.v[:, j]), truth)


def plant_asymmetric(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """More friction in one direction: `size` of viscous friction, and some dry."""
    way = float(draw.choice([-1.0, 1.0]))
    dry = float(draw.uniform(0.2, 0.6))
    v = arm.v[:, j]
    ahead = way * v > 0.0
    extra = dry * size * arm.coulomb[j] / arm.viscous[j]
    torque = np.where(ahead, size * v + extra * bristle(arm, v), 0.0)
    truth: Parameters = {
        "coulomb_difference_Nm": way * extra,
        "viscous_difference_Nms_rad": way * size,
    }
    return at_joint(arm, j, torque, truth)


def plant_coupling(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The motor is also turned by its neighbour: friction and rotor of both; drag counts by the
    neighbour's motion.
    """
    other = neighbour(arm, j, draw)
    way = float(draw.choice([-1.0, 1.0]))
    speed = arm.v[:, j] + way * arm.v[:, other]
    viscous = 0.4 * size * arm.viscous[j] / arm.coulomb[j]
    inertia = 0.002 * size
    turned = inertia * (arm.a[:, j] + way * arm.a[:, other])
    torque = size * bristle(arm, speed) + viscous * speed + turned
    truth: Parameters = {
        "coulomb_Nm": size,
        "viscous_Nms_rad": way * viscous,
        "other_joint": arm.source.joints[other],
    }
    return at_joint(arm, j, torque, truth)


def neighbour(arm: MovedArm, j: int, draw: Draw) -> int:
    """The joint before or after one, by chance."""
    beside = [k for k in (j - 1, j + 1) if 0 <= k < arm.n]
    return int(draw.choice(beside))
