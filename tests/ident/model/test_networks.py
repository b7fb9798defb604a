"""Laws of the two networks behind the residual model."""

import pytest
import torch

from ident.model.networks import DenseNet, JointNets


def test_joint_nets_are_as_many_perceptrons() -> None:
    """The batched product equals each member's and joint's perceptron by itself, to float precision."""
    torch.manual_seed(1)
    net, x = JointNets(members=3, joints=2, inputs=4, hidden=(5, 6)), torch.randn(7, 2, 4)
    found = net(x)
    assert found.shape == (3, 7, 2)
    for member in range(3):
        for joint in range(2):
            y = x[:, joint]
            for i, (weight, bias) in enumerate(zip(net.weights, net.biases, strict=True)):
                y = y @ weight[2 * member + joint] + bias[2 * member + joint]
                y = torch.nn.functional.silu(y) if i < 2 else y
            assert torch.allclose(found[member, :, joint], y[:, 0], atol=1e-6)


def test_only_what_got_better_is_kept() -> None:
    """`keep` copies the weights of the better members and joints, leaves the others, and starts from silence."""
    torch.manual_seed(2)
    net, best, x = JointNets(2, 2, 3, (4,)), dict[str, torch.Tensor](), torch.randn(5, 2, 3)
    net.keep(best, torch.zeros(2, 2, dtype=torch.bool))
    assert all(torch.all(value == 0.0) for value in best.values())
    first = net(x).detach()
    net.keep(best, torch.tensor([[True, False], [False, True]]))
    with torch.no_grad():
        for weight in net.parameters():
            weight.add_(1.0)
    second = net(x).detach()
    net.keep(best, torch.tensor([[False, True], [False, False]]))
    net.load_state_dict(best)
    kept = net(x).detach()
    assert torch.equal(kept[0, :, 0], first[0, :, 0])
    assert torch.equal(kept[1, :, 1], first[1, :, 1])
    assert torch.equal(kept[0, :, 1], second[0, :, 1])
    assert torch.all(kept[1, :, 0] == 0.0)


@pytest.mark.parametrize("better", [True, False])
def test_dense_net_is_kept_as_a_whole(better: bool) -> None:
    """One error for all joints: all weights are copied, or none; later changes do not reach the copy."""
    net, best = DenseNet(3, 2, (4,), 0.5), dict[str, torch.Tensor]()
    net.keep(best, torch.tensor([better]))
    assert bool(best) is better
    with torch.no_grad():
        for weight in net.parameters():
            weight.add_(1.0)
    assert all(not torch.equal(value, net.state_dict()[name]) for name, value in best.items())


def test_dropout_is_for_training_only() -> None:
    """In evaluation the dense net is a function: the same input, the same output; in training it is not."""
    net, x = DenseNet(3, 2, (64,), 0.5), torch.randn(5, 3)
    net.eval()
    assert torch.equal(net(x), net(x))
    net.train()
    assert not torch.equal(net(x), net(x))
