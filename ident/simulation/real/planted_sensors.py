"""Sensors that are planted: torques read wrong, late or flat, and a zero that is off."""

from __future__ import annotations

import numpy as np

from ident.arrays import Array
from ident.simulation.real.moved_arm import MovedArm, rigid_torque
from ident.simulation.real.planting import Draw, Parameters, PlantedChange, at_joint


def plant_gain(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A torque that is read too large or too small by a share [1]."""
    gain = size * float(draw.choice([-1.0, 1.0]))
    return at_joint(arm, j, gain * arm.tau[:, j], {"gain": gain})


def plant_offset(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A torque that is read too large or too small by so much [N m], with a slow drift."""
    offset = size * float(draw.choice([-1.0, 1.0]))
    drift = float(offset * draw.uniform(-0.1, 0.1) / 60.0)
    first = arm.t[arm.given[0].start]
    last = arm.t[arm.given[-1].stop - 1]
    middle = 0.5 * (first + last)
    truth: Parameters = {"offset_Nm": offset, "drift_Nm_s": drift}
    return at_joint(arm, j, offset + drift * (arm.t - middle), truth)


def plant_delay(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """All torques are late by a time [s]."""

    def delayed(t: Array, tau: Array) -> Array:
        """A run's torque as it is read."""
        return np.column_stack([np.interp(t - size, t, column) for column in tau.T])

    late = arm.over_runs(arm.tau, delayed)
    return PlantedChange({"delay_s": size}, late - arm.tau)


def plant_saturation(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """Flat at `1 - size` of the peak, at once or after a bend."""
    limit = (1.0 - size) * float(arm.peak[j])
    tau = arm.tau[:, j]
    if draw.random() < 0.5:
        flat = np.clip(tau, -limit, limit)
    else:
        bend = 0.05 * limit
        modulus = np.abs(tau)
        bent = limit - bend * np.logaddexp(0.0, (limit - modulus) / bend)
        flat = np.where(modulus < 0.7 * limit, tau, np.sign(tau) * bent)
    return at_joint(arm, j, flat - tau, {"limit_Nm": limit})


def plant_encoder(arm: MovedArm, j: int, size: float, draw: Draw) -> PlantedChange:
    """A zero that is off to either side by an angle [rad]."""
    shift = np.zeros(arm.n)
    shift[j] = size * float(draw.choice([-1.0, 1.0]))
    unseen = arm.rigid - rigid_torque(arm.model, arm.q + shift, arm.v, arm.a)
    # Reported is what has to be added to a reading.
    truth: Parameters = {"offset_rad": -float(shift[j])}
    return PlantedChange(truth, np.zeros_like(arm.tau), shift, unseen=unseen)
