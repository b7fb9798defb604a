"""Laws of written modules against the catalogue's formulas, written a second time and evaluated at random states."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ident.export.python import describe_arm
from ident.laws.acting import acting_torque
from ident.laws.motion import Losses, MovingArm
from ident.robot.arm import ArmModel
from tests.ident.made_up import random_states

N, J, V0 = 6, 2, 0.01
VISCOUS, COULOMB = np.arange(1.0, 7.0), np.arange(2.0, 8.0)
# By effect the figures that are drawn, what the law asks for besides, and the formula of a joint's states
# (angle q, speed v, direction s, load, speed of joint 1) and figures [N m].
FORMULAS: dict[str, tuple[str, dict[str, float], Any]] = {
    "stribeck_friction": (
        "coefficient_0 stribeck_velocity_rad_s exponent",
        {},
        lambda m, a, vs, e: a * m.s * np.exp(-((abs(m.v) / vs) ** e)),
    ),
    "nonlinear_viscous_friction": ("coefficient_0 exponent", {}, lambda m, c, e: c * m.s * abs(m.v) ** e),
    # The same while driving and backdriving is two thirds of μ in either column.
    "load_dependent_friction": (
        "mu",
        {"terms": 2.0, "load_Nm": 1.0},
        lambda m, mu: mu * m.s * abs(m.load),
    ),
    "position_dependent_friction": (
        "coefficient_0 coefficient_1 order",
        {},
        lambda m, a, b, k: m.s * np.hypot(a, b) * np.cos(k * m.q - np.arctan2(b, a)),
    ),
    "asymmetric_friction": ("coefficient_0 coefficient_1", {}, lambda m, f, c: (m.s**2 * f + abs(m.v) * c) / 2.0),
    "thermal_friction": (
        "viscous_change coulomb_change",
        {},
        lambda m, c, f: 0.5 * (c * VISCOUS[J] * m.v + f * COULOMB[J] * m.s),
    ),
    "joint_coupling": (
        "viscous_Nms_rad coulomb_Nm",
        {"other_joint": 1.0, "mix": 0.0, "width_rad_s": V0, "inertia_kgm2": 0.0},
        lambda m, c, f: c * m.other + f * np.tanh(m.other / V0),
    ),
    "torque_ripple": (
        "amplitude_Nm turns phase_rad",
        {"loaded": 0.0, "load_Nm": 1.0},
        lambda m, a, k, phase: a * np.cos(k * m.q - phase),
    ),
    "spring_torque": (
        "linear_Nm_rad centre_rad",
        dict.fromkeys(("constant_Nm", "square_Nm_rad2", "cube_Nm_rad3", "cosine_Nm", "sine_Nm"), 0.0),
        lambda m, k, rest: k * (m.q - rest),
    ),
}


@pytest.mark.parametrize("effect", FORMULAS)
def test_a_law_is_the_catalogues_formula(effect: str) -> None:
    """Law: over random figures and states a module's torque is the formula's, at its own joint alone."""
    arm, rng = ArmModel.load("tm5-900"), np.random.default_rng(8)
    losses = Losses(np.zeros(N), VISCOUS, COULOMB, np.full(N, V0), np.zeros(N))
    names, besides, formula = FORMULAS[effect]
    for _ in range(20):
        q, dq, ddq = random_states(rng, 40, N)
        p = {name: float(rng.uniform(0.2, 2.0)) for name in names.split()}
        even = {f"coefficient_{k}": p["mu"] / 1.5 for k in range(2) if "mu" in p}
        found = acting_torque([(effect, J, p | besides | even)], MovingArm(describe_arm(arm), losses, q, dq, ddq))
        states = SimpleNamespace(q=q[:, J], v=dq[:, J], s=np.tanh(dq[:, J] / V0), other=dq[:, 0])
        states.load = arm.inverse_dynamics(q, dq, ddq)[:, J]
        np.testing.assert_allclose(found[:, J], formula(states, *p.values()), atol=1e-9)
        assert not np.delete(found, J, axis=1).any()
