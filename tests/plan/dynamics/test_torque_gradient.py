"""Derivatives of the torque."""

from dataclasses import replace

import numpy as np
import pytest

from plan.dynamics.compiled_nets import CompiledDenseNet, CompiledJointNets
from plan.dynamics.power import ChainTorque, differentiate_torque, find_kinks, rounded
from tests.plan.dynamics.differences import slopes_by_differences
from tests.plan.worlds import bounded_nets, dense_net, joint_nets, losses, model, three_joints


@pytest.mark.parametrize(
    "net", [None, joint_nets(), bounded_nets(), dense_net()], ids=["rigid", "joint nets", "bounded", "dense net"]
)
def test_derivatives_are_those_of_the_torque(net: CompiledDenseNet | CompiledJointNets | None) -> None:
    """Torque equals the model's own, and its derivatives equal differences of it, by position, speed, acceleration."""
    arm, rng = rounded(model(net), 0.05), np.random.default_rng(3)
    states = [rng.normal(size=(12, 3)) * scale for scale in (1.0, 1.0, 5.0)]
    found = differentiate_torque(arm, *states)
    assert found.tau == pytest.approx(arm.torque(*(part[None] for part in states))[0], abs=1e-4)
    parts = (found.by_position, found.by_speed, found.by_acceleration)
    for order, joint, slope in slopes_by_differences(arm, states):
        assert parts[order][:, :, joint] == pytest.approx(slope, abs=1e-5)


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
    found = differentiate_torque(model, q, dq, ddq)
    ddq = ddq - np.linalg.solve(found.by_acceleration[0], found.tau[0])
    way = rng.normal(size=(3, 1, 3))

    def power(share: float) -> float:
        moved = [part + share * step * w for part, w in zip((q, dq, ddq), way, strict=True)]
        rate = model.torque(*(part[None] for part in moved))[0] * moved[1]
        root = np.sqrt(rate**2 + width**2)
        return float({"absolute": root, "positive": 0.5 * (rate + root), "signed": rate}[metric].sum())

    kinks = find_kinks(model, dq, differentiate_torque(model, q, dq, ddq), metric, width)
    bent = sum(float((sum((p * w).sum(axis=1) for p, w in zip(by, way, strict=True)) ** 2).sum()) for _, by in kinks)
    assert (power(1.0) + power(-1.0) - 2.0 * power(0.0)) / step**2 == pytest.approx(bent, rel=0.05)
