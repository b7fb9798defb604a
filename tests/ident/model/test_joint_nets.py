"""Laws of the two networks behind the residual model.

Laws of nets whose hidden units are drawn and whose outputs are solved for.
"""

from itertools import pairwise

import numpy as np
import pytest
import torch

from ident.arrays import Array
from ident.model.joint_nets import DRAWN, ROWS, JointNets, SolvedNet, silu, solve_net, width_of
from ident.model.net_shrinkage import describe_gate, shrink_net
from ident.model.residual_net import fit_residual_net


def _nets(members: int, joints: int, widths: tuple[int, ...]) -> JointNets:
    rng = np.random.default_rng(1)
    layers = list(pairwise(widths))
    weights = tuple(rng.standard_normal((members * joints, *layer)) for layer in layers)
    return JointNets(members, joints, weights, tuple(rng.standard_normal((members * joints, 1, b)) for _, b in layers))


def test_joint_nets_are_as_many_perceptrons() -> None:
    """The batched product equals each member's and joint's perceptron by itself, in torch, to float precision."""
    net, x = _nets(3, 2, (4, 5, 6, 1)), np.random.default_rng(2).standard_normal((ROWS + 7, 2, 4))
    found = net(x)
    assert found.shape == (3, ROWS + 7, 2)
    for member in range(3):
        for joint in range(2):
            y = torch.tensor(x[:, joint], dtype=torch.float32)
            for i, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
                y = y @ torch.tensor(weight[2 * member + joint]) + torch.tensor(bias[2 * member + joint])
                y = torch.nn.functional.silu(y) if i < 2 else y
            assert np.allclose(found[member, :, joint], y[:, 0].numpy(), atol=1e-4)


def test_joint_nets_come_back_from_their_arrays() -> None:
    """By name and shape; one that is missing, too many or of another shape is refused."""
    net = _nets(2, 3, (6, 4, 1))
    arrays = net.arrays()
    again = JointNets.from_arrays(arrays, 2, 3, 6, (4,))
    assert all(np.array_equal(a, b) for a, b in zip(net.weights, again.weights, strict=True))
    assert again.size == sum(value.size for value in arrays.values())
    for broken in ({**arrays, "more": arrays["biases.0"]}, {"weights.0": arrays["weights.0"]}):
        with pytest.raises(ValueError, match="its weights are"):
            JointNets.from_arrays(broken, 2, 3, 6, (4,))
    with pytest.raises(ValueError, match="has shape"):
        JointNets.from_arrays(arrays, 3, 2, 6, (5,))


def _data(seed: int, samples: int = 1200) -> tuple[Array, Array, Array]:
    rng = np.random.default_rng(seed)
    x = rng.standard_normal((samples, 6))
    return x, np.tanh(2.0 * x[:, 2]) + 0.3 * x[:, 4], np.arange(samples) * 4 // samples


def _run(net: SolvedNet, x: Array) -> Array:
    return np.asarray((silu(x @ net.weights[0] + net.biases[0]) @ net.weights[1] + net.biases[1])[:, 0])


def test_the_layers_are_a_net_that_follows_the_target() -> None:
    """Two layers of the width told, which leave less than 5 % of a bent law of two inputs on data of another seed."""
    x, y, fold = _data(1)
    net = solve_net(x, y, np.ones(len(x), dtype=bool), fold, 0)
    assert [part.shape for part in net.weights] == [(6, width_of(6)), (width_of(6), 1)]
    assert width_of(6) == DRAWN + 12
    other, truth, _ = _data(2)
    assert np.mean((_run(net, other) - truth) ** 2) < 0.05 * np.mean(truth**2)
    assert net.error < 0.05


def test_rows_that_do_not_count_change_nothing() -> None:
    """Neither their torque nor their number; a joint with a handful of rows stays silent."""
    x, y, fold = _data(6)
    counts = x[:, 0] > -0.5
    clean, dirty = (solve_net(x, target, counts, fold, 0) for target in (y, np.where(counts, y, 1e6)))
    assert all(np.array_equal(a, b) for a, b in zip(clean.weights, dirty.weights, strict=True))
    few = solve_net(x, y, np.arange(len(x)) < 5, fold, 0)
    assert not few.unseen.any()
    assert not few.weights[1].any()


RUN = np.repeat(np.arange(8), 100)


def _judged(predicted: Array, left: Array) -> list[bool]:
    travel = np.full(left.shape, 0.01)
    return [one.kept for one in shrink_net(predicted, left, np.ones(left.shape, dtype=bool), travel, RUN)]


WAVE = np.sin(np.arange(800) / 7.0)[:, None]
NOISE = np.random.default_rng(1).standard_normal((800, 1))
# What a net predicts, what it should have, and which joints keep it.
GATES = {
    "half of it, noise, none": (np.hstack([0.5 * WAVE + 0.05, NOISE, 0.0 * WAVE]), WAVE + np.full(3, 0.1), [1, 0, 0]),
    "more energy error": (0.5 * WAVE + np.array([0.0, 0.6]), WAVE + np.zeros(2), [1, 0]),
    "help on one run alone": (np.where(RUN == 0, 0.9, -0.05)[:, None] * WAVE, WAVE, [0]),
    # Two joints whose energy errors cancel: a net that takes away one of them alone is let go.
    "energy of all": (np.hstack([0.9 * WAVE + 0.9, 0.0 * WAVE]), WAVE + np.array([1.0, -1.0]), [0, 0]),
}


@pytest.mark.parametrize("case", GATES)
def test_a_joint_keeps_what_helps_on_every_run_in_torque_and_energy(case: str) -> None:
    predicted, left, kept = GATES[case]
    assert _judged(predicted, left) == [bool(one) for one in kept]


def test_a_silent_joint_gives_nothing() -> None:
    """And one that keeps half gives half; the other's net is as it was."""
    rng = np.random.default_rng(0)
    layers = [rng.standard_normal(shape) for shape in ((6, 6, 4), (6, 4, 1))]
    nets = JointNets(2, 3, tuple(layers), (np.ones((6, 1, 4)), np.ones((6, 1, 1))))
    x = rng.standard_normal((5, 3, 6))
    before = nets(x)
    after = nets.scaled([1.0, 0.0, 0.5])(x)
    assert np.all(after[..., 1] == 0.0)
    assert np.array_equal(after[..., 0], before[..., 0])
    assert np.allclose(after[..., 2], 0.5 * before[..., 2], rtol=1e-6)


def test_trained_nets_are_judged_on_runs_that_they_never_saw() -> None:
    """What differs from run to run teaches nothing about the next one; a law of the state does."""
    rng, states, residuals = np.random.default_rng(2), [], []
    for run in range(8):
        q, dq, ddq = (rng.uniform(-1, 1, (120, 2)) for _ in range(3))
        states.append((q, dq, ddq, np.zeros((120, 2))))
        residuals.append(np.stack([np.tanh(3 * dq[:, 0]), (-1.0) ** run * np.ones(120)], axis=1))
    net = fit_residual_net(states, residuals)
    assert [one.kept for one in net.gate] == [True, False]
    assert np.all(net.predict(*states[0])[:, 1] == 0.0)
    told = describe_gate(net.gate, ("a", "b"))
    assert told.startswith("residual net, on runs held back: kept for a (")
    assert f"{net.gate[0].rmse_without:.3g} → {net.gate[0].rmse_with:.3g} N m" in told
    assert "; left out for b (" in told
