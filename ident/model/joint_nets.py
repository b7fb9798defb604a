"""A small net for each joint, as plain arrays: several members side by side, SiLU inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from ident.arrays import Array, Float

# Rows that are reckoned at once: hidden units of more would not stay in the cache.
ROWS = 2048


@dataclass(frozen=True, eq=False)
class JointNets:
    """Perceptrons, one for each member and joint.

    A joint sees its own features only. On real arms that carries over to new motions, while one net over the whole
    state learns the training paths by heart.

    Attributes:
        members, joints: How many.
        weights: One array a layer, shape (members · joints, in, out).
        biases: One array a layer, shape (members · joints, 1, out).
    """

    members: int
    joints: int
    weights: tuple[Float[Array, "k i o"], ...] = field(repr=False)
    biases: tuple[Float[Array, "k 1 o"], ...] = field(repr=False)

    def __post_init__(self) -> None:
        for name in ("weights", "biases"):
            single = tuple(np.array(one, dtype=np.float32) for one in getattr(self, name))
            for one in single:
                one.setflags(write=False)
            object.__setattr__(self, name, single)

    @classmethod
    def from_arrays(
        cls, arrays: Mapping[str, Array], members: int, joints: int, inputs: int, hidden: Sequence[int]
    ) -> JointNets:
        """Nets from named arrays, as `arrays` gives them.

        Raises:
            KeyError, ValueError: One is missing, too many, or of another shape.
        """
        layers = list(pairwise([inputs, *hidden, 1]))
        names = {f"{kind}.{i}" for i in range(len(layers)) for kind in ("weights", "biases")}
        if set(arrays) != names:
            raise ValueError(f"its weights are {', '.join(sorted(arrays))}")
        count = members * joints
        for i, (before, after) in enumerate(layers):
            for name, shape in ((f"weights.{i}", (count, before, after)), (f"biases.{i}", (count, 1, after))):
                if arrays[name].shape != shape:
                    raise ValueError(f"{name} has shape {arrays[name].shape}, not {shape}")
        weights, biases = ([arrays[f"{kind}.{i}"] for i in range(len(layers))] for kind in ("weights", "biases"))
        return cls(members, joints, tuple(weights), tuple(biases))

    def arrays(self) -> dict[str, Array]:
        """All weights by name."""
        named: dict[str, Array] = {f"weights.{i}": weight for i, weight in enumerate(self.weights)}
        return named | {f"biases.{i}": bias for i, bias in enumerate(self.biases)}

    @property
    def size(self) -> int:
        """Number of weights."""
        return sum(part.size for part in (*self.weights, *self.biases))

    def __call__(self, x: Float[Array, "T n f"]) -> Float[Array, "m T n"]:
        """Outputs of all members, in single precision."""
        out = np.empty((self.members, len(x), self.joints), dtype=np.float32)
        for start in range(0, len(x), ROWS):
            part = np.ascontiguousarray(x[start : start + ROWS].transpose(1, 0, 2), dtype=np.float32)
            y = np.tile(part, (self.members, 1, 1))
            for i, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
                y = y @ weight + bias
                if i < len(self.weights) - 1:
                    y = silu(y)
            shaped = y[..., 0].reshape(self.members, self.joints, part.shape[1])
            out[:, start : start + ROWS] = shaped.transpose(0, 2, 1)
        return out

    def scaled(self, shares: Sequence[float]) -> JointNets:
        """The same, of each joint's output a share."""
        factor = np.tile(np.asarray(shares, dtype=np.float32), self.members)[:, None, None]
        weights, biases = (*self.weights[:-1], factor * self.weights[-1]), (*self.biases[:-1], factor * self.biases[-1])
        return JointNets(self.members, self.joints, weights, biases)


def silu(z: Array) -> Array:
    """z / (1 + exp(-z)), without overflow."""
    return np.asarray(z / (1.0 + np.exp(-np.clip(z, -80.0, 80.0))))
