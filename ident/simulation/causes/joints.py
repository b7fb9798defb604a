"""Causes at one joint: elasticity, play, tooth ripple, dress pack, and friction beyond Coulomb's and Newton's laws."""

from __future__ import annotations

import numpy as np

from ident.simulation.causes.base import Cause, Circumstances, Parameters, between, log_uniform, setting, uniform
from ident.simulation.hardware import Hardware
from ident.simulation.laws import heat_law

# Stiffness of the meshing teeth per rated torque, behind which the play lies [1/rad]: that of strain-wave gears under
# load. Source: K3 and rated torques of the CSG series, Harmonic Drive SE, engineering data.
MESH_STIFFNESS = 600.0
# A gear with more play than this is broken [rad].
LARGEST_PLAY = 0.03
# Share of critical damping of the drive's own oscillation.
DRIVE_DAMPING = 0.05


def _damping(scene: Circumstances, stiffness: float, ratio: float) -> float:
    return float(2.0 * ratio * np.sqrt(stiffness * scene.hardware.drive.rotor_inertia[scene.joint]))


def _elasticity(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    damping = _damping(scene, size, DRIVE_DAMPING)
    hardware = scene.with_laws("drive", elastic=True, stiffness=size, damping=damping)
    return hardware, {"stiffness_Nm_rad": size, "damping_Nms_rad": damping}


def _backlash(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    stiffness = MESH_STIFFNESS * scene.rated
    damping = _damping(scene, stiffness, 2.0 * DRIVE_DAMPING)
    hardware = scene.with_laws("drive", elastic=True, stiffness=stiffness, damping=damping, gap=size)
    return hardware, {"gap_rad": size, "mesh_stiffness_Nm_rad": stiffness}


def _tight_gear(scene: Circumstances) -> Hardware:
    return _backlash(scene, 0.0)[0]


def _ripple(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    phase = float(scene.rng.uniform(-np.pi, np.pi))
    hardware = scene.with_laws("drive", ripple=size, ripple_phase=phase, ripple_load=0.5)
    order = float(scene.hardware.drive.ripple_order[scene.joint])
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


def _stiffness_bounds(scene: Circumstances) -> tuple[float, float]:
    """Softer, and the joint would sag by a fifth of a radian under its rated torque; stiffer is rigid."""
    return 5.0 * scene.rated, 1000.0 * scene.rated


SPRING = setting("drive", "hose_stiffness", "stiffness_Nm_rad", hose_rest=("rest_rad", uniform(-0.8, 0.8)))
STRIBECK = setting(
    "friction",
    "stribeck",
    "amplitude_Nm",
    stribeck_velocity=("stribeck_velocity_rad_s", log_uniform(0.03, 0.15)),
    stribeck_exponent=("exponent", uniform(0.9, 2.0)),
)
DRIVE = (
    Cause(
        "joint_elasticity", "stiffness_Nm_rad", lambda s: 150.0 * s.rated, _stiffness_bounds, _elasticity, inverse=True
    ),
    Cause("backlash", "gap_rad", lambda s: 5e-4, between(0.0, LARGEST_PLAY), _backlash, beside=_tight_gear),
    Cause("torque_ripple", "amplitude_Nm", lambda s: 0.01 * s.rated, lambda s: (0.0, 0.15 * s.rated), _ripple),
    Cause("spring_torque", "stiffness_Nm_rad", lambda s: 0.02 * s.rated, lambda s: (0.0, 0.3 * s.rated), SPRING),
)


# Rise of the lubricant at steady rated work, to which thermal changes refer [K].
RATED_RISE_K = 25.0
# Share of the transmitted torque that a joint's gear may lose: strain-wave and planetary gears lose less.
LARGEST_LOSS = 0.25


def _up_to(scene: Circumstances) -> tuple[float, float]:
    """Dry friction beyond a third of the rated torque would stall the joint."""
    return 0.0, 0.33 * scene.rated


def _either_way(scene: Circumstances) -> tuple[float, float]:
    """A difference between directions can't exceed twice the friction itself."""
    return -1.8 * scene.coulomb, 1.8 * scene.coulomb


def _nonlinear_viscous(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    velocity = float(scene.rng.uniform(0.05, 0.3))
    hardware = scene.with_laws("friction", eyring=size, eyring_velocity=velocity)
    # Nearest power law over 0.1 to 2 rad/s, the form in which it is reported.
    v = np.geomspace(0.1, 2.0, 60)
    exponent, log_coefficient = np.polyfit(np.log(v), np.log(np.arcsinh(v / velocity)), 1)
    nearest = {"coefficient": float(size * np.exp(log_coefficient)), "exponent": float(exponent)}
    return hardware, {"eyring_Nm": size, "eyring_velocity_rad_s": velocity, **nearest}


def _thermal(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's own heat network; its lubricant loses a share of its viscosity at the rated rise."""
    h, j = scene.hardware, scene.joint
    time_constant = float(np.exp(scene.rng.uniform(np.log(40.0), np.log(240.0))))
    loss = h.friction.coulomb * 0.6 + h.friction.viscous * 0.36
    network = heat_law(loss, RATED_RISE_K, time_constant)
    heat = {name: getattr(network, name)[j] for name in ("lubricant", "housing", "inner", "outer")}
    decay = -np.log1p(-size) / RATED_RISE_K
    dry = 0.25 * decay  # dry friction depends far less on temperature
    hardware = h.with_laws("heat", j, **heat).with_laws("friction", j, thermal_viscous=decay, thermal_coulomb=dry)
    changes = {"viscous_change": -size, "coulomb_change": float(np.expm1(-dry * RATED_RISE_K))}
    return hardware, {**changes, "time_constant_s": time_constant}


def _hysteresis(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    displacement = float(np.exp(scene.rng.uniform(np.log(2e-3), np.log(3e-2))))
    hardware = scene.with_laws("friction", soft=size, soft_stiffness=size / displacement)
    return hardware, {"amplitude_Nm": size, "displacement_rad": displacement}


def _position(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    order, phase = int(scene.rng.integers(1, 3)), float(scene.rng.uniform(-np.pi, np.pi))
    hardware = scene.with_laws("friction", seat=size / scene.coulomb, seat_order=order, seat_phase=phase)
    return hardware, {"amplitude_Nm": size, "order": order, "phase_rad": phase}


def _asymmetric(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    viscous = float(scene.rng.uniform(0.3, 0.8) * size / scene.coulomb * scene.hardware.friction.viscous[scene.joint])
    hardware = scene.with_laws("friction", coulomb_skew=size, viscous_skew=viscous)
    return hardware, {"coulomb_difference_Nm": size, "viscous_difference_Nms_rad": viscous}


def _coupling(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    """The joint's motor is also turned by its neighbour: friction and rotor of the combined motion."""
    h, j, other = scene.hardware, scene.joint, scene.neighbour
    ratio = float(scene.rng.choice([-1.0, 1.0]))
    viscous = float(0.4 * size * h.friction.viscous[j] / h.friction.coulomb[j])
    inertia = float(0.1 * size * h.drive.rotor_inertia[j] / h.friction.coulomb[j])
    hardware = h.with_laws(
        "friction", j, couple_to=other, couple_ratio=ratio, couple_coulomb=size, couple_viscous=viscous
    )
    names = h.arm.joint_names
    tied = (*h.bodies.tied, (names[j], names[other], ratio, inertia))
    truth = {"coulomb_Nm": size, "viscous_Nms_rad": viscous, "inertia_kgm2": inertia}
    hardware = hardware.replace(bodies=h.bodies.replace(tied=tied))
    return hardware, {**truth, "ratio": ratio, "other_joint": names[other]}


RUBBING = (
    Cause("stribeck_friction", "amplitude_Nm", lambda s: 0.3 * s.coulomb, _up_to, STRIBECK),
    Cause("nonlinear_viscous_friction", "eyring_Nm", lambda s: 0.25 * s.coulomb, _up_to, _nonlinear_viscous),
    Cause(
        "load_dependent_friction", "mu", lambda s: 0.06, between(0.0, LARGEST_LOSS), setting("friction", "load", "mu")
    ),
    Cause("thermal_friction", "viscous_loss", lambda s: 0.45, between(0.0, 0.95), _thermal, needs_all=True),
    Cause("presliding_hysteresis", "amplitude_Nm", lambda s: 0.3 * s.coulomb, _up_to, _hysteresis),
    Cause(
        "position_dependent_friction",
        "amplitude_Nm",
        lambda s: 0.12 * s.coulomb,
        lambda s: (0.0, 0.9 * s.coulomb),
        _position,
    ),
    Cause("asymmetric_friction", "coulomb_difference_Nm", lambda s: 0.2 * s.coulomb, _either_way, _asymmetric),
    Cause("joint_coupling", "coulomb_Nm", lambda s: 0.4 * s.coulomb, _up_to, _coupling),
)
