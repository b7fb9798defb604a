"""The paper's network, in torch."""

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
