"""A residual net as plain layers, so that it can be evaluated in batches here and written into CasADi elsewhere."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float

ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "tanh": np.tanh,
    "silu": lambda x: x / (1.0 + np.exp(-x)),
    "relu": lambda x: np.maximum(x, 0.0),
}


@dataclass(frozen=True, eq=False)
class DenseNet:
    """A fully connected net from joint states to torque.

    τ = (W_L φ(… φ(W₁ z + b₁) …) + b_L), with z = (features − shift) / scale and the features (q, dq, ddq) or
    (sin q, cos q, dq, ddq) in that order. Shift, scale and the output's scale are folded into the first and last
    layer when the net is made.

    Attributes:
        weights: One matrix a layer, shape (out, in).
        biases: One vector a layer.
        activation: Name of φ: `tanh`, `silu` or `relu`.
        trigonometric: Whether positions enter as sine and cosine.
    """

    weights: tuple[Float[Array, "o i"], ...]
    biases: tuple[Float[Array, " o"], ...]
    activation: str = "tanh"
    trigonometric: bool = False

    @property
    def parameters(self) -> int:
        """Number of weights and biases."""
        return sum(w.size for w in self.weights) + sum(b.size for b in self.biases)

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""
        return sum(w.size for w in self.weights)

    def features(self, q: Array, dq: Array, ddq: Array) -> Float[Array, "T i"]:
        """Inputs of the net from states of shape (T, n)."""
        places = (np.sin(q), np.cos(q)) if self.trigonometric else (q,)
        return np.concatenate([*places, dq, ddq], axis=-1)

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque, computed in single precision [N m]."""
        single = self._single
        x = self.features(q, dq, ddq).astype(np.float32)
        for weight, bias in single[:-1]:
            x = ACTIVATIONS[self.activation](x @ weight + bias)
        weight, bias = single[-1]
        return (x @ weight + bias).astype(float)

    @property
    def _single(self) -> list[tuple[Array, Array]]:
        return [
            (np.ascontiguousarray(w.T, dtype=np.float32), b.astype(np.float32))
            for w, b in zip(self.weights, self.biases, strict=True)
        ]
