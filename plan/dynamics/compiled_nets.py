"""Residual nets as plain layers, evaluated in batches: single precision for torque, double for derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import Array, Float
from ident.model.joint_nets import DIRECTION_SCALES, LOAD_ROUNDING, ROWS, JointNets, NetBounds, joint_features

if TYPE_CHECKING:
    from ident.model.residual_net import ResidualNet

Layers = list[tuple[Array, Array]]
"""Weights of shape (in, out) and biases of shape (out,), layer by layer."""


@dataclass(frozen=True, eq=False)
class CompiledDenseNet:
    """The paper's kind: one fully connected net from (q, dq, ddq) to all torques, tanh inside."""

    layers: Layers

    def frozen(self, positions: Float[Array, " k"]) -> CompiledDenseNet:
        """The net of the first joints, the last k at rest at positions: these are constants of the first layer."""
        (first, bias), *inner, (last, offset) = self.layers
        total, kept = len(offset), len(offset) - len(positions)
        fixed = np.zeros(len(first))
        fixed[kept:total] = positions
        columns = np.concatenate([np.arange(kept) + total * part for part in range(3)])
        return CompiledDenseNet([(first[columns], bias + fixed @ first), *inner, (last[:, :kept], offset[:kept])])

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque [N m]; the rigid torque is not looked at."""
        found = []
        for x in _chunks(np.concatenate([q, dq, ddq], axis=-1).astype(np.float32)):
            for layer, (weight, bias) in enumerate(self._single):
                x = (np.tanh(x) if layer else x) @ weight + bias
            found.append(x)
        return np.concatenate(found).astype(float)

    def add_slopes(self, states: list[Array], rigid: Float[Array, "T n"], sums: tuple[Array, Array, Array]) -> Array:
        """Residual torque; its derivatives are added to the rigid torque's.

        Args:
            states: Position, speed and acceleration, each shape (T, n).
            rigid: Rigid torque [N m].
            sums: Derivatives of the rigid torque by these three, each shape (T, n, n).
        """
        x, slopes = np.concatenate(states, axis=1), []
        *inner, (last, offset) = self.layers
        for weight, bias in inner:
            x = np.tanh(x @ weight + bias)
            slopes.append(1.0 - x * x)
        jacobian = np.repeat(last.T[None], len(x), axis=0)
        for (weight, _), slope in zip(inner[::-1], slopes[::-1], strict=True):
            jacobian = (jacobian * slope[:, None, :]) @ weight.T
        for part, block in zip(sums, np.split(jacobian, 3, axis=2), strict=True):
            part += block
        return np.asarray(x @ last + offset)

    @cached_property
    def _single(self) -> Layers:
        return _to_single(self.layers)


@dataclass(frozen=True, eq=False)
class CompiledJointNets:
    """The default kind: a net for each joint, SiLU inside; its inputs are `joint_features`."""

    joints: tuple[Layers, ...]  # layers of each joint's net
    # Speeds, accelerations and loads of the training; beyond them the net gives what it gives at their edge.
    bounds: NetBounds

    def frozen(self, positions: Float[Array, " k"]) -> CompiledJointNets:
        """The nets of the first joints: joints know nothing of each other."""
        kept = slice(0, len(self.joints) - len(positions))
        return CompiledJointNets(self.joints[kept], self.bounds.of_joints(kept))

    def _clip(self, j: int, *given: Float[Array, " T"]) -> Float[Array, "3 T"]:
        """Speed, acceleration and load of one joint, moved to the edge of its training where they lie outside."""
        return np.clip(np.stack(given), self.bounds.low[:, j, None], self.bounds.high[:, j, None])

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque [N m]; the position enters by the rigid torque alone."""
        found = np.empty(dq.shape)
        for j, (*layers, (last, offset)) in enumerate(self._single):
            parts = []
            for part in _chunks(self._clip(j, dq[:, j], ddq[:, j], rigid[:, j]).astype(np.float32).T):
                x = joint_features(*part.T)
                for weight, bias in layers:
                    x = x @ weight
                    x += bias
                    _bend(x)
                parts.append(x @ last[:, 0] + offset)
            found[:, j] = np.concatenate(parts)
        return found

    def joint_slopes(
        self, j: int, dq: Float[Array, " T"], ddq: Float[Array, " T"], rigid: Float[Array, " T"]
    ) -> tuple[Float[Array, " T"], Float[Array, "3 T"]]:
        """Residual torque of one joint and its slopes by its own speed, acceleration and load."""
        v, a, load = clipped = self._clip(j, dq, ddq, rigid)
        near, far = (np.tanh(v / scale) for scale in DIRECTION_SCALES)
        rounded, one, zero = np.hypot(load, LOAD_ROUNDING), np.ones_like(v), np.zeros_like(v)
        steep, flat = (1.0 - near**2) / DIRECTION_SCALES[0], (1.0 - far**2) / DIRECTION_SCALES[1]
        x = joint_features(v, a, load)
        by_speed = np.stack([one, zero, steep, flat, zero, rounded * steep], axis=1)
        by_acceleration = np.stack([zero, one, zero, zero, zero, zero], axis=1)
        by_load = np.stack([zero, zero, zero, zero, one, near * load / rounded], axis=1)
        tangents = np.stack([by_speed, by_acceleration, by_load])
        *layers, (last, offset) = self.joints[j]
        for weight, bias in layers:
            x, tangents = x @ weight + bias, tangents @ weight
            gate = 0.5 * (1.0 + np.tanh(0.5 * x))
            tangents *= gate * (1.0 + x * (1.0 - gate))
            x = x * gate
        # Beyond the training's edge the net stays as it is.
        return (x @ last + offset)[:, 0], (tangents @ last)[:, :, 0] * (np.stack([dq, ddq, rigid]) == clipped)

    def add_slopes(self, states: list[Array], rigid: Float[Array, "T n"], sums: tuple[Array, Array, Array]) -> Array:
        """As of `CompiledDenseNet`; a joint's net sees its load, so the chain rule goes through that."""
        _, dq, ddq = states
        value = np.empty(dq.shape)
        for j in range(dq.shape[1]):
            value[:, j], slopes = self.joint_slopes(j, dq[:, j], ddq[:, j], rigid[:, j])
            for part in sums:
                part[:, j] *= 1.0 + slopes[2][:, None]
            for part, slope in zip(sums[1:], slopes, strict=False):
                part[:, j, j] += slope
        return value

    @cached_property
    def _single(self) -> list[Layers]:
        return [_to_single(layers) for layers in self.joints]


CompiledNet = CompiledDenseNet | CompiledJointNets


def read_residual(net: ResidualNet) -> CompiledNet:
    """A trained net as plain layers, its standardisation folded in."""
    network, mean, std, scale = net.network, net.input_mean, net.input_std, net.output_std
    if not isinstance(network, JointNets):
        parts = [value.astype(float) for value in network.arrays().values()]  # each layer's weights, then biases
        return CompiledDenseNet(_folded([w.T for w in parts[::2]], parts[1::2], mean, std, scale))
    assert net.bounds is not None
    joints = []
    for j in range(net.n):
        weights, biases = [w[j].astype(float) for w in network.weights], [b[j, 0].astype(float) for b in network.biases]
        joints.append(_folded(weights, biases, mean[j], std[j], scale[j : j + 1]))
    return CompiledJointNets(tuple(joints), net.bounds)


def _folded(weights: list[Array], biases: list[Array], mean: Array, std: Array, scale: Array) -> Layers:
    """Layers that take plain inputs and give plain outputs."""
    weights[0] = weights[0] / std[:, None]
    biases[0] = biases[0] - mean @ weights[0]
    weights[-1], biases[-1] = weights[-1] * scale, biases[-1] * scale
    return list(zip(weights, biases, strict=True))


def _chunks(x: Float[Array, "T k"]) -> list[Float[Array, "t k"]]:
    """Rows in pieces whose hidden units stay in the processor's cache."""
    return [x[start:stop] for start, stop in pairwise([*range(0, max(len(x), 1), ROWS), len(x)])]


def _bend(z: Float[Array, "t h"]) -> None:
    """SiLU in place, z / (1 + exp(-z)): in fewer passes over what the cache holds than one a step would take."""
    with np.errstate(over="ignore"):  # of exp(-z): the quotient is then nought, as it is to be
        gate = np.negative(z)
        np.exp(gate, out=gate)
        gate += 1.0
        z /= gate


def _to_single(layers: Layers) -> Layers:
    return [(np.ascontiguousarray(w, dtype=np.float32), b.astype(np.float32)) for w, b in layers]
