"""Laws of the two networks behind the residual model.

Laws of nets whose hidden units are drawn and whose outputs are solved for.
"""

from itertools import pairwise

import numpy as np
import pytest
import torch

from ident.arrays import Array
from ident.model.dense_training import DenseNet
from ident.model.joint_nets import DRAWN, ROWS, JointNets, SolvedNet, silu, solve_net, width_of


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


def test_dropout_is_for_training_only() -> None:
    """In evaluation the dense net is a function: the same input, the same output; in training it is not."""
    net, x = DenseNet(3, 2, (64,), 0.5), torch.randn(5, 3)
    net.eval()
    assert torch.equal(net(x), net(x))
    net.train()
    assert not torch.equal(net(x), net(x))


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


def test_a_straight_law_is_followed_beyond_the_data() -> None:
    """Three times as far out as any sample."""
    x, _, fold = _data(3)
    y = x @ np.array([0.5, -0.3, 0.0, 0.2, 0.4, 0.0])
    net = solve_net(x, y, np.ones(len(x), dtype=bool), fold, 0)
    far = 3.0 * x[:200]
    assert np.sqrt(np.mean((_run(net, far) - 3.0 * y[:200]) ** 2)) < 0.1 * np.std(3.0 * y)


def test_what_is_said_of_a_row_does_not_know_it() -> None:
    """Chance can't be foretold: on noise the unseen prediction is no better than none, the error says so."""
    x, _, fold = _data(4, 600)
    y = np.random.default_rng(5).standard_normal(600)
    net = solve_net(x, y, np.ones(600, dtype=bool), fold, 0)
    assert np.mean((net.unseen - y) ** 2) > 0.97 * np.mean(y**2)
    assert net.error > 0.97


def test_rows_that_do_not_count_change_nothing() -> None:
    """Neither their torque nor their number; a joint with a handful of rows stays silent."""
    x, y, fold = _data(6)
    counts = x[:, 0] > -0.5
    clean, dirty = (solve_net(x, target, counts, fold, 0) for target in (y, np.where(counts, y, 1e6)))
    assert all(np.array_equal(a, b) for a, b in zip(clean.weights, dirty.weights, strict=True))
    few = solve_net(x, y, np.arange(len(x)) < 5, fold, 0)
    assert not few.unseen.any()
    assert not few.weights[1].any()
