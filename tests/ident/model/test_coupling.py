"""Laws of two joints on one shaft."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.errors import InputError, ModelError
from ident.model.hybrid import FitOptions, HybridModel, fit_hybrid
from ident.model.loss import Coupling, Shaft
from ident.motion.motion import Motion
from plan.dynamics.power import torque_of_model
from tests.ident.made_up import exact_motion, multisine, two_joint_arm

RATE, OWN = 100.0, np.array([[0.6, 10.0, 8.0], [0.8, 6.0, 5.0]])
SHARED = (0.2, 1.5, 2.0)


def _runs(sign: float, noise: float = 0.1) -> list[Motion]:
    """Six runs of a made-up arm whose joints share a shaft."""
    arm, rng, runs = two_joint_arm(), np.random.default_rng(0), []
    time = np.arange(int(12.0 * RATE)) / RATE
    for k in range(6):
        q, dq, ddq = multisine(rng, time, 2)
        turn = np.sign(dq[:, 1] + sign * dq[:, 0])
        tau = arm.inverse_dynamics(q, dq, ddq) + OWN[:, 0] * ddq + OWN[:, 1] * dq + OWN[:, 2] * np.sign(dq)
        tau[:, 0] += sign * (SHARED[0] * ddq[:, 1] + SHARED[1] * dq[:, 1] + SHARED[2] * turn)
        tau[:, 1] += sign * (SHARED[0] * ddq[:, 0] + SHARED[1] * dq[:, 0]) + SHARED[2] * turn
        tau = tau + noise * rng.standard_normal(tau.shape)
        runs.append(exact_motion(time, (q, dq, ddq), tau, arm.joint_names, f"run_{k}"))
    return runs


@pytest.mark.parametrize(("text", "sign"), [("1,2", 1.0), ("1,-2", -1.0)])
def test_a_shafts_figures_are_found_and_kept(text: str, sign: float, tmp_path: Path) -> None:
    """Within their intervals, which are narrow; a saved model gives the same torque; without the shaft it is worse."""
    runs = _runs(sign)
    found = fit_hybrid(runs, two_joint_arm(), FitOptions(net="none", coupling=text))
    coupling = found.model.coupling
    assert coupling is not None
    for truth, figure in zip(SHARED, (coupling.inertia, coupling.viscous, coupling.coulomb), strict=True):
        value, low, high = figure
        assert abs(value - truth) < 1.5 * (high - low)
        assert high - low < 0.1 * truth
    one = runs[0]
    torque = found.model.torque(one.q, one.dq, one.ddq)
    assert np.allclose(HybridModel.load(found.model.save(tmp_path / "m")).torque(one.q, one.dq, one.ddq), torque)
    alone = fit_hybrid(runs, two_joint_arm(), FitOptions(net="none")).model.torque(one.q, one.dq, one.ddq)
    rows = one.moving.all(axis=1)
    left = [np.sqrt(np.mean((one.tau - part)[one.coarse][rows] ** 2)) for part in (torque, alone)]
    assert left[0] < 0.4 * left[1]


def test_a_shaft_does_no_work_against_itself() -> None:
    """Power of the torque that a shaft adds: Coulomb's is |u| f, whatever the sign; both joints' parts together."""
    dq = np.random.default_rng(1).normal(size=(50, 2))
    for sign in (1.0, -1.0):
        coupling = Coupling(Shaft(0, 1, sign), (0.0,) * 3, (0.0,) * 3, (2.0, 1.0, 3.0))
        power = np.sum(coupling.torque(dq, np.zeros_like(dq)) * dq, axis=1)
        assert np.allclose(power, 2.0 * np.abs(dq[:, 1] + sign * dq[:, 0]))


@pytest.mark.parametrize("text", ["1", "1,1", "1,9", "0,1", "1,2,1", "shoulder,2", "1,two"])
def test_what_is_no_pair_of_joints_is_told(text: str) -> None:
    with pytest.raises(InputError, match="--coupling"):
        Shaft.parse(text, ("a", "b"))


def test_names_of_joints_are_taken_too() -> None:
    assert Shaft.parse("a, b", ("a", "b")) == Shaft.parse("1,2", ("a", "b")) == Shaft(0, 1)


def test_a_plan_refuses_what_it_does_not_know() -> None:
    coupling = Coupling(Shaft(0, 1), (0.0,) * 3, (0.0,) * 3, (2.0, 1.0, 3.0))
    model = fit_hybrid(_runs(1.0), two_joint_arm(), FitOptions(net="none")).model
    with pytest.raises(ModelError, match="one shaft"):
        torque_of_model(replace(model, coupling=coupling), 2, [])
