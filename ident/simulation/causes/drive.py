"""Between motor and link: elasticity, play, tooth ripple, and the dress pack."""

from __future__ import annotations

import numpy as np

from ident.simulation.causes.base import Cause, Circumstances, Parameters, between
from ident.simulation.hardware import Hardware

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


def _spring(scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
    rest = float(scene.rng.uniform(-0.8, 0.8))
    hardware = scene.with_laws("drive", hose_stiffness=size, hose_rest=rest)
    return hardware, {"stiffness_Nm_rad": size, "rest_rad": rest}


def _stiffness_bounds(scene: Circumstances) -> tuple[float, float]:
    """Softer, and the joint would sag by a fifth of a radian under its rated torque; stiffer is rigid."""
    return 5.0 * scene.rated, 1000.0 * scene.rated


DRIVE = (
    Cause(
        "joint_elasticity", "stiffness_Nm_rad", lambda s: 150.0 * s.rated, _stiffness_bounds, _elasticity, inverse=True
    ),
    Cause("backlash", "gap_rad", lambda s: 5e-4, between(0.0, LARGEST_PLAY), _backlash, beside=_tight_gear),
    Cause("torque_ripple", "amplitude_Nm", lambda s: 0.01 * s.rated, lambda s: (0.0, 0.15 * s.rated), _ripple),
    Cause("spring_torque", "stiffness_Nm_rad", lambda s: 0.02 * s.rated, lambda s: (0.0, 0.3 * s.rated), _spring),
)
