"""Causes outside the catalogue: a diagnosis must say *none of these*, not name the nearest."""

from __future__ import annotations

import numpy as np

from ident.simulation.causes.base import Circumstances, Parameters, acts_as
from ident.simulation.hardware import Hardware, Slosh


@acts_as("cable_drag")
def _cable(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    centre, width = float(scene.rng.uniform(-0.5, 0.5)), float(scene.rng.uniform(0.3, 0.7))
    share = float(scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.5, 1.0))
    band = {"cable_share": share, "cable_centre": centre, "cable_width": width}
    hardware = scene.with_laws("outside", cable=size, cable_other=scene.neighbour, **band)
    truth = {"drag_Nm": size, "centre_rad": centre, "half_width_rad": width, "share": share}
    return hardware, {**truth, "other_joint": scene.hardware.arm.joint_names[scene.neighbour]}


@acts_as("velocity_product_drag")
def _product(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    other = scene.neighbour
    hardware = scene.with_laws("outside", product=size, product_other=other)
    return hardware, {"drag_Nms2_rad2": size, "other_joint": scene.hardware.arm.joint_names[other]}


@acts_as("sloshing_load")
def _slosh(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    frequency = float(scene.rng.uniform(1.2, 3.0))
    slosh = Slosh(size, (0.0, 0.0, 0.06 * scene.reach), frequency)
    hardware = scene.hardware.replace(bodies=scene.hardware.bodies.replace(slosh=slosh))
    return hardware, {"moving_mass_kg": size, "frequency_Hz": frequency}


@acts_as("supply_sag")
def _sag(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    h = scene.hardware
    speed = np.minimum(0.3 * np.array(h.arm.velocity_limit), 1.0)
    power = float((h.friction.coulomb * speed).sum() + 0.2 * (h.drive.effort_limit * speed).sum())
    sensing = h.sensing.set(scene.joint, sag=size).replace(sag_power=power)
    return h.replace(sensing=sensing), {"relative_rise": size, "at_power_W": power}


@acts_as("kinematic_error")
def _wobble(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A strain-wave gear's kinematic error shakes the link, hardest where it meets the drive's resonance."""
    drive, j = scene.hardware.drive, scene.joint
    order, resonance = float(drive.ripple_order[j]), float(2.0 * np.pi * scene.rng.uniform(6.0, 14.0))
    shaken = {"wobble_order": order, "wobble_inertia": drive.rotor_inertia[j], "wobble_resonance": resonance}
    hardware = scene.with_laws("outside", wobble=size, **shaken)
    return hardware, {"error_rad": size, "order": order, "resonance_Hz": resonance / (2.0 * np.pi)}
