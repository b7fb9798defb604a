"""Residual nets as plain layers, evaluated in batches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy.linalg import block_diag

from ident.arrays import Array, Float
from ident.model.joint_nets import ROWS, JointNets, NetBounds, silu
from ident.model.residual_net import DIRECTION_SCALES, LOAD_ROUNDING, ResidualNet

Layers = list[tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class ResidualTerm(ABC):
    """A residual net for a planner.

    Attributes:
        weights: One array a layer.
        biases: One array a layer.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""
        return sum(weight.size for weight in self.weights)

    @abstractmethod
    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque, computed in single precision [N m]."""

    @abstractmethod
    def add_slopes(self, states: list[Array], rigid: Float[Array, "T n"], sums: tuple[Array, Array, Array]) -> Array:
        """Residual torque in double precision; its derivatives are added to the rigid torque's.

        Args:
            states: Position, speed and acceleration, each shape (T, n).
            rigid: Rigid torque [N m].
            sums: Derivatives of the rigid torque by these three, each shape (T, n, n).
        """

    @abstractmethod
    def frozen(self, positions: Float[Array, " k"]) -> ResidualTerm:
        """The net of the first joints, with the last k joints at rest at given positions [rad]: exact."""


def read_residual(net: ResidualNet) -> ResidualTerm:
    """A trained net as plain layers, its standardisation folded in."""
    return (CompiledJointNets if isinstance(net.network, JointNets) else CompiledDenseNet).from_residual(net)


class CompiledDenseNet(ResidualTerm):
    """The paper's kind: one fully connected net from (q, dq, ddq) to all torques, tanh inside.

    A layer's weights have shape (out, in), its biases (out,).
    """

    @classmethod
    def from_residual(cls, net: ResidualNet) -> CompiledDenseNet:
        """Reads a trained net of the `paper` preset."""
        parts = [value.astype(float) for value in net.network.arrays().values()]  # each layer's weights, then biases
        weights, biases = parts[::2], parts[1::2]
        biases[0] = biases[0] - weights[0] @ (net.input_mean / net.input_std)
        weights[0] = weights[0] / net.input_std
        weights[-1] = weights[-1] * net.output_std[:, None]
        biases[-1] = biases[-1] * net.output_std
        return cls(tuple(weights), tuple(biases))

    def frozen(self, positions: Float[Array, " k"]) -> CompiledDenseNet:
        """As in `ResidualTerm`: the fixed joints' inputs are constants and go into the first bias."""
        total = self.weights[-1].shape[0]
        kept = total - len(positions)
        fixed = np.zeros(self.weights[0].shape[1])
        fixed[kept:total] = positions
        columns = np.concatenate([np.arange(kept) + total * part for part in range(3)])
        biases = (self.biases[0] + self.weights[0] @ fixed, *self.biases[1:-1], self.biases[-1][:kept])
        weights = (self.weights[0][:, columns], *self.weights[1:-1], self.weights[-1][:kept])
        return CompiledDenseNet(weights, biases)

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """As in `ResidualTerm`; the rigid torque is not looked at."""
        found = []
        for x in _chunks(np.concatenate([q, dq, ddq], axis=-1).astype(np.float32)):
            for layer, (weight, bias) in enumerate(self._single):
                x = (np.tanh(x) if layer else x) @ weight + bias
            found.append(x)
        return np.concatenate(found).astype(float)

    def add_slopes(self, states: list[Array], rigid: Float[Array, "T n"], sums: tuple[Array, Array, Array]) -> Array:
        """As in `ResidualTerm`."""
        x, slopes = np.concatenate(states, axis=1), []
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            x = np.tanh(x @ weight.T + bias)
            slopes.append(1.0 - x * x)
        jacobian = np.repeat(self.weights[-1][None], len(x), axis=0)
        for weight, slope in zip(self.weights[-2::-1], slopes[::-1], strict=True):
            jacobian = (jacobian * slope[:, None, :]) @ weight
        for part, block in zip(sums, np.split(jacobian, 3, axis=2), strict=True):
            part += block
        return np.asarray(x @ self.weights[-1].T + self.biases[-1])

    @cached_property
    def _single(self) -> Layers:
        """Weights, transposed, and biases in single precision."""
        return _to_single([(weight.T, bias) for weight, bias in zip(self.weights, self.biases, strict=True)])


@dataclass(frozen=True, eq=False)
class CompiledJointNets(ResidualTerm):
    """The default kind: small nets for each joint, averaged over members, SiLU inside.

    A joint's inputs are dq, ddq, tanh(dq / v₁), tanh(dq / v₂), its rigid torque τ, and √(τ² + ε²) tanh(dq / v₁).
    A layer's weights have shape (members, n, in, out), its biases (members, n, out).

    Attributes:
        bounds: Speeds, accelerations and loads of the training; beyond them the net gives what it gives at their edge.
    """

    bounds: NetBounds | None = None

    @classmethod
    def from_residual(cls, net: ResidualNet) -> CompiledJointNets:
        """Reads a trained net of the `default` preset."""
        network = net.network
        assert isinstance(network, JointNets)
        shape = (network.members, network.joints)
        weights = [w.astype(float).reshape(*shape, *w.shape[1:]) for w in network.weights]
        biases = [b.astype(float).reshape(*shape, -1) for b in network.biases]
        biases[0] = biases[0] - np.einsum("ni,mnio->mno", net.input_mean / net.input_std, weights[0])
        weights[0] = weights[0] / net.input_std[:, :, None]
        weights[-1] = weights[-1] * net.output_std[:, None, None]
        biases[-1] = biases[-1] * net.output_std[:, None]
        return cls(tuple(weights), tuple(biases), net.bounds)

    def frozen(self, positions: Float[Array, " k"]) -> CompiledJointNets:
        """As in `ResidualTerm`: joints know nothing of each other."""
        return self.of_joints(slice(0, self.weights[0].shape[1] - len(positions)))

    def of_joints(self, joints: slice) -> CompiledJointNets:
        """The nets of some joints."""
        bounds = None if self.bounds is None else self.bounds.of_joints(joints)
        return CompiledJointNets(
            tuple(w[:, joints] for w in self.weights), tuple(b[:, joints] for b in self.biases), bounds
        )

    def _clip(self, j: int, inputs: Array) -> Array:
        """Speed, acceleration and load of one joint, moved to the edge of its training where they lie outside."""
        if self.bounds is None:
            return inputs
        return np.clip(inputs, self.bounds.low[:, j, None], self.bounds.high[:, j, None])

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """As in `ResidualTerm`; the position enters by the rigid torque alone."""
        joints = range(dq.shape[1])
        return np.stack([self.joint_torque(j, dq[:, j], ddq[:, j], rigid[:, j]) for j in joints], axis=1)

    def joint_torque(
        self, j: int, dq: Float[Array, " T"], ddq: Float[Array, " T"], rigid: Float[Array, " T"]
    ) -> Float[Array, " T"]:
        """Residual torque of one joint [N m]."""
        inputs = self._clip(j, np.stack([dq, ddq, rigid])).astype(np.float32)
        *layers, (last, offset) = self._single[j]
        found = []
        for part in _chunks(inputs.T):
            x = _features(*part.T)
            for weight, bias in layers:
                x = silu(x @ weight + bias)
            found.append(x @ last[:, 0] + offset)
        return np.concatenate(found).astype(float)

    def joint_slopes(
        self, j: int, dq: Float[Array, " T"], ddq: Float[Array, " T"], rigid: Float[Array, " T"]
    ) -> tuple[Float[Array, " T"], Float[Array, "3 T"]]:
        """Residual torque of one joint and its slopes by its own speed, acceleration and load, in double precision."""
        given = np.stack([dq, ddq, rigid])
        v, a, load = clipped = self._clip(j, given)
        near, far = (np.tanh(v / scale) for scale in DIRECTION_SCALES)
        rounded, one, zero = np.hypot(load, LOAD_ROUNDING), np.ones_like(v), np.zeros_like(v)
        steep, flat = (1.0 - near**2) / DIRECTION_SCALES[0], (1.0 - far**2) / DIRECTION_SCALES[1]
        x = _features(v, a, load)
        by_speed = np.stack([one, zero, steep, flat, zero, rounded * steep], axis=1)
        by_acceleration = np.stack([zero, one, zero, zero, zero, zero], axis=1)
        by_load = np.stack([zero, zero, zero, zero, one, near * load / rounded], axis=1)
        tangents = np.stack([by_speed, by_acceleration, by_load])
        *layers, (last, offset) = self.side_by_side(j)
        for weight, bias in layers:
            x, tangents = x @ weight + bias, tangents @ weight
            gate = 0.5 * (1.0 + np.tanh(0.5 * x))
            tangents *= gate * (1.0 + x * (1.0 - gate))
            x = x * gate
        # Beyond the training's edge the net stays as it is.
        return (x @ last + offset)[:, 0], (tangents @ last)[:, :, 0] * (given == clipped)

    def add_slopes(self, states: list[Array], rigid: Float[Array, "T n"], sums: tuple[Array, Array, Array]) -> Array:
        """As in `ResidualTerm`; a joint's net sees its load, so the chain rule goes through that."""
        _, dq, ddq = states
        value = np.empty(dq.shape)
        for j in range(dq.shape[1]):
            value[:, j], slopes = self.joint_slopes(j, dq[:, j], ddq[:, j], rigid[:, j])
            for part in sums:
                part[:, j] *= 1.0 + slopes[2][:, None]
            for part, slope in zip(sums[1:], slopes, strict=False):
                part[:, j, j] += slope
        return value

    def side_by_side(self, j: int) -> Layers:
        """Layers of one joint with all members in one: inner matrices block by block, outputs averaged."""
        weights, biases = [w[:, j] for w in self.weights], [b[:, j] for b in self.biases]
        members = len(weights[0])
        layers = [(np.concatenate(list(weights[0]), axis=1), biases[0].reshape(-1))]
        layers += [(block_diag(*w), b.reshape(-1)) for w, b in zip(weights[1:-1], biases[1:-1], strict=True)]
        return [*layers, (weights[-1].reshape(-1, 1) / members, biases[-1].mean(axis=0))]

    @cached_property
    def _single(self) -> list[Layers]:
        return [_to_single(self.side_by_side(j)) for j in range(self.weights[0].shape[1])]


def _features(v: Float[Array, " T"], a: Float[Array, " T"], load: Float[Array, " T"]) -> Float[Array, "T 6"]:
    """Inputs of a joint's net from its speed, acceleration and load, see `CompiledJointNets`."""
    near, far = (np.tanh(v / scale) for scale in DIRECTION_SCALES)
    return np.stack([v, a, near, far, load, np.hypot(load, LOAD_ROUNDING) * near], axis=1)


def _chunks(x: Float[Array, "T k"]) -> list[Float[Array, "t k"]]:
    """Rows in pieces whose hidden units stay in the processor's cache."""
    return [x[start:stop] for start, stop in pairwise([*range(0, max(len(x), 1), ROWS), len(x)])]


def _to_single(layers: Layers) -> Layers:
    return [(np.ascontiguousarray(w, dtype=np.float32), b.astype(np.float32)) for w, b in layers]
