"""Causes at one joint: elasticity, play, tooth ripple, and friction beyond Coulomb's and Newton's laws."""

from __future__ import annotations

import numpy as np

from ident.simulation.causes.base import Circumstances, Parameters, acts_as
from ident.simulation.hardware import Hardware
from ident.simulation.laws import heat_law

# Stiffness of the meshing teeth per rated torque, behind which the play lies [1/rad]: that of strain-wave gears under
# load. Source: K3 and rated torques of the CSG series, Harmonic Drive SE, engineering data.
MESH_STIFFNESS = 600.0
# Share of critical damping of the drive's own oscillation.
DRIVE_DAMPING = 0.05
# Rise of the lubricant at steady rated work, to which thermal changes refer [K].
RATED_RISE_K = 25.0


def _sprung(scene: Circumstances, stiffness: float, ratio: float, **more: float) -> tuple[Hardware, float]:
    """The hardware with motor and link as two bodies, and the spring's damping [N m s/rad]."""
    damping = float(2.0 * ratio * np.sqrt(stiffness * scene.hardware.drive.rotor_inertia[scene.joint]))
    return scene.with_laws("drive", elastic=True, stiffness=stiffness, damping=damping, **more), damping


@acts_as("joint_elasticity")
def _elasticity(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    hardware, damping = _sprung(scene, size, DRIVE_DAMPING)
    return hardware, {"stiffness_Nm_rad": size, "damping_Nms_rad": damping}


@acts_as("backlash")
def _backlash(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    stiffness = MESH_STIFFNESS * scene.rated
    hardware, _ = _sprung(scene, stiffness, 2.0 * DRIVE_DAMPING, gap=size)
    return hardware, {"gap_rad": size, "mesh_stiffness_Nm_rad": stiffness}


@acts_as("torque_ripple")
def _ripple(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    phase = float(scene.rng.uniform(-np.pi, np.pi))
    order = float(scene.hardware.drive.ripple_order[scene.joint])
    hardware = scene.with_laws("drive", ripple=size, ripple_phase=phase, ripple_load=0.5)
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


@acts_as("nonlinear_viscous_friction")
def _nonlinear_viscous(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    velocity = float(scene.rng.uniform(0.05, 0.3))
    # Nearest power law over 0.1 to 2 rad/s, the form in which it is reported.
    v = np.geomspace(0.1, 2.0, 60)
    exponent, log_coefficient = np.polyfit(np.log(v), np.log(np.arcsinh(v / velocity)), 1)
    nearest = {"coefficient": float(size * np.exp(log_coefficient)), "exponent": float(exponent)}
    hardware = scene.with_laws("friction", eyring=size, eyring_velocity=velocity)
    return hardware, {"eyring_Nm": size, "eyring_velocity_rad_s": velocity, **nearest}


@acts_as("thermal_friction")
def _thermal(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's own heat network; its lubricant loses a share of its viscosity at the rated rise."""
    h, j = scene.hardware, scene.joint
    time_constant = float(np.exp(scene.rng.uniform(np.log(40.0), np.log(240.0))))
    loss = h.friction.coulomb * 0.6 + h.friction.viscous * 0.36
    network = heat_law(loss, RATED_RISE_K, time_constant)
    heat = {name: network[name][j] for name in ("lubricant", "housing", "inner", "outer")}
    decay = -np.log1p(-size) / RATED_RISE_K
    dry = 0.25 * decay  # dry friction depends far less on temperature
    hardware = h.with_laws("heat", j, **heat).with_laws("friction", j, thermal_viscous=decay, thermal_coulomb=dry)
    changes = {"viscous_change": -size, "coulomb_change": float(np.expm1(-dry * RATED_RISE_K))}
    return hardware, {**changes, "time_constant_s": time_constant}


@acts_as("presliding_hysteresis")
def _hysteresis(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    displacement = float(np.exp(scene.rng.uniform(np.log(2e-3), np.log(3e-2))))
    hardware = scene.with_laws("friction", soft=size, soft_stiffness=size / displacement)
    return hardware, {"amplitude_Nm": size, "displacement_rad": displacement}


@acts_as("position_dependent_friction")
def _position(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    order, phase = int(scene.rng.integers(1, 3)), float(scene.rng.uniform(-np.pi, np.pi))
    hardware = scene.with_laws("friction", seat=size / scene.coulomb, seat_order=order, seat_phase=phase)
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


@acts_as("asymmetric_friction")
def _asymmetric(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    viscous = float(scene.rng.uniform(0.3, 0.8) * size / scene.coulomb * scene.hardware.friction.viscous[scene.joint])
    hardware = scene.with_laws("friction", coulomb_skew=size, viscous_skew=viscous)
    return hardware, {"coulomb_difference_Nm": size, "viscous_difference_Nms_rad": viscous}


@acts_as("joint_coupling")
def _coupling(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's motor is also turned by its neighbour: friction and rotor of the combined motion."""
    h, j, other = scene.hardware, scene.joint, scene.neighbour
    ratio = float(scene.rng.choice([-1.0, 1.0]))
    viscous = float(0.4 * size * h.friction.viscous[j] / h.friction.coulomb[j])
    inertia = float(0.1 * size * h.drive.rotor_inertia[j] / h.friction.coulomb[j])
    rubbing = {"couple_ratio": ratio, "couple_coulomb": size, "couple_viscous": viscous}
    names = h.arm.joint_names
    bodies = h.bodies.replace(tied=(*h.bodies.tied, (names[j], names[other], ratio, inertia)))
    truth = {"coulomb_Nm": size, "viscous_Nms_rad": viscous, "inertia_kgm2": inertia}
    hardware = scene.with_laws("friction", couple_to=other, **rubbing).replace(bodies=bodies)
    return hardware, {**truth, "ratio": ratio, "other_joint": names[other]}
