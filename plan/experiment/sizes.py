"""How large an effect is taken to be: as the diagnosis found it, else of typical size."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, SessionContext, Variant

# The figure that scales an effect, and its typical size as a share of the largest plausible one: the catalogue's
# typical sizes over `Effect.prior_scale`.
_LEADING: dict[str, tuple[str, float]] = {
    "stribeck_friction": ("amplitude_Nm", 0.3),
    "nonlinear_viscous_friction": ("coefficient", 0.2),
    "load_dependent_friction": ("mu", 0.3),
    "thermal_friction": ("viscous_change", 0.4),
    "presliding_hysteresis": ("amplitude_Nm", 0.15),
    "position_dependent_friction": ("amplitude_Nm", 0.2),
    "asymmetric_friction": ("coulomb_difference_Nm", 0.2),
    "joint_coupling": ("coulomb_Nm", 0.3),
    "joint_elasticity": ("stiffness_Nm_rad", 0.05),
    "backlash": ("gap_rad", 0.1),
    "torque_ripple": ("amplitude_Nm", 0.15),
    "spring_torque": ("stiffness_Nm_rad", 0.1),
    "payload": ("mass_kg", 0.1),
    "link_inertial_error": ("mass_change_kg", 0.25),
    "gravity_misalignment": ("tilt_x_rad", 0.15),
    "torque_gain_error": ("gain", 0.25),
    "torque_offset": ("offset_Nm", 0.05),
    "torque_delay": ("delay_s", 0.15),
    "torque_saturation": ("limit_Nm", 1.0),
    "encoder_offset": ("offset_rad", 0.12),
    "external_contact": ("force_N", 0.2),
}
# Typical inner figures, where the middle of the grid is none.
_INNER: dict[str, dict[str, float]] = {
    "stribeck_friction": {"stribeck_velocity_rad_s": 0.06, "exponent": 1.0},
    "nonlinear_viscous_friction": {"exponent": 0.5},
    "thermal_friction": {"time_constant_s": 120.0},
}
# Coefficients that a typical effect has not: an offset that stays drifts no more.
_ABSENT: dict[str, tuple[int, ...]] = {"torque_offset": (1,)}
# Of an effect of the user's own.
_OWN_SHARE = 0.2
# What is told is believed within these factors of a typical size.
_LARGEST_CHANGE = 20.0
# A stiffer spring shows less.
_INVERSE = {"joint_elasticity": "stiffness_Nm_rad"}

Told = Mapping[str, float]
"""Figures of an effect by name."""


@dataclass(frozen=True, eq=False)
class Sized:
    """An effect of a certain size.

    Attributes:
        coefficients: Of its columns at the expected point of its inner grid.
        source: `diagnosis` or `typical`.
    """

    coefficients: Float[Array, " k"]
    source: str


def size_effect(
    effect: Effect, session: SessionContext, joint: int, variant: Variant, width: int, told: Told | None = None
) -> Sized:
    """The effect at a joint as large as it is expected to be.

    Args:
        effect: The effect.
        session: Of the motions in question.
        joint: Its joint.
        variant: Point of its inner grid.
        width: Number of its columns there.
        told: Figures of the diagnosis by name, if it found this effect.
    """
    leading, share = _LEADING.get(effect.id, ("", _OWN_SHARE))
    scale = effect.prior_scale(session, joint, variant)
    beta = share * (np.ones(width) if scale is None else np.asarray(scale, dtype=float))
    beta[[k for k in _ABSENT.get(effect.id, ()) if k < width]] = 0.0
    if not told or leading not in told:
        return Sized(beta, "typical")
    usual = effect.parameters(session, joint, variant, beta, np.zeros((width, width)))[leading].value
    ratio = abs(told[leading]) / max(abs(usual), 1e-12)
    if leading == _INVERSE.get(effect.id):
        ratio = 1.0 / max(ratio, 1e-12)
    return Sized(beta * float(np.clip(ratio, 1.0 / _LARGEST_CHANGE, _LARGEST_CHANGE)), "diagnosis")


def choose_variant(effect: Effect, variants: Sequence[Variant], told: Told | None = None) -> int:
    """Number of the point of the inner grid nearest to what is told, or to what is typical; else the first."""
    wanted = {**_INNER.get(effect.id, {}), **(told or {})}

    def apart(k: int) -> float:
        inner = variants[k].inner
        return sum(abs(float(np.log(max(wanted[name], 1e-9) / inner[name]))) for name in inner if name in wanted)

    return min(range(len(variants)), key=apart)
