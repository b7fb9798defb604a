"""Laws of the two networks behind the residual model."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from ident.model.dense_training import DenseNet
from ident.model.joint_nets import ROWS, JointNets


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
