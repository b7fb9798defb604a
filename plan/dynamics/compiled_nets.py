"""Residual nets as plain layers, so that they can be evaluated in batches here and written into CasADi elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from ident.arrays import Array, Float
from ident.model.joint_nets import JointNets, NetBounds
from ident.model.residual_net import DIRECTION_SCALES, LOAD_ROUNDING, ResidualNet

if TYPE_CHECKING:
    import torch  # slow to load: a task without a net does without


class ResidualTerm(Protocol):
    """What the planner needs of a net."""

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """Residual torque, computed in single precision [N m]."""

    def frozen(self, positions: Float[Array, " k"]) -> ResidualTerm:
        """The net of the first joints, with the last k joints at rest at given positions [rad]: exact."""


def read_residual(net: ResidualNet) -> ResidualTerm:
    """A trained net as plain layers, its standardisation folded in; what evaluates it is loaded with it."""
    import torch  # noqa: F401  here, and not in the midst of a search, which tells torch how many threads it may use

    if isinstance(net.network, JointNets):
        return CompiledJointNets.from_residual(net)
    return CompiledDenseNet.from_residual(net)


@dataclass(frozen=True, eq=False)
class CompiledDenseNet:
    """The paper's kind: one fully connected net from (q, dq, ddq) to all torques, tanh inside.

    Attributes:
        weights: One matrix a layer, shape (out, in).
        biases: One vector a layer.
    """

    weights: tuple[Float[Array, "o i"], ...]
    biases: tuple[Float[Array, " o"], ...]

    @classmethod
    def from_residual(cls, net: ResidualNet) -> CompiledDenseNet:
        """Reads a trained net of the `paper` preset."""
        import torch

        assert not isinstance(net.network, JointNets)
        linear = [module for module in net.network.modules() if isinstance(module, torch.nn.Linear)]
        weights = [module.weight.detach().numpy().astype(float) for module in linear]
        biases = [module.bias.detach().numpy().astype(float) for module in linear]
        biases[0] = biases[0] - weights[0] @ (net.input_mean / net.input_std)
        weights[0] = weights[0] / net.input_std
        weights[-1] = weights[-1] * net.output_std[:, None]
        biases[-1] = biases[-1] * net.output_std
        return cls(tuple(weights), tuple(biases))

    def frozen(self, positions: Float[Array, " k"]) -> CompiledDenseNet:
        """As in `ResidualTerm`: the held joints' inputs are constants and go into the first bias."""
        total = self.weights[-1].shape[0]
        kept = total - len(positions)
        held = np.zeros(self.weights[0].shape[1])
        held[kept:total] = positions
        columns = np.concatenate([np.arange(kept) + total * part for part in range(3)])
        biases = (self.biases[0] + self.weights[0] @ held, *self.biases[1:-1], self.biases[-1][:kept])
        weights = (self.weights[0][:, columns], *self.weights[1:-1], self.weights[-1][:kept])
        return CompiledDenseNet(weights, biases)

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""
        return sum(weight.size for weight in self.weights)

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """As in `ResidualTerm`; the rigid torque is not looked at."""
        import torch

        x = torch.from_numpy(np.concatenate([q, dq, ddq], axis=-1).astype(np.float32))
        with torch.inference_mode():
            return self.after_first(torch.nn.functional.linear(x, *self._single[0])).numpy().astype(float)

    def after_first(self, x: torch.Tensor) -> torch.Tensor:
        """Torque from the first layer's sums, before its activation."""
        import torch

        with torch.inference_mode():
            for weight, bias in self._single[1:]:
                x = torch.nn.functional.linear(torch.tanh(x), weight, bias)
            return x

    @cached_property
    def _single(self) -> list[tuple[torch.Tensor, torch.Tensor]]:
        return [(_to_single(w), _to_single(b)) for w, b in zip(self.weights, self.biases, strict=True)]


@dataclass(frozen=True, eq=False)
class CompiledJointNets:
    """The default kind: small nets for each joint, averaged over members, SiLU inside.

    A joint's inputs are dq, ddq, tanh(dq / v₁), tanh(dq / v₂), its rigid torque τ, and √(τ² + ε²) tanh(dq / v₁).

    Attributes:
        weights: One array a layer, shape (members, n, in, out).
        biases: One array a layer, shape (members, n, out).
        bounds: Speeds, accelerations and loads of the training; beyond them the net says what it says at their edge.
    """

    weights: tuple[Float[Array, "m n i o"], ...]
    biases: tuple[Float[Array, "m n o"], ...]
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

    def clip(self, j: int, *inputs: Array) -> tuple[Array, ...]:
        """Speed, acceleration and load of one joint, moved to the edge of its training where they lie outside."""
        if self.bounds is None:
            return inputs
        edges = zip(inputs, self.bounds.low[:, j], self.bounds.high[:, j], strict=True)
        return tuple(np.clip(part, low, high) for part, low, high in edges)

    @property
    def products(self) -> int:
        """Multiplications of one evaluation."""
        return sum(weight.size for weight in self.weights)

    def torque(
        self, q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"]
    ) -> Float[Array, "T n"]:
        """As in `ResidualTerm`; the position enters by the rigid torque alone."""
        joints = dq.shape[1]
        out = np.empty(dq.shape)
        for j in range(joints):
            out[:, j] = self.joint_torque(j, dq[:, j], ddq[:, j], rigid[:, j])
        return out

    def joint_torque(
        self, j: int, dq: Float[Array, " T"], ddq: Float[Array, " T"], rigid: Float[Array, " T"]
    ) -> Float[Array, " T"]:
        """Residual torque of one joint [N m]."""
        import torch

        clipped = self.clip(j, dq, ddq, rigid)
        v, a, load = (torch.from_numpy(np.asarray(part, dtype=np.float32)) for part in clipped)
        with torch.inference_mode():
            near, far = (torch.tanh(v / scale) for scale in DIRECTION_SCALES)
            rounded = torch.sqrt(load * load + LOAD_ROUNDING**2) * near
            x = torch.stack([v, a, near, far, load, rounded], dim=1)
            for weight, bias in self._single[j][:-1]:
                x = torch.nn.functional.silu(torch.addmm(bias, x, weight))
            weight, bias = self._single[j][-1]
            return torch.addmv(bias, x, weight[:, 0]).numpy().astype(float)

    def side_by_side(self, j: int) -> list[tuple[Float[Array, "i o"], Float[Array, " o"]]]:
        """Layers of one joint with all members in one: inner matrices block by block, outputs averaged."""
        weights, biases = [w[:, j] for w in self.weights], [b[:, j] for b in self.biases]
        members = len(weights[0])
        layers = [(np.concatenate(list(weights[0]), axis=1), biases[0].reshape(-1))]
        layers += [(_block_diagonal(w), b.reshape(-1)) for w, b in zip(weights[1:-1], biases[1:-1], strict=True)]
        return [*layers, (weights[-1].reshape(-1, 1) / members, biases[-1].mean(axis=0))]

    @cached_property
    def _single(self) -> list[list[tuple[torch.Tensor, torch.Tensor]]]:
        return [
            [(_to_single(weight), _to_single(bias)) for weight, bias in self.side_by_side(j)]
            for j in range(self.weights[0].shape[1])
        ]


def _block_diagonal(blocks: Float[Array, "m i o"]) -> Float[Array, "mi mo"]:
    members, rows, columns = blocks.shape
    out = np.zeros((members * rows, members * columns))
    for m, block in enumerate(blocks):
        out[m * rows : (m + 1) * rows, m * columns : (m + 1) * columns] = block
    return out


def _to_single(values: Array) -> torch.Tensor:
    import torch

    return torch.from_numpy(np.ascontiguousarray(values, dtype=np.float32))
