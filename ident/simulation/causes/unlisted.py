"""Causes outside the catalogue: a diagnosis must say *none of these*, not name the nearest."""

from __future__ import annotations

import numpy as np

from ident.simulation.causes.arm import reach
from ident.simulation.causes.base import Cause, Circumstances, Parameters, between, log_uniform, setting, uniform
from ident.simulation.hardware import Hardware, Slosh


def _stall(scene: Circumstances) -> tuple[float, float]:
    return 0.0, 0.33 * scene.rated


def _cable(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A cable bears on the joint where the neighbour's angle leads it."""
    centre, width = float(scene.rng.uniform(-0.5, 0.5)), float(scene.rng.uniform(0.3, 0.7))
    share = float(scene.rng.choice([-1.0, 1.0]) * scene.rng.uniform(0.5, 1.0))
    other = scene.neighbour
    hardware = scene.with_laws(
        "outside", cable=size, cable_other=other, cable_share=share, cable_centre=centre, cable_width=width
    )
    truth = {"drag_Nm": size, "centre_rad": centre, "half_width_rad": width, "share": share}
    return hardware, {**truth, "other_joint": scene.hardware.arm.joint_names[other]}


def _product(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """Drag on the joint that grows with the neighbour's speed."""
    other = scene.neighbour
    hardware = scene.with_laws("outside", product=size, product_other=other)
    return hardware, {"drag_Nms2_rad2": size, "other_joint": scene.hardware.arm.joint_names[other]}


def _slosh(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A vessel at the flange, half of its contents moving."""
    h = scene.hardware
    frequency = float(scene.rng.uniform(1.2, 3.0))
    place = (0.0, 0.0, 0.06 * reach(h))
    bodies = h.bodies.replace(slosh=Slosh(size, place, frequency))
    return h.replace(bodies=bodies), {"moving_mass_kg": size, "frequency_Hz": frequency}


def _slosh_bounds(scene: Circumstances) -> tuple[float, float]:
    h = scene.hardware
    return 1e-4, float(h.drive.effort_limit.max()) / (9.81 * reach(h))


def _sag(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The supply sags under the power of all drives, and with it the scale of one drive's current reading."""
    h = scene.hardware
    speed = np.minimum(0.3 * np.array(h.arm.velocity_limit), 1.0)
    power = float((h.friction.coulomb * speed).sum() + 0.2 * (h.drive.effort_limit * speed).sum())
    sensing = h.sensing.set(scene.joint, sag=size).replace(sag_power=power)
    return h.replace(sensing=sensing), {"relative_rise": size, "at_power_W": power}


def _wobble(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """A strain-wave gear's kinematic error shakes the link, hardest where it meets the drive's resonance."""
    h, j = scene.hardware, scene.joint
    order = float(h.drive.ripple_order[j])
    resonance = float(2.0 * np.pi * scene.rng.uniform(6.0, 14.0))
    hardware = h.with_laws(
        "outside",
        j,
        wobble=size,
        wobble_order=order,
        wobble_inertia=h.drive.rotor_inertia[j],
        wobble_resonance=resonance,
    )
    return hardware, {"error_rad": size, "order": order, "resonance_Hz": resonance / (2.0 * np.pi)}


# The bearing's balls skid while the joint accelerates: more dry friction.
SKID = setting("friction", "skid", "friction_Nm", skid_scale=("acceleration_rad_s2", uniform(1.0, 3.0)))
# The holding brake lets go slowly at the start of each run.
BRAKE = setting("outside", "brake", "drag_Nm", brake_decay=("decay_s", uniform(0.5, 2.0)))
# A seal winds up with the shaft and relaxes: a spring when quick, viscous when slow.
SEAL = setting("outside", "seal", "stiffness_Nm_rad", seal_relaxation=("relaxation_s", log_uniform(0.1, 0.8)))
# The contact strengthens while it rests, and is renewed by slip.
AGEING = setting("outside", "ageing", "friction_per_efold_Nm", ageing_slip=("slip_rad", log_uniform(3e-3, 3e-2)))
# Planetary or worm teeth slide inwards, then outwards: their friction turns round at every pitch point.
TOOTH = setting("outside", "tooth", "mu", tooth_order=("teeth", lambda rng: float(rng.integers(12, 40))))
UNLISTED = (
    Cause("cable_drag", "drag_Nm", lambda s: 0.4 * s.coulomb, _stall, _cable),
    Cause("velocity_product_drag", "drag_Nms2_rad2", lambda s: 1.2 * s.coulomb, lambda s: (0.0, s.rated), _product),
    Cause(
        "sloshing_load", "moving_mass_kg", lambda s: 0.08 * _slosh_bounds(s)[1], _slosh_bounds, _slosh, whole_arm=True
    ),
    Cause("acceleration_friction", "friction_Nm", lambda s: 0.5 * s.coulomb, _stall, SKID),
    Cause("brake_drag", "drag_Nm", lambda s: 0.8 * s.coulomb, _stall, BRAKE),
    Cause(
        "seal_relaxation",
        "stiffness_Nm_rad",
        lambda s: 3.0 * s.coulomb,
        lambda s: (0.0, 3.0 * s.rated),
        SEAL,
    ),
    Cause("contact_ageing", "friction_per_efold_Nm", lambda s: 0.1 * s.coulomb, lambda s: (0.0, 0.1 * s.rated), AGEING),
    Cause("tooth_friction", "mu", lambda s: 0.05, between(0.0, 0.6), TOOTH),
    Cause("kinematic_error", "error_rad", lambda s: 2e-4, between(0.0, 0.02), _wobble),
    Cause("supply_sag", "relative_rise", lambda s: 0.1, between(0.0, 2.0), _sag),
)
