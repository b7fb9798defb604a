"""Residual nets as plain layers, evaluated in batches.

Torque takes single precision, its derivatives double.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING, ROWS, JointNets, joint_features
from ident.model.net_bounds import NetBounds

if TYPE_CHECKING:
    from ident.model.residual_net import ResidualNet

Layers = list[tuple[Array, Array]]
"""Weights of shape (in, out) and biases of shape (out,), layer by layer."""


@dataclass(frozen=True, eq=False)
class CompiledDenseNet:
    """The paper's kind: a fully connected net from (q, dq, ddq) to all torques, tanh inside."""

    layers: Layers

    def frozen(self, positions: Float[Array, " k"]) -> CompiledDenseNet:
        """The net of the first joints, the last k at rest at positions.

        These are constants of the first layer.
        """
        (first, bias), *inner, (last, offset) = self.layers
        total = len(offset)
        moving = total - len(positions)
        fixed = np.zeros(len(first))
        fixed[moving:total] = positions
        columns = np.concatenate([np.arange(moving) + total * block for block in range(3)])
        first_layer = (first[columns], bias + fixed @ first)
        last_layer = (last[:, :moving], offset[:moving])
        return CompiledDenseNet([first_layer, *inner, last_layer])

    def torque(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
    ) -> Float[Array, "T n"]:
        """Residual torque [N m]; the rigid torque is not looked at."""
        states = np.concatenate([q, dq, ddq], axis=-1).astype(np.float32)
        torques = []
        for chunk in _chunks(states):
            x = chunk
            for layer, (weight, bias) in enumerate(self._single):
                if layer > 0:
                    x = np.tanh(x)
                x = x @ weight + bias
            torques.append(x)
        return np.concatenate(torques).astype(float)

    def add_slopes(
        self,
        states: list[Array],
        rigid: Float[Array, "T n"],
        sums: tuple[Array, Array, Array],
    ) -> Array:
        """Residual torque; its derivatives are added to the rigid torque's.

        Args:
            states: Position, speed and acceleration, each shape (T, n).
            rigid: Rigid torque [N m].
            sums: Derivatives of the rigid torque by these three, each shape (T, n, n).
        """
        *inner, (last, offset) = self.layers
        x = np.concatenate(states, axis=1)
        slopes = []
        for weight, bias in inner:
            x = np.tanh(x @ weight + bias)
            slopes.append(1.0 - x * x)
        jacobian = np.repeat(last.T[None], len(x), axis=0)
        for (weight, _), slope in zip(inner[::-1], slopes[::-1], strict=True):
            jacobian = (jacobian * slope[:, None, :]) @ weight.T
        blocks = np.split(jacobian, 3, axis=2)
        for derivative, block in zip(sums, blocks, strict=True):
            derivative += block
        return np.asarray(x @ last + offset)

    @cached_property
    def _single(self) -> Layers:
        return _to_single(self.layers)


@dataclass(frozen=True, eq=False)
class CompiledJointNets:
    """The default kind: a net for each joint, SiLU inside; its inputs are `joint_features`."""

    joints: tuple[Layers, ...]  # layers of each joint's net
    # Speeds, accelerations and loads of the training; beyond them the net gives what it gives at
    # their edge, and nowhere more than it gave there.
    bounds: NetBounds

    def frozen(self, positions: Float[Array, " k"]) -> CompiledJointNets:
        """The nets of the first joints: joints know nothing of each other."""
        moving = slice(0, len(self.joints) - len(positions))
        return CompiledJointNets(self.joints[moving], self.bounds.of_joints(moving))

    def _clip(self, j: int, *given: Float[Array, " T"]) -> Float[Array, "3 T"]:
        """Speed, acceleration and load of a joint, moved to the edge of its training where they
        lie outside.
        """
        low = self.bounds.low[:, j, None]
        high = self.bounds.high[:, j, None]
        return np.clip(np.stack(given), low, high)

    def torque(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
    ) -> Float[Array, "T n"]:
        """Residual torque [N m]; the position enters by the rigid torque alone."""
        residual = np.empty(dq.shape)
        for j, layers in enumerate(self._single):
            clipped = self._clip(j, dq[:, j], ddq[:, j], rigid[:, j])
            residual[:, j] = _joint_torque(layers, clipped.astype(np.float32).T)
        return self.bounds.clip_torque(residual)

    def joint_slopes(
        self,
        j: int,
        dq: Float[Array, " T"],
        ddq: Float[Array, " T"],
        rigid: Float[Array, " T"],
    ) -> tuple[Float[Array, " T"], Float[Array, "3 T"]]:
        """Residual torque of a joint and its slopes by its own speed, acceleration and load.

        Returns:
            The torque [N m], and its slopes in three rows: by speed, by acceleration, by rigid
            torque.
        """
        clipped = self._clip(j, dq, ddq, rigid)
        x = joint_features(*clipped)
        tangents = _feature_slopes(*clipped)
        *layers, (last, offset) = self.joints[j]
        for weight, bias in layers:
            x = x @ weight + bias
            tangents = tangents @ weight
            gate = 0.5 * (1.0 + np.tanh(0.5 * x))
            tangents *= gate * (1.0 + x * (1.0 - gate))
            x = x * gate
        torque = (x @ last + offset)[:, 0]
        slopes = (tangents @ last)[:, :, 0]
        # Beyond the training's edge the net stays as it is.
        inside = np.stack([dq, ddq, rigid]) == clipped
        least, most = self.bounds.torques
        said = np.clip(torque, least[j], most[j])
        return said, slopes * (inside & (said == torque))

    def add_slopes(
        self,
        states: list[Array],
        rigid: Float[Array, "T n"],
        sums: tuple[Array, Array, Array],
    ) -> Array:
        """Residual torque [N m] of each joint's net, its derivatives added to the rigid model's.

        A net sees the rigid torque of its own joint, too: the chain rule goes through that.

        Args:
            states: Position, speed and acceleration, (T, n) each.
            rigid: Rigid torque at these [N m].
            sums: Derivatives of the torque by position, speed and acceleration, (T, n, n) each,
                written in place.

        Returns:
            The residual torque (T, n).
        """
        _, dq, ddq = states
        residual = np.empty(dq.shape)
        for j in range(dq.shape[1]):
            torque, slopes = self.joint_slopes(j, dq[:, j], ddq[:, j], rigid[:, j])
            by_speed, by_acceleration, by_load = slopes
            residual[:, j] = torque
            for derivative in sums:
                derivative[:, j] *= 1.0 + by_load[:, None]
            sums[1][:, j, j] += by_speed
            sums[2][:, j, j] += by_acceleration
        return residual

    @cached_property
    def _single(self) -> list[Layers]:
        return [_to_single(layers) for layers in self.joints]


CompiledNet = CompiledDenseNet | CompiledJointNets


def read_residual(net: ResidualNet) -> CompiledNet:
    """A trained net as plain layers, its standardisation folded in."""
    network = net.network
    mean = net.input_mean
    std = net.input_std
    scale = net.output_std
    if not isinstance(network, JointNets):
        # The weights of each layer, then its biases.
        arrays = [values.astype(float) for values in network.arrays().values()]
        weights = [weight.T for weight in arrays[::2]]
        return CompiledDenseNet(_folded(weights, arrays[1::2], mean, std, scale))
    assert net.bounds is not None
    joints = []
    for j in range(net.n):
        weights = [weight[j].astype(float) for weight in network.weights]
        biases = [bias[j, 0].astype(float) for bias in network.biases]
        joints.append(_folded(weights, biases, mean[j], std[j], scale[j : j + 1]))
    return CompiledJointNets(tuple(joints), net.bounds)


def _folded(
    weights: list[Array], biases: list[Array], mean: Array, std: Array, scale: Array
) -> Layers:
    """Layers that take plain inputs and give plain outputs."""
    weights[0] = weights[0] / std[:, None]
    biases[0] = biases[0] - mean @ weights[0]
    weights[-1] = weights[-1] * scale
    biases[-1] = biases[-1] * scale
    return list(zip(weights, biases, strict=True))


def _joint_torque(layers: Layers, states: Float[Array, "T 3"]) -> Float[Array, " T"]:
    """Residual torque of a joint, by its net in single precision [N m].

    Args:
        layers: Of the joint's net.
        states: Speed, acceleration and load, inside the training.
    """
    *inner, (last, offset) = layers
    torques = []
    for chunk in _chunks(states):
        x = joint_features(*chunk.T)
        for weight, bias in inner:
            x = x @ weight
            x += bias
            _bend(x)
        torques.append(x @ last[:, 0] + offset)
    return np.concatenate(torques)


def _feature_slopes(
    speed: Float[Array, " T"], acceleration: Float[Array, " T"], load: Float[Array, " T"]
) -> Float[Array, "3 T f"]:
    """Derivatives of `joint_features` by speed, acceleration and load."""
    near_scale, far_scale = DIRECTION_SCALES
    near = np.tanh(speed / near_scale)
    far = np.tanh(speed / far_scale)
    steep = (1.0 - near**2) / near_scale
    flat = (1.0 - far**2) / far_scale
    rounded = np.hypot(load, LOAD_ROUNDING)
    unit = np.ones_like(speed)
    zero = np.zeros_like(speed)
    by_speed = [unit, zero, steep, flat, zero, rounded * steep]
    by_acceleration = [zero, unit, zero, zero, zero, zero]
    by_load = [zero, zero, zero, zero, unit, near * load / rounded]
    slopes = (by_speed, by_acceleration, by_load)
    return np.stack([np.stack(features, axis=1) for features in slopes])


def _chunks(x: Float[Array, "T k"]) -> list[Float[Array, "t k"]]:
    """Rows in pieces whose hidden units stay in the processor's cache."""
    bounds = [*range(0, max(len(x), 1), ROWS), len(x)]
    return [x[start:stop] for start, stop in pairwise(bounds)]


def _bend(z: Float[Array, "t h"]) -> None:
    """SiLU in place, z / (1 + exp(-z)).

    In fewer passes over what the cache holds than a pass for each step would take.
    """
    with np.errstate(over="ignore"):  # of exp(-z): the quotient is then nought, as it is to be
        gate = np.negative(z)
        np.exp(gate, out=gate)
        gate += 1.0
        z /= gate


def _to_single(layers: Layers) -> Layers:
    single = []
    for weight, bias in layers:
        weight_single = np.ascontiguousarray(weight, dtype=np.float32)
        single.append((weight_single, bias.astype(np.float32)))
    return single
