"""What is planted and no catalogue lists: a diagnosis has to refuse to name it."""

from __future__ import annotations

import numpy as np

from ident.simulation.real.largest_sizes import at_speed, fixed, over_range, up_to
from ident.simulation.real.moved_arm import MovedArm
from ident.simulation.real.planted_friction import neighbour
from ident.simulation.real.planting import Draw, Planted, PlantedChange, at_joint, bristle, decay


def plant_cable(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A cable pulls tight beyond an angle."""
    q = arm.q[:, j]
    start = float(np.quantile(q, draw.uniform(0.5, 0.75)))
    pulled = np.maximum(q - start, 0.0)
    return at_joint(arm, j, size * pulled**2, {"from_rad": start})


def plant_product(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Drag where the neighbour moves fast, too."""
    other = neighbour(arm, j, draw)
    torque = size * arm.v[:, j] * np.abs(arm.v[:, other])
    return at_joint(arm, j, torque, {"other_joint": arm.source.joints[other]})


def plant_seal(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A seal winds up with the shaft and relaxes."""
    relaxation = float(draw.uniform(0.2, 1.0))
    speed = np.where(np.isfinite(arm.steps), arm.v[:, j], 0.0)
    torque = size * decay(arm, speed, relaxation)
    return at_joint(arm, j, torque, {"relaxation_s": relaxation})


def plant_brake(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The holding brake lets go slowly at the start of each run."""
    fading = float(draw.uniform(1.0, 3.0))
    holding = np.zeros(len(arm.t))
    for rows in arm.given:
        since = arm.t[rows] - arm.t[rows.start]
        holding[rows] = np.exp(-since / fading)
    torque = size * holding * bristle(arm, arm.v[:, j])
    return at_joint(arm, j, torque, {"decay_s": fading})


def plant_sag(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The supply sags under the power of all drives, and with it the scale of one reading."""
    power = np.abs(arm.load * arm.v).sum(axis=1)
    share = power / max(float(np.quantile(power, 0.99)), 1e-9)
    return at_joint(arm, j, size * share * arm.tau[:, j], {"largest_rise": size})


def plant_floor(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """The floor shakes the arm at a steady pace."""
    pace = float(draw.uniform(0.8, 4.0))
    torque = size * np.sin(2.0 * np.pi * pace * arm.t)
    return at_joint(arm, j, torque, {"frequency_Hz": pace})


def plant_tooth(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Friction of sliding teeth, of a size [N m], turns round at every pitch point."""
    usual = float(np.quantile(np.abs(arm.v[:, j]), 0.6)) + 1e-3
    frequency = draw.uniform(0.8, 3.0)
    order = float(np.clip(round(2.0 * np.pi * frequency / usual), 4, 80))
    wave = np.tanh(4.0 * np.sin(order * arm.q[:, j]))
    friction = size * np.abs(arm.load[:, j])
    torque = friction * wave * bristle(arm, arm.v[:, j])
    return at_joint(arm, j, torque, {"teeth": order})


def plant_ageing(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that starts high after each reversal and wears off with travel."""
    travel = float(draw.uniform(0.03, 0.2))
    v = arm.v[:, j]
    torque = size * (bristle(arm, v) - bristle(arm, v, travel))
    return at_joint(arm, j, torque, {"travel_rad": travel})


def plant_step(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Dry friction that is larger from a time on: a brake that rubs, grease that has gone."""
    start = float(np.quantile(arm.t, draw.uniform(0.3, 0.7)))
    torque = size * (arm.t >= start) * bristle(arm, arm.v[:, j])
    return at_joint(arm, j, torque, {"from_s": start})


OUTSIDE: dict[str, Planted] = {
    "cable_at_the_end": Planted(plant_cable, over_range(30.0)),
    "velocity_product_drag": Planted(plant_product, at_speed(5.0), neighbours=True),
    "seal_relaxation": Planted(plant_seal, over_range(20.0)),
    "brake_release": Planted(plant_brake, up_to(1.0), local=True),
    "supply_sag": Planted(plant_sag, fixed(0.6)),
    "floor_vibration": Planted(plant_floor, up_to(0.6)),
    "tooth_friction": Planted(plant_tooth, fixed(0.5)),
    "friction_step": Planted(plant_step, up_to(0.8)),
    "wearing_off_after_reversal": Planted(plant_ageing, up_to(0.8)),
}
"""Laws that no catalogue lists."""
