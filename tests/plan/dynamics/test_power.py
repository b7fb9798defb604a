"""Torque, energy by every metric, and the laws that rest-to-rest motion obeys."""

import numpy as np
import pytest

from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.model.residual_net import fit_residual_net
from ident.robot.arm import ArmModel
from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets
from plan.dynamics.power import METRICS, ChainTorque, energy, torque_of_model
from plan.spline import Splines
from tests.plan.worlds import dense_net, joint_nets, losses, model, problem, three_joints


@pytest.fixture(scope="module")
def splines() -> Splines:
    task = problem()
    x = task.initial + np.random.default_rng(0).normal(size=(30, 6)) * 0.1
    return task.decode(x)


def potential_change(splines: Splines) -> np.ndarray:
    """Change of potential energy from start to goal, by integrating gravity torque along a straight line."""
    arm, (start, goal) = three_joints(), splines.points[0, [0, -1]]
    s, w = np.polynomial.legendre.leggauss(20)
    q = start + (s[:, None] + 1) / 2 * (goal - start)
    return (arm.gravity(q) @ (goal - start)) @ w / 2


def test_signed_energy_of_a_rigid_arm_is_the_potential(splines: Splines) -> None:
    """Rigid body and rotor inertia contribute the change of potential energy, whatever the path."""
    rotors = LossParameters(np.full(3, 0.8), *np.zeros((4, 3)))
    rigid = ChainTorque(three_joints().chain, rotors)
    found, _ = energy(rigid, splines, "signed")
    assert found == pytest.approx(np.full(30, potential_change(splines)), abs=1e-3)


def test_energy_balance_closes(splines: Splines) -> None:
    """Signed energy is potential plus viscous plus Coulomb loss: no other term."""
    figures = LossParameters(np.full(3, 0.8), np.full(3, 9.0), np.full(3, 6.0), np.zeros(3), np.zeros(3))
    found, _ = energy(ChainTorque(three_joints().chain, figures), splines, "signed", points=40)
    s, w = np.polynomial.legendre.leggauss(200)
    _, dq, _ = splines.states((s + 1) / 2)
    weights = (splines.durations[:, :, None] * w / 2).reshape(30, -1)
    lost = ((9.0 * dq**2 + 6.0 * np.abs(dq)).sum(axis=2) * weights).sum(axis=1)
    assert found == pytest.approx(potential_change(splines) + lost, rel=2e-3)


def test_metrics_are_ordered(splines: Splines) -> None:
    """Signed ≤ positive ≤ absolute, and absolute = 2 positive − signed."""
    signed, positive, absolute, copper = (energy(model(), splines, metric)[0] for metric in METRICS)
    assert np.all(signed <= positive + 1e-9)
    assert np.all(positive <= absolute + 1e-9)
    assert absolute == pytest.approx(2 * positive - signed)
    assert np.all(copper > 0)


def test_quadrature_is_good_enough(splines: Splines) -> None:
    """Eight points a section give the absolute energy to 1 % of forty points."""
    few, many = (energy(model(), splines, "absolute", points=points)[0] for points in (8, 40))
    assert few == pytest.approx(many, rel=1e-2)


def random_states(n: int, count: int = 40) -> np.ndarray:
    return np.random.default_rng(1).normal(size=(3, count, n))


@pytest.mark.parametrize("preset", ["default", "paper"])
def test_planner_sees_the_fitted_model(preset: str) -> None:
    """A hybrid model's torque and the planner's are equal to single precision, wrist frozen or not, and beyond the

    training of its net too.
    """
    from dataclasses import replace

    from ident.model.residual_net import PRESETS

    arm = ArmModel.load("tm5-900")
    q, dq, ddq = random_states(6, 200)
    rigid = arm.inverse_dynamics(q, dq, ddq)
    hidden = (12, 8) if preset == "default" else (16, 16)
    options = replace(PRESETS[preset], hidden=hidden, epochs=2)
    net = fit_residual_net([(q, dq, ddq, rigid)], [np.sin(dq) + 0.1 * rigid], options=options)
    loss = LossParameters(*np.random.default_rng(2).uniform(0.1, 2.0, (4, 6)), np.full(6, 0.02))
    hybrid = HybridModel(arm, arm, arm, loss, net)
    q, dq, ddq = (2.0 * part for part in (q, dq, ddq))
    whole = torque_of_model(hybrid, 6, [])
    assert np.abs(whole.torque(q[None], dq[None], ddq[None])[0] - hybrid.torque(q, dq, ddq)).max() < 1e-3
    wrist = np.array([0.3, -0.5, 0.7])
    part = torque_of_model(hybrid, 3, wrist)
    held = np.hstack([q[:, :3], np.tile(wrist, (200, 1))])
    still = [np.hstack([values[:, :3], np.zeros((200, 3))]) for values in (dq, ddq)]
    expected = hybrid.torque(held, *still)[:, :3]
    assert np.abs(part.torque(*(v[None, :, :3] for v in (q, dq, ddq)))[0] - expected).max() < 1e-3


@pytest.mark.parametrize("net", [joint_nets(), dense_net()], ids=["default", "paper"])
def test_net_adds_to_the_rest(net: CompiledDenseNet | CompiledJointNets) -> None:
    """The model with a net is the model without plus the net's torque."""
    q, dq, ddq = random_states(3)
    rigid = three_joints().inverse_dynamics(q, dq, ddq)
    with_net, without = model(net).torque(q, dq, ddq), model().torque(q, dq, ddq)
    assert with_net - without == pytest.approx(net.torque(q, dq, ddq, rigid), abs=1e-9)
    assert np.abs(with_net - without).max() > 0.1


def test_offset_and_pure_sign() -> None:
    """A transition width of zero is the paper's sign; offsets add."""
    base = losses()
    pure = LossParameters(base.motor_inertia, base.viscous, base.coulomb, base.offset, np.zeros(3))
    q, dq, ddq = random_states(3)
    chain = three_joints().chain
    expected = three_joints().inverse_dynamics(q, dq, ddq)
    expected += base.motor_inertia * ddq + base.viscous * dq + base.coulomb * np.sign(dq) + base.offset
    assert ChainTorque(chain, pure).torque(q, dq, ddq) == pytest.approx(expected, abs=1e-9)
