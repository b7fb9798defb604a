"""Laws of the gate that a net must pass."""

import numpy as np
import torch

from ident.arrays import Array
from ident.model.net_gate import describe_gate, judge_net
from ident.model.networks import JointNets
from ident.model.residual_net import NetOptions, fit_residual_net

RUN = np.repeat(np.arange(8), 100)


def _judged(predicted: Array, left: Array) -> list[bool]:
    travel = np.full(left.shape, 0.01)
    return [one.kept for one in judge_net(predicted, left, np.ones(left.shape, dtype=bool), travel, RUN)]


def test_a_joint_keeps_what_helps_on_every_run() -> None:
    """A net that halves the error in torque and energy stays; one that predicts noise goes; none is no help."""
    rng = np.random.default_rng(1)
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(3) + 0.1
    predicted = np.stack([0.5 * left[:, 0], rng.standard_normal(800), np.zeros(800)], axis=1)
    assert _judged(predicted, left) == [True, False, False]


def test_a_net_that_spoils_the_energy_goes() -> None:
    """Less torque error does not excuse more energy error."""
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(2)
    predicted = 0.5 * left
    predicted[:, 1] += 0.2
    assert _judged(predicted, left) == [True, False]


def test_help_on_one_run_alone_is_no_help() -> None:
    """A gain within its standard error over the runs is chance."""
    left = np.sin(np.arange(800) / 7.0)[:, None]
    predicted = np.where(RUN == 0, 0.9, -0.05)[:, None] * left
    assert _judged(predicted, left) == [False]


def test_the_total_energy_is_no_worse_either() -> None:
    """Two joints whose energy errors cancel: a net that takes away one of them alone is let go."""
    left = np.sin(np.arange(800) / 7.0)[:, None] * np.ones(2) + np.array([1.0, -1.0])
    predicted = np.stack([0.9 * left[:, 0], np.zeros(800)], axis=1)
    assert _judged(predicted, left) == [False, False]


def test_a_silent_joint_gives_nothing() -> None:
    """The other joints' nets are as they were."""
    torch.manual_seed(0)
    nets = JointNets(2, 3, 6, (4,))
    x = torch.randn(5, 3, 6)
    before = nets(x).detach().numpy()
    nets.silence([1])
    after = nets(x).detach().numpy()
    assert np.all(after[..., 1] == 0.0)
    assert np.array_equal(after[..., [0, 2]], before[..., [0, 2]])


def test_trained_nets_are_judged_on_runs_that_they_never_saw() -> None:
    """What differs from run to run teaches nothing about the next one; a law of the state does."""
    rng, states, residuals = np.random.default_rng(2), [], []
    for run in range(8):
        q, dq, ddq = (rng.uniform(-1, 1, (120, 2)) for _ in range(3))
        states.append((q, dq, ddq, np.zeros((120, 2))))
        residuals.append(np.stack([np.tanh(3 * dq[:, 0]), (-1.0) ** run * np.ones(120)], axis=1))
    options = NetOptions(members=2, hidden=(8,), epochs=30)
    net = fit_residual_net(states, residuals, None, options)
    assert [one.kept for one in net.gate] == [True, False]
    assert np.all(net.predict(*states[0])[:, 1] == 0.0)
    assert describe_gate(net.gate, ("a", "b")).startswith("residual net: kept for a; left out for b")
