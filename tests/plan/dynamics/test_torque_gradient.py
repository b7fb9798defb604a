"""Derivatives of the torque."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest

from plan.dynamics.power import ChainTorque, differentiate_torque, find_kinks, rounded
from tests.plan.dynamics.test_named_friction import ALL
from tests.plan.worlds import bounded_nets, dense_net, joint_nets, losses, model, three_joints

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
