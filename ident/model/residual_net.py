"""ResidualNet: a network for what the rigid arm and the loss figures leave.

    τ_DNN = DNN(q, dq, ddq)

Two presets. `paper` is the paper's net: 256-512-1024-512-256 tanh, dropout 0.5, Adam, mean square error, 100 epochs,
70 % of the samples for training. `default` has about 1/90 of its parameters and a lower held-out error: a small net a
joint that sees the joint's own speed, acceleration, direction of motion at two scales, and the rigid torque that the
joint carries (itself a function of q, dq, ddq); four members, each trained without another quarter of the recorded
runs (neighbouring samples are copies of each other, so a random split can't tell fitting from memorising), each joint
stopped by its own held-back error, and silent where it doesn't beat "no residual" in torque and energy on the runs that
its members never saw.

Source: paper, eq. 4 and 6 and section 4.1.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import load_file

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.errors import ModelError
from ident.files import atomic_write
from ident.model.checkpoint import Training, save_tensors
from ident.model.net_gate import JointGate, judge_net
from ident.model.networks import DenseNet, JointNets, Network
from ident.model.torch_threads import torch_threads
from ident.reading import read_json, require_regular

Progress = Callable[[int, int, float], None]

# Speeds at which the direction features bend [rad/s]: the transition at a reversal, and the Stribeck zone.
DIRECTION_SCALES = (0.02, 0.15)
# Rounds the corner of |τ| so that gradients exist at zero [N m].
LOAD_ROUNDING = 0.5
# Figures a joint that a net a joint is given.
JOINT_FEATURES = 6
# A short recording still gets this many steps an epoch, as long as a step sees enough samples.
LEAST_STEPS, LEAST_BATCH = 32, 16
# Length of the stretches that are held back as a whole [samples].
STRETCH = 200


@dataclass(frozen=True)
class NetOptions:
    """How a net is built and trained.

    Attributes:
        preset: `default` (a net a joint) or `paper` (one dense net).
        hidden: Widths of the hidden layers.
        members: Nets that are averaged, each with another part of the data held back.
        dropout: Dropout rate of the hidden layers while training (dense net).
        epochs: Most epochs.
        patience: Epochs without any better held-back error before training stops; 0 never stops early.
        batch: Most samples a step.
        learning_rate, weight_decay: Of Adam (AdamW where the decay is not zero).
        validation_share: Share of single samples held back; where it is 0, whole stretches are, by member.
        cosine: Whether the learning rate falls along a half cosine.
        seed: Seeds the weights, the split and the order of the samples.
    """

    preset: str = "default"
    hidden: tuple[int, ...] = (24, 16)
    members: int = 4
    dropout: float = 0.0
    epochs: int = 100
    patience: int = 20
    batch: int = 256
    learning_rate: float = 4e-3
    weight_decay: float = 2e-2
    validation_share: float = 0.0
    cosine: bool = True
    seed: int = 0


PRESETS = {
    "default": NetOptions(),
    "paper": NetOptions(
        preset="paper",
        hidden=(256, 512, 1024, 512, 256),
        members=1,
        dropout=0.5,
        epochs=100,
        patience=0,
        batch=128,
        learning_rate=1e-3,
        weight_decay=0.0,
        validation_share=0.3,
        cosine=False,
    ),
}


@dataclass(frozen=True, eq=False)
class TrainingHistory:
    """Mean square errors, in units of each joint's residual variance, epoch by epoch."""

    train: tuple[float, ...]
    validation: tuple[float, ...]
    best_epoch: int


@dataclass(frozen=True, eq=False)
class ResidualNet:
    """A trained net.

    Attributes:
        options: How it was built.
        network: The torch module, in evaluation mode; treat as read-only.
        input_mean, input_std: Standardisation of the features, shape (f,) for the dense net, (n, f) for a net a joint.
        output_std: Scale of each joint's output [N m], shape (n,).
        history: Errors while training, if it was trained here.
        gate: What the net did on runs that it never saw, joint by joint, if it was trained here.
    """

    options: NetOptions
    network: Network
    input_mean: Float[Array, "..."]
    input_std: Float[Array, "..."]
    output_std: Float[Array, " n"]
    history: TrainingHistory | None = None
    gate: tuple[JointGate, ...] = ()

    @property
    def n(self) -> int:
        """Number of joints."""
        return len(self.output_std)

    @property
    def parameters(self) -> int:
        """Number of trained weights."""
        return sum(weight.numel() for weight in self.network.parameters())

    def predict(
        self,
        q: Float[Array, "T n"],
        dq: Float[Array, "T n"],
        ddq: Float[Array, "T n"],
        rigid: Float[Array, "T n"],
    ) -> Float[Array, "T n"]:
        """Residual torque [N m], the mean over the members.

        Args:
            q, dq, ddq: Joint states.
            rigid: Torque of the rigid arm at these states, which the net was trained with [N m].

        Source: paper, eq. 4.
        """
        x = (compute_features(q, dq, ddq, rigid, self.options.preset) - self.input_mean) / self.input_std
        with torch.inference_mode():
            y = self.network(torch.from_numpy(x.astype(np.float32))).mean(dim=0).numpy()
        return y.astype(float) * self.output_std

    def save(self, folder: Path) -> None:
        """Writes residual.safetensors and residual.json into a folder."""
        with atomic_write(folder / "residual.safetensors") as part:
            save_tensors(self.network.state_dict(), part)
        record: dict[str, Any] = {"options": asdict(self.options), "parameters": self.parameters}
        for name in ("input_mean", "input_std", "output_std"):
            record[name] = getattr(self, name).tolist()
        with atomic_write(folder / "residual.json") as part:
            part.write_text(json.dumps(record, indent=1), encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> ResidualNet:
        """Reads a saved net.

        Raises:
            ModelError: A file is missing or damaged.
        """
        path = folder / "residual.json"
        try:
            record = read_json(path, "fit the model again", ModelError)
            fields = dict(record["options"])
            options = NetOptions(**{**fields, "hidden": tuple(fields["hidden"])})
            mean, std, scale = (freeze(record[name]) for name in ("input_mean", "input_std", "output_std"))
            weights = folder / "residual.safetensors"
            size = require_regular(weights, "fit the model again", ModelError)
            # A file's options decide how much memory a net takes: its weights must be there before they are believed.
            if 4 * _count_weights(mean.shape[-1], len(scale), options) > size:
                raise ValueError("its options speak of more weights than there are")
            network = _build(mean.shape[-1], len(scale), options)
            network.load_state_dict(load_file(weights))
            if not all(bool(torch.isfinite(tensor).all()) for tensor in network.state_dict().values()):
                raise ValueError("a weight is not finite")
            inputs = (3 * len(scale),) if options.preset == "paper" else (len(scale), JOINT_FEATURES)
            if not mean.shape == std.shape == inputs or scale.ndim != 1:
                raise ValueError("its scales are of another number of joints or inputs")
            # Nets reckon in single precision: what overflows there is no scale.
            with np.errstate(over="ignore"):
                scales = [np.asarray(values, dtype=np.float32) for values in (mean, std, scale)]
            if not all(np.isfinite(values).all() for values in scales) or not (scales[1] > 0).all():
                raise ValueError("a scale is not finite and positive")
        except ModelError:
            raise
        except Exception as error:  # torch, safetensors and json each raise their own
            raise ModelError(path, f"the saved net can't be read ({error})", "fit the model again") from None
        network.eval()
        return cls(options, network, mean, std, scale)


def compute_features(
    q: Float[Array, "T n"], dq: Float[Array, "T n"], ddq: Float[Array, "T n"], rigid: Float[Array, "T n"], preset: str
) -> Float[Array, "T ..."]:
    """Inputs of a net: (q, dq, ddq) in one row for the paper's, shape (T, 3n); six figures a joint else, (T, n, 6).

    The six: dq, ddq, tanh(dq / v) at two scales v, the rigid torque τ, and √(τ² + ε²) tanh(dq / v) at the first.
    """
    if preset == "paper":
        return np.concatenate([q, dq, ddq], axis=1)
    near, far = (np.tanh(dq / scale) for scale in DIRECTION_SCALES)
    return np.stack([dq, ddq, near, far, rigid, np.hypot(rigid, LOAD_ROUNDING) * near], axis=-1)


def _count_weights(inputs: int, joints: int, options: NetOptions) -> int:
    """Fewest weights that a net of some options has: those of its widest layers."""
    widths = [inputs, *map(int, options.hidden), 1]
    if min(widths) < 1 or options.members < 1:
        raise ValueError(f"its layers are {options.hidden} wide")
    nets = 1 if options.preset == "paper" else options.members * joints
    return nets * sum(a * b for a, b in pairwise(widths))


def _build(inputs: int, joints: int, options: NetOptions) -> Network:
    if options.preset == "paper":
        return DenseNet(inputs, joints, options.hidden, options.dropout)
    return JointNets(options.members, joints, inputs, options.hidden)


@dataclass(frozen=True, eq=False)
class _Data:
    """What a training sees: standardised inputs and targets, where they count, and what each member holds back."""

    inputs: torch.Tensor  # (T, ...)
    targets: torch.Tensor  # (T, n)
    mask: torch.Tensor  # (T, n)
    held: torch.Tensor  # (members, T)

    def errors(self, network: Network, rows: torch.Tensor, held: bool) -> torch.Tensor:
        """Mean square error by member and joint over the rows that count, shape (members, n)."""
        side = self.held[:, rows] if held else 1.0 - self.held[:, rows]
        weight = side[:, :, None] * self.mask[rows]
        squares = weight * (network(self.inputs[rows]) - self.targets[rows]) ** 2
        return squares.sum(dim=1) / weight.sum(dim=1).clamp(min=1.0)


def _groups(lengths: Sequence[int], options: NetOptions) -> Int[Array, " T"]:
    """What is held back as a whole: runs, or stretches of them where there are fewer runs than members."""
    if len(lengths) >= 2 * options.members:
        return np.repeat(np.arange(len(lengths)), lengths)
    samples = sum(lengths)
    return np.arange(samples) // min(STRETCH, max(1, samples // (2 * options.members)))


def _held_back(groups: Int[Array, " T"], options: NetOptions, rng: np.random.Generator) -> Bool[Array, "members T"]:
    """What each member does not train on: parts of about the same size, or single samples as in the paper."""
    samples = len(groups)
    if options.validation_share > 0:
        held = np.zeros((options.members, samples), dtype=bool)
        held[:, rng.permutation(samples)[: int(options.validation_share * samples)]] = True
        return held
    sizes = np.bincount(groups)
    order = rng.permutation(len(sizes))
    order = order[np.argsort(-sizes[order], kind="stable")]
    filled, part = np.zeros(max(2, options.members)), np.zeros(len(sizes), dtype=int)
    for group in order:
        part[group] = int(np.argmin(filled))
        filled[part[group]] += sizes[group]
    return part[groups][None, :] == np.arange(options.members)[:, None]


def fit_residual_net(
    states: Sequence[tuple[Array, Array, Array, Array]],
    residuals: Sequence[Float[Array, "T n"]],
    moving: Sequence[Bool[Array, "T n"]] | None = None,
    options: NetOptions | None = None,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    interval: float = 1.0,
) -> ResidualNet:
    """Trains a net on what a model leaves, and silences it where it would not help on runs that it never saw.

    Args:
        states: (q, dq, ddq, rigid torque) of every run, each of shape (T, n).
        residuals: Residual torque of every run [N m].
        moving: Where each joint moves; the torque of a joint at rest is no function of the state and is left out of
            the error. All samples count if None, as in the paper.
        options: Preset or own options.
        progress: Called after each epoch with (epoch, epochs, held-back error).
        checkpoint: Folder for checkpoints; a training of the same data and options goes on where it stopped.
        interval: Time between two samples of a run [s]; gives the gate's energies their unit.

    Returns:
        The net of the best epoch (the last one where `patience` is zero). Same seed, same weights.

    Source: paper, eq. 6.
    """
    options = options or PRESETS["default"]
    x = np.concatenate([compute_features(*state, options.preset) for state in states])
    y = np.concatenate(list(residuals))
    mask = np.ones_like(y) if moving is None else np.concatenate(list(moving)).astype(float)
    mean, std = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-6)
    scale = np.maximum(np.sqrt((mask * y**2).sum(axis=0) / np.maximum(mask.sum(axis=0), 1.0)), 1e-9)
    groups = _groups([len(part) for part in residuals], options)
    held = _held_back(groups, options, np.random.default_rng(options.seed))
    data = _Data(*(torch.from_numpy(part.astype(np.float32)) for part in ((x - mean) / std, y / scale, mask, held)))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.seed)
        network = _build(x.shape[-1], y.shape[1], options)
        # One thread: a net's sums, and so its weights, depend on how many there are, and Pinocchio changes their
        # number. On a busy machine more only wait for each other.
        with torch_threads(1):
            training = _train(network, data, options, progress, checkpoint)
    if options.patience and training.best:
        network.load_state_dict(training.best)
    network.eval()
    history = TrainingHistory(tuple(training.train), tuple(training.validation), training.best_epoch)
    gate: tuple[JointGate, ...] = ()
    if isinstance(network, JointNets):
        travel = interval * np.concatenate([state[1] for state in states])
        gate = judge_net(scale * _unseen(network, data), y, mask > 0.0, travel, groups)
        network.silence([j for j, one in enumerate(gate) if not one.kept])
    return ResidualNet(options, network, freeze(mean), freeze(std), freeze(scale), history, gate)


def _unseen(network: JointNets, data: _Data) -> Float[Array, "T n"]:
    """Prediction of every sample by the members that did not see it, in units of the targets."""
    with torch.inference_mode():
        weight = data.held[:, :, None] / data.held.sum(dim=0).clamp(min=1.0)[None, :, None]
        return np.asarray((weight * network(data.inputs)).sum(dim=0).numpy(), dtype=float)


def _train(
    network: Network, data: _Data, options: NetOptions, progress: Progress | None, checkpoint: Path | None
) -> Training:
    adam = torch.optim.AdamW if options.weight_decay > 0 else torch.optim.Adam
    optimiser = adam(network.parameters(), lr=options.learning_rate, weight_decay=options.weight_decay)
    silent = data.held[:, :, None] * data.mask
    least = (silent * data.targets**2).sum(dim=1) / silent.sum(dim=1).clamp(min=1.0)
    training = Training(network, optimiser, least)
    network.keep(training.best, torch.zeros_like(least, dtype=torch.bool))
    sums = [float(tensor.double().sum()) for tensor in (data.inputs, data.targets, data.mask)]
    fingerprint = f"{sums} {asdict(options)}"
    if checkpoint is not None:
        training.resume(checkpoint, fingerprint)
    while training.epoch < options.epochs and not _stalled(training, options):
        _one_epoch(training, data, options)
        if checkpoint is not None and training.epoch % 10 == 0:
            training.save(checkpoint, fingerprint)
        if progress is not None:
            progress(training.epoch, options.epochs, training.validation[-1])
    return training


def _stalled(training: Training, options: NetOptions) -> bool:
    return bool(options.patience) and training.epoch - training.best_epoch >= options.patience


def _one_epoch(training: Training, data: _Data, options: NetOptions) -> None:
    """One pass in an order that depends on seed and epoch alone, so that a resumed training is the same training."""
    torch.manual_seed(options.seed * 100_003 + training.epoch)  # dropout's masks
    some = torch.nonzero((data.held == 0).any(dim=0))[:, 0]
    order = np.random.default_rng((options.seed, training.epoch)).permutation(some.numpy())
    if options.cosine:
        rate = 0.5 * options.learning_rate * (1 + np.cos(np.pi * training.epoch / options.epochs))
        for group in training.optimiser.param_groups:
            group["lr"] = float(rate)
    network, total = training.network, 0.0
    network.train()
    batch = min(options.batch, max(LEAST_BATCH, len(order) // LEAST_STEPS))
    for start in range(0, len(order), batch):
        rows = torch.from_numpy(order[start : start + batch])
        training.optimiser.zero_grad(set_to_none=True)
        loss = data.errors(network, rows, held=False).mean()
        loss.backward()
        training.optimiser.step()
        total += float(loss.detach()) * len(rows)
    network.eval()
    with torch.inference_mode():
        errors = data.errors(network, torch.arange(len(data.targets)), held=True)
    better = errors < training.least if options.preset != "paper" else (errors.mean() < training.least.mean())
    training.epoch += 1
    training.train.append(total / len(order))
    training.validation.append(float(errors.mean()))
    if bool(better.any()):
        network.keep(training.best, better)
        training.least = torch.where(better, errors, training.least)
        training.best_epoch = training.epoch
