"""A small net for each joint, as plain arrays, SiLU inside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.arrays import Array, Float

# Rows that are reckoned at once: hidden units of more would not stay in the cache.
ROWS = 2048
# Speeds at which the direction features bend [rad/s]: the transition at a reversal, and the
# Stribeck zone.
DIRECTION_SCALES = (0.02, 0.15)
# Rounds the corner of |τ| so that gradients exist at zero [N m].
LOAD_ROUNDING = 0.5
# Hidden units that are drawn for a net.
DRAWN = 256
# Beyond it SiLU is its own limit to the last bit.
LARGEST_EXPONENT = 80.0


def joint_features(
    dq: Float[Array, "*T"], ddq: Float[Array, "*T"], rigid: Float[Array, "*T"]
) -> Float[Array, "*T 6"]:
    """Inputs of a joint's net.

    dq, ddq, tanh(dq / v₁), tanh(dq / v₂), its rigid torque τ, √(τ² + ε²) tanh(dq / v₁).
    """
    near, far = (np.tanh(dq / scale) for scale in DIRECTION_SCALES)
    size = np.hypot(rigid, LOAD_ROUNDING)
    return np.stack([dq, ddq, near, far, rigid, size * near], axis=-1)


def width_of(inputs: int) -> int:
    """Hidden units of a net: the drawn ones, and a pair for each input to pass it on."""
    return DRAWN + 2 * inputs


@dataclass(frozen=True, eq=False)
class JointNets:
    """Perceptrons of one hidden layer, one for each joint.

    A joint sees its own features only. On real arms that carries over to new motions, while one net
    over the whole state learns the training paths by heart.
    """

    # One array a layer, shape (joints, in, out), and the biases, (joints, 1, out).
    weights: tuple[Float[Array, "n f w"], Float[Array, "n w 1"]] = field(repr=False)
    biases: tuple[Float[Array, "n 1 w"], Float[Array, "n 1 1"]] = field(repr=False)

    def __post_init__(self) -> None:
        for name in ("weights", "biases"):
            layers = tuple(np.array(layer, dtype=np.float32) for layer in getattr(self, name))
            for layer in layers:
                layer.setflags(write=False)
            object.__setattr__(self, name, layers)

    @classmethod
    def from_arrays(cls, arrays: dict[str, Array], joints: int, inputs: int) -> JointNets:
        """Nets from named arrays, as `arrays` gives them.

        Raises:
            ValueError: One is missing, too many, or of another shape.
        """
        width = width_of(inputs)
        wanted = {
            "weights.0": (joints, inputs, width),
            "weights.1": (joints, width, 1),
            "biases.0": (joints, 1, width),
            "biases.1": (joints, 1, 1),
        }
        shapes = {name: values.shape for name, values in arrays.items()}
        if shapes != wanted:
            raise ValueError(f"its weights are {shapes}, not {wanted}")
        weights = (arrays["weights.0"], arrays["weights.1"])
        biases = (arrays["biases.0"], arrays["biases.1"])
        return cls(weights, biases)

    def arrays(self) -> dict[str, Array]:
        """All weights by name: "weights.0", "weights.1", "biases.0" and "biases.1"."""
        named = {}
        for kind, layers in (("weights", self.weights), ("biases", self.biases)):
            for number, values in enumerate(layers):
                named[f"{kind}.{number}"] = values
        return named

    @property
    def size(self) -> int:
        """Number of weights."""
        return sum(layer.size for layer in (*self.weights, *self.biases))

    def __call__(self, x: Float[Array, "T n f"]) -> Float[Array, "T n"]:
        """Outputs in single precision."""
        out = np.empty(x.shape[:2], dtype=np.float32)
        for start in range(0, len(x), ROWS):
            rows = x[start : start + ROWS].transpose(1, 0, 2)
            inputs = np.ascontiguousarray(rows, dtype=np.float32)
            hidden = silu(inputs @ self.weights[0] + self.biases[0])
            said = hidden @ self.weights[1] + self.biases[1]
            out[start : start + ROWS] = said[..., 0].T
        return out

    def scaled(self, shares: Sequence[float]) -> JointNets:
        """Nets that give a share of each joint's output; `shares` has one number a joint."""
        factor = np.asarray(shares, dtype=np.float32)[:, None, None]
        first, last = self.weights
        bias, offset = self.biases
        return JointNets((first, factor * last), (bias, factor * offset))


def silu(z: Array) -> Array:
    """z / (1 + exp(-z)), without overflow."""
    exponent = np.clip(z, -LARGEST_EXPONENT, LARGEST_EXPONENT)
    return np.asarray(z / (1.0 + np.exp(-exponent)))
