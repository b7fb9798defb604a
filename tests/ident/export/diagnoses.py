"""Diagnoses written by hand: what `ident diagnose --json` would say of an arm with known losses and effects."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ident.diagnosis.baseline_record import LINK_KEYS
from ident.effects.catalogue import find_effect
from ident.robot.arm import ArmModel
from tests.ident.effects.smooth_motion import COULOMB, VISCOUS

ROTOR = np.array([1.2, 1.2, 0.8, 0.15, 0.15, 0.15])
# What an arm's effects would be reported with.
FIGURES: dict[str, dict[str, float]] = {
    "stribeck_friction": {"amplitude_Nm": 4.0, "stribeck_velocity_rad_s": 0.5, "exponent": 2.0},
    "nonlinear_viscous_friction": {"coefficient": 3.0, "exponent": 2.0},
    "load_dependent_friction": {"mu": 0.08},
    "thermal_friction": {"viscous_change": -0.4, "coulomb_change": 0.1, "time_constant_s": 120.0},
    "presliding_hysteresis": {"amplitude_Nm": 3.0, "displacement_rad": 0.004},
    "position_dependent_friction": {"amplitude_Nm": 1.5, "order": 2.0, "phase_rad": 0.7},
    "asymmetric_friction": {"coulomb_difference_Nm": 1.2, "viscous_difference_Nms_rad": 0.8},
    "joint_coupling": {"viscous_Nms_rad": 1.0, "coulomb_Nm": 2.0, "inertia_kgm2": 0.1, "other_joint": 1.0},
    "joint_elasticity": {"stiffness_Nm_rad": 1.5e4, "damping_Nms_rad": 40.0},
    "backlash": {"gap_rad": 1e-3},
    "torque_ripple": {"amplitude_Nm": 1.0, "order": 2.0, "phase_rad": -0.4},
    "spring_torque": {"stiffness_Nm_rad": 6.0, "rest_rad": 0.3},
    "payload": {"mass_kg": 1.5, "com_x_m": 0.02, "com_y_m": -0.01, "com_z_m": 0.06},
    "link_inertial_error": {
        "mass_change_kg": 0.6,
        "moment_change_x_kgm": 0.12,
        "moment_change_y_kgm": 0.02,
        "moment_change_z_kgm": -0.05,
    },
    "gravity_misalignment": {"tilt_x_rad": 0.02, "tilt_y_rad": -0.03},
    "torque_gain_error": {"gain": 0.06},
    "torque_offset": {"offset_Nm": 1.1, "drift_Nm_s": 0.0},
    "torque_delay": {"delay_s": 0.011},
    "torque_saturation": {"limit_Nm": 60.0},
    "encoder_offset": {"offset_rad": 0.02},
    "external_contact": {"start_s": 1.0, "end_s": 2.0, "force_N": 20.0, "link": 6.0},
}


def baseline(arm: ArmModel) -> dict[str, Any]:
    """Known losses; the URDF's own inertias."""
    return {
        joint: {
            "motor_inertia_kgm2": float(ROTOR[j % 6]),
            "viscous_Nms_rad": float(VISCOUS[j % 6]),
            "coulomb_Nm": float(COULOMB[j % 6]),
            "transition_rad_s": 0.01,
            "link_change": dict.fromkeys(LINK_KEYS, 0.0),
        }
        for j, joint in enumerate(arm.joint_names)
    }


def finding(arm: ArmModel, effect: str, joint: int = 1) -> dict[str, Any]:
    """An effect as a diagnosis names it."""
    figures = {
        name: {"value": v, "low": v - 0.1 * abs(v), "high": v + 0.1 * abs(v)} for name, v in FIGURES[effect].items()
    }
    joints = arm.joint_names if find_effect(effect).scope == "arm" else (arm.joint_names[joint],)
    return {"effect": effect, "joints": list(joints), "parameters": figures}


def write_diagnosis(path: Path, arm: ArmModel, *effects: str, joint: int = 1, **changes: Any) -> Path:
    """A diagnosis file."""
    record = {
        "schema": "ident.diagnosis/1",
        "robot": arm.name,
        "joints": list(arm.joint_names),
        "verdict": "named",
        "findings": [finding(arm, effect, joint) for effect in effects],
        **{key: baseline(arm) for key in ("baseline", "baseline_alone", "baseline_urdf")},
        **changes,
    }
    path.write_text(json.dumps(record), encoding="utf-8")
    return path
