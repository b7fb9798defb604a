"""Torque, its derivatives and named friction; energy by every metric, and the laws that rest-to-rest motion obeys."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from ident.laws.carried import NamedLaw, named_torque
from ident.model.hybrid import HybridModel
from ident.model.loss import LossParameters
from ident.model.residual_net import fit_residual_net
from ident.robot.arm import ArmModel
from plan.dynamics.power import METRICS, ChainTorque, differentiate_torque, energy, find_kinks, rounded, torque_of_model
from plan.solving.bound import least_energy
from plan.spline import Splines
from tests.ident.made_up import sliding_arm
from tests.plan.worlds import bounded_nets, dense_net, joint_nets, losses, model, problem, three_joints


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
    found = energy(rigid, splines, "signed")
    assert found == pytest.approx(np.full(30, potential_change(splines)), abs=1e-3)


def test_energy_balance_closes(splines: Splines) -> None:
    """Signed energy is potential plus viscous plus Coulomb loss: no other term."""
    figures = LossParameters(np.full(3, 0.8), np.full(3, 9.0), np.full(3, 6.0), np.zeros(3), np.zeros(3))
    found = energy(ChainTorque(three_joints().chain, figures), splines, "signed", points=40)
    s, w = np.polynomial.legendre.leggauss(200)
    _, dq, _ = splines.states((s + 1) / 2)
    weights = (splines.durations[:, :, None] * w / 2).reshape(30, -1)
    lost = ((9.0 * dq**2 + 6.0 * np.abs(dq)).sum(axis=2) * weights).sum(axis=1)
    assert found == pytest.approx(potential_change(splines) + lost, rel=2e-3)


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


def test_offset_and_pure_sign() -> None:
    """A transition width of zero is the paper's sign; offsets add."""
    base = losses()
    pure = LossParameters(base.motor_inertia, base.viscous, base.coulomb, base.offset, np.zeros(3))
    q, dq, ddq = random_states(3)
    chain = three_joints().chain
    expected = three_joints().inverse_dynamics(q, dq, ddq)
    expected += base.motor_inertia * ddq + base.viscous * dq + base.coulomb * np.sign(dq) + base.offset
    assert ChainTorque(chain, pure).torque(q, dq, ddq) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("name", ["tm5-900", "panda", "z1", "slide"])
def test_equals_pinocchio(name: str) -> None:
    """Torque of 300 random states equals Pinocchio's to 1e-11 N m, of an arm that slides, too."""
    arm = sliding_arm() if name == "slide" else ArmModel.load(name)
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 300, arm.n))
    rigid = ChainTorque(arm.chain, LossParameters.zero(arm.n))
    assert np.abs(rigid.torque(q, dq, ddq) - arm.inverse_dynamics(q, dq, ddq)).max() < 1e-11


def _figures(*values: float) -> tuple[tuple[float, float, float], ...]:
    return tuple((value, 0.9 * value, 1.1 * value) for value in values)


LAWS = {
    "stribeck": NamedLaw(
        "stribeck_friction", 0, {"stribeck_velocity_rad_s": 0.3, "exponent": 1.3}, figures=_figures(4.0)
    ),
    "curved": NamedLaw("nonlinear_viscous_friction", 1, {"exponent": 0.6}, figures=_figures(3.0)),
    "curved, with a knee": NamedLaw(
        "nonlinear_viscous_friction", 1, {"exponent": 0.3, "knee_rad_s": 0.2}, figures=_figures(3.0)
    ),
    "load": NamedLaw("load_dependent_friction", 1, {"terms": 2, "load_Nm": 1.0}, figures=_figures(0.08, 0.03)),
    "load, four terms": NamedLaw(
        "load_dependent_friction", 2, {"terms": 4, "load_Nm": 9.0}, figures=_figures(0.08, 0.03, 0.02, 0.05)
    ),
    "position": NamedLaw("position_dependent_friction", 2, {"order": 3.0}, figures=_figures(0.7, -0.4)),
    "asymmetric": NamedLaw("asymmetric_friction", 0, {}, figures=_figures(0.8, 0.3)),
}
ALL = tuple(LAWS.values())


def _with(*laws: NamedLaw) -> ChainTorque:
    return replace(model(), named=laws)


@pytest.mark.parametrize("law", ALL, ids=list(LAWS))
def test_torque_is_the_laws_own_beside_the_rest(law: NamedLaw) -> None:
    """To 1e-9 N m, whatever the state."""
    rng, arm = np.random.default_rng(3), three_joints()
    q, dq, ddq = (rng.normal(size=(200, 3)) * scale for scale in (1.0, 1.0, 5.0))
    own = named_torque([law], q, dq, arm.inverse_dynamics(q, dq, ddq), model().losses.transition_speed)
    whole, bare = (one.torque(q[None], dq[None], ddq[None])[0] for one in (_with(law), model()))
    assert np.abs(own).max() > 0.1
    assert whole == pytest.approx(bare + own, abs=1e-9)


@pytest.mark.parametrize("metric", ["signed", "absolute"])
def test_the_bound_stays_below_what_motions_cost(metric: str) -> None:
    """Friction that only takes raises it; no trajectory undercuts it."""
    task = problem(metric=metric, duration=1.5, model=_with(*ALL))
    bound, bare = least_energy(task), least_energy(problem(metric=metric, duration=1.5))
    rng = np.random.default_rng(6)
    drawn = task.initial + 0.2 * rng.standard_normal((40, len(task.initial)))
    assert bound <= task.evaluate(np.concatenate([task.initial[None], drawn])).cost.min()
    passive = least_energy(problem(metric=metric, duration=1.5, model=_with(LAWS["stribeck"], LAWS["curved"])))
    assert passive > bare


NETS = {"rigid": None, "joint nets": joint_nets(), "bounded": bounded_nets(), "dense net": dense_net()}
MODELS = {
    **{name: model(net) for name, net in NETS.items()},
    "named": replace(model(), named=ALL),
    "named, joint nets": replace(model(joint_nets()), named=ALL),
}


@pytest.mark.parametrize("arm", MODELS.values(), ids=MODELS)
def test_derivatives_are_those_of_the_torque(arm: ChainTorque) -> None:
    """Torque equals the model's own, and its derivatives equal differences of it, by position, speed, acceleration.

    A named law of the load goes through the rigid torque's slopes.
    """
    arm, rng = rounded(arm, 0.05), np.random.default_rng(3)
    states = [rng.normal(size=(20, 3)) * scale for scale in (1.0, 1.0, 5.0)]
    tau, parts = differentiate_torque(arm, *states)
    assert tau == pytest.approx(arm.torque(*(part[None] for part in states))[0], abs=1e-4)
    for order, joint in product(range(3), range(3)):
        ends = []
        for sign in (1.0, -1.0):
            moved = [state.copy() for state in states]
            moved[order][:, joint] += sign * 1e-6
            ends.append(differentiate_torque(arm, *moved)[0])
        slope = (ends[0] - ends[1]) / 2e-6
        assert parts[order][:, :, joint] == pytest.approx(slope, abs=1e-4 if arm.named else 1e-5)


def test_rounding_only_widens_the_sign() -> None:
    """Far from rest a rounded model gives the same torque; at rest it lets friction rise over the width."""
    arm = replace(model(), losses=replace(model().losses, transition_speed=np.zeros(3)))
    still = np.zeros((1, 1, 3))
    for speed, change in ((1.0, 0.0), (0.01, 1.0)):
        dq = np.full((1, 1, 3), speed)
        difference = arm.torque(still, dq, still) - rounded(arm, 0.05).torque(still, dq, still)
        expected = change * arm.losses.coulomb * (1.0 - np.tanh(0.2))
        assert difference[0, 0] == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("metric", ["absolute", "positive", "signed"])
def test_kinks_of_power_bend_as_told(metric: str) -> None:
    """Where joints coast, or stand, power is bent along any way as the kinks say."""
    model = ChainTorque(three_joints().chain, replace(losses(), transition_speed=np.full(3, 1e-3)))
    rng, width, step = np.random.default_rng(0), 1e-3, 1e-7
    q, dq, ddq = rng.uniform(-1.0, 1.0, (3, 1, 3))
    dq *= metric != "signed"
    tau, (_, _, inertia) = differentiate_torque(model, q, dq, ddq)
    ddq = ddq - np.linalg.solve(inertia[0], tau[0])
    way = rng.normal(size=(3, 1, 3))

    def power(share: float) -> float:
        moved = [part + share * step * w for part, w in zip((q, dq, ddq), way, strict=True)]
        rate = model.torque(*(part[None] for part in moved))[0] * moved[1]
        root = np.sqrt(rate**2 + width**2)
        return float({"absolute": root, "positive": 0.5 * (rate + root), "signed": rate}[metric].sum())

    kinks = find_kinks(model, dq, differentiate_torque(model, q, dq, ddq), metric, width)
    bent = sum(float((sum((p * w).sum(axis=1) for p, w in zip(by, way, strict=True)) ** 2).sum()) for _, by in kinks)
    assert (power(1.0) + power(-1.0) - 2.0 * power(0.0)) / step**2 == pytest.approx(bent, rel=0.05)


def test_metrics_are_ordered(splines: Splines) -> None:
    """Signed ≤ positive ≤ absolute, and absolute = 2 positive − signed."""
    signed, positive, absolute, copper = (energy(model(), splines, metric) for metric in METRICS)
    assert np.all(signed <= positive + 1e-9)
    assert np.all(positive <= absolute + 1e-9)
    assert absolute == pytest.approx(2 * positive - signed)
    assert np.all(copper > 0)


def test_quadrature_is_good_enough(splines: Splines) -> None:
    """Eight points a section give the absolute energy to 1 % of forty points."""
    few, many = (energy(model(), splines, "absolute", points=points) for points in (8, 40))
    assert few == pytest.approx(many, rel=1e-2)
