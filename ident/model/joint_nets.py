"""A small net for each joint, as plain arrays: several members side by side, SiLU inside.

The box of inputs that a joint's net was fitted in; beyond it the net says what it says at the edge.

A net knows nothing of where it never was: on a simulated arm whose runs left out went faster than the others, what it
made up there was four times the error that it was to take away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, freeze

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


# Share of the samples at either end that bound nothing: a smoother's overshoot is no place where the arm was.
TAILS = 0.001


@dataclass(frozen=True, eq=False)
class NetBounds:
    """Least and largest speed, acceleration and rigid torque of each joint that its net is told of.

    Attributes:
        low, high: Shape (3, n): dq [rad/s], ddq [rad/s²], rigid torque [N m].
    """

    low: Float[Array, "3 n"]
    high: Float[Array, "3 n"]

    def __post_init__(self) -> None:
        for name in ("low", "high"):
            object.__setattr__(self, name, freeze(getattr(self, name)))
        if self.low.shape != self.high.shape or self.low.ndim != 2 or len(self.low) != 3:
            raise ValueError("the net's bounds are not three pairs a joint")
        if not np.all(self.low <= self.high):
            raise ValueError("a bound of the net is missing, or the lower one is above the upper")

    @classmethod
    def of(cls, inputs: Float[Array, "3 T n"], counts: Bool[Array, "T n"]) -> NetBounds:
        """Bounds of the samples that count; of a joint without any, of all."""
        low, high = np.empty((2, 3, inputs.shape[2]))
        for j in range(inputs.shape[2]):
            rows = counts[:, j] if counts[:, j].any() else slice(None)
            low[:, j], high[:, j] = np.quantile(inputs[:, rows, j], [TAILS, 1.0 - TAILS], axis=1)
        return cls(low, high)

    def clip(
        self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> tuple[Float[Array, "T n"], Float[Array, "T n"], Float[Array, "T n"]]:
        """Speed, acceleration and rigid torque, moved to the nearest edge where they lie outside."""
        low, high = self.low, self.high
        return np.clip(dq, low[0], high[0]), np.clip(ddq, low[1], high[1]), np.clip(rigid, low[2], high[2])

    def of_joints(self, joints: slice) -> NetBounds:
        """The bounds of some joints."""
        return NetBounds(self.low[:, joints], self.high[:, joints])

    def to_dict(self) -> dict[str, Any]:
        """For the net's record."""
        return {"low": self.low.tolist(), "high": self.high.tolist()}

    @classmethod
    def from_dict(cls, record: dict[str, Any], n: int) -> NetBounds:
        """What `to_dict` wrote.

        Raises:
            KeyError, TypeError, ValueError: It is damaged, or not of n joints.
        """
        low, high = (np.array(record[name], dtype=float) for name in ("low", "high"))
        if low.shape != (3, n) or not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ValueError(f"the net's bounds are not three finite pairs for {n} joints")
        return cls(low, high)
