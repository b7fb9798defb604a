"""A residual net as plain layers, so that it can be evaluated in batches here and written into CasADi elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from ident.arrays import Array, Float
from ident.residual import DIRECTION_SCALES, ResidualNet

ACTIVATIONS = {"tanh": torch.tanh, "silu": torch.nn.functional.silu}


@dataclass(frozen=True, eq=False)
class DenseNet:
    """A fully connected net from joint states to torque, τ = W_L φ(… φ(W₁ z + b₁) …) + b_L.

    z holds (q, dq, ddq), or (sin q, cos q, dq, ddq, tanh(dq / v) for each scale v), joint by joint in each part. The
    standardisation of inputs and outputs is folded into the first and the last layer.

    Attributes:
        weights: One matrix a layer, shape (out, in).
        biases: One vector a layer.
        activation: Name of φ: `tanh` or `silu`.
        rich: Whether z is the longer form.
        scales: Speeds v of the direction features [rad/s].
    """

    weights: tuple[Float[Array, "o i"], ...]
    biases: tuple[Float[Array, " o"], ...]
    activation: str = "silu"
    rich: bool = True
    scales: tuple[float, ...] = DIRECTION_SCALES

    @classmethod
    def from_residual(cls, net: ResidualNet) -> DenseNet:
        """Reads a trained net, its standardisation folded in."""
        layers = net.layers()
        weights, biases = [w.copy() for w, _ in layers], [b.copy() for _, b in layers]
        biases[0] -= weights[0] @ (net.input_mean / net.input_std)
        weights[0] /= net.input_std
        scale = net.output_std * net.gain
        weights[-1] *= scale[:, None]
        biases[-1] *= scale
        options = net.options
        return cls(tuple(weights), tuple(biases), options.activation, options.features == "rich")

    def frozen(self, positions: Float[Array, " k"]) -> DenseNet:
        """The net of the first joints, with the last k joints at rest at given positions [rad]: exact.

        Their inputs are constants, so they go into the first bias; their outputs are dropped.
        """
        held = np.asarray(positions, dtype=float)
        total = self.weights[-1].shape[0]
        kept = total - len(held)
        zeros = np.zeros(len(held))
        places = [np.sin(held), np.cos(held)] if self.rich else [held]
        moving = [zeros] * (2 + (len(self.scales) if self.rich else 0))
        parts = [*places, *moving]
        constant = np.concatenate([np.concatenate([np.zeros(kept), part]) for part in parts])
        columns = np.concatenate([np.arange(kept) + total * i for i in range(len(parts))])
        first, last = self.weights[0], self.weights[-1][:kept]
        biases = (self.biases[0] + first @ constant, *self.biases[1:-1], self.biases[-1][:kept])
        weights = (first[:, columns], *self.weights[1:-1], last)
        return DenseNet(weights, biases, self.activation, self.rich, self.scales)

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return self.products + sum(bias.size for bias in self.biases)

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""
        return sum(weight.size for weight in self.weights)

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque, computed in single precision [N m]."""
        return self.forward(self.features(q, dq, ddq)).numpy().astype(float)

    def features(self, q: Array, dq: Array, ddq: Array) -> torch.Tensor:
        """Inputs of the net for states of shape (…, n), in single precision."""
        q, dq, ddq = (torch.from_numpy(np.asarray(values, dtype=np.float32)) for values in (q, dq, ddq))
        if not self.rich:
            return torch.cat([q, dq, ddq], dim=-1)
        directions = [torch.tanh(dq / scale) for scale in self.scales]
        return torch.cat([torch.sin(q), torch.cos(q), dq, ddq, *directions], dim=-1)

    def forward(self, features: torch.Tensor) -> torch.Tensor:
        """Torque from the inputs of the net."""
        with torch.inference_mode():
            return self.after_first(torch.nn.functional.linear(features, *self._single[0]))

    def after_first(self, x: torch.Tensor) -> torch.Tensor:
        """Torque from the first layer's sums, before its activation."""
        with torch.inference_mode():
            for weight, bias in self._single[1:]:
                x = torch.nn.functional.linear(ACTIVATIONS[self.activation](x), weight, bias)
            return x

    @cached_property
    def _single(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        pairs = zip(self.weights, self.biases, strict=True)
        return [(torch.from_numpy(w.astype(np.float32)), torch.from_numpy(b.astype(np.float32))) for w, b in pairs]
