"""The two torch networks of the residual model, both as an ensemble of members that share one forward pass."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import torch


class DenseNet(torch.nn.Module):
    """One multilayer perceptron from the whole state to all joints: the paper's kind. One member."""

    def __init__(self, inputs: int, outputs: int, hidden: Sequence[int], dropout: float) -> None:
        super().__init__()
        modules: list[torch.nn.Module] = []
        for before, after in pairwise([inputs, *hidden]):
            modules += [torch.nn.Linear(before, after), torch.nn.Tanh(), torch.nn.Dropout(dropout)]
        self.stack = torch.nn.Sequential(*modules, torch.nn.Linear([inputs, *hidden][-1], outputs))

    def forward(self, x: torch.Tensor) -> torch.Tensor:  # (T, f) -> (1, T, n)
        return self.stack(x)[None]

    def keep(self, best: dict[str, torch.Tensor], better: torch.Tensor) -> None:
        """Copies the weights into `best` if the mean error over the joints is better."""
        if bool(better.all()):
            best.update({name: value.clone() for name, value in self.state_dict().items()})


class JointNets(torch.nn.Module):
    """A small perceptron for each joint and member, evaluated as one batched product.

    A joint sees its own features only. On real arms that carries over to new motions, while one net over the whole
    state learns the training paths by heart.
    """

    def __init__(self, members: int, joints: int, inputs: int, hidden: Sequence[int]) -> None:
        super().__init__()
        self.members, self.joints = members, joints
        self.weights, self.biases = torch.nn.ParameterList(), torch.nn.ParameterList()
        for before, after in pairwise([inputs, *hidden, 1]):
            reach = before**-0.5
            size = members * joints
            self.weights.append(torch.nn.Parameter((2 * torch.rand(size, before, after) - 1) * reach))
            self.biases.append(torch.nn.Parameter((2 * torch.rand(size, 1, after) - 1) * reach))

    def forward(self, x: torch.Tensor) -> torch.Tensor:  # (T, n, f) -> (members, T, n)
        y = x.transpose(0, 1).repeat(self.members, 1, 1)
        last = len(self.weights) - 1
        for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            y = torch.baddbmm(bias, y, weight)
            y = torch.nn.functional.silu(y) if i < last else y
        return y[..., 0].reshape(self.members, self.joints, len(x)).transpose(1, 2)

    def keep(self, best: dict[str, torch.Tensor], better: torch.Tensor) -> None:
        """Copies the weights of each member and joint whose error is better, shape (members, n), into `best`.

        `best` starts as zeros, so a net that never beats "no residual" stays silent.
        """
        which = better.reshape(-1)
        for name, value in self.state_dict().items():
            best.setdefault(name, torch.zeros_like(value))[which] = value[which]

    def silence(self, joints: Sequence[int]) -> None:
        """Makes the nets of some joints give nothing."""
        with torch.no_grad():
            for value in self.parameters():
                for member in range(self.members):
                    value[[member * self.joints + joint for joint in joints]] = 0.0


Network = DenseNet | JointNets
