"""Training of the paper's kind of net, in steps, by torch.

Source: paper, eq. 6 and section 4.1.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch

from ident.arrays import Array, Float
from ident.model.checkpoint import Training
from ident.model.net_options import NetOptions, TrainingHistory
from ident.model.networks import DenseNet
from ident.model.torch_threads import torch_threads

Progress = Callable[[int, int, float], None]

# A short recording still gets this many steps an epoch, as long as a step sees enough samples.
LEAST_STEPS, LEAST_BATCH = 32, 16


def train_dense(
    x: Float[Array, "T f"],
    y: Float[Array, "T n"],
    mask: Float[Array, "T n"],
    options: NetOptions,
    progress: Progress | None,
    checkpoint: Path | None,
) -> tuple[DenseNet, TrainingHistory]:
    """A dense net in evaluation mode, and how its errors fell.

    Args:
        x, y: Standardised inputs and targets.
        mask: What counts.
        options: Its own.
        progress: Called after each epoch with (epoch, epochs, held-back error).
        checkpoint: Folder for checkpoints; a training of the same data and options goes on where it stopped.
    """
    held = np.zeros((1, len(x)), dtype=bool)
    held[:, np.random.default_rng(options.seed).permutation(len(x))[: int(options.validation_share * len(x))]] = True
    data = _Data(*(torch.from_numpy(part.astype(np.float32)) for part in (x, y, mask, held)))
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.seed)
        network = DenseNet(x.shape[1], y.shape[1], options.hidden, options.dropout)
        # One thread: a net's sums, and so its weights, depend on how many there are, and Pinocchio changes their
        # number. On a busy machine more only wait for each other.
        with torch_threads(1):
            training = _train(network, data, options, progress, checkpoint)
    if options.patience and training.best:
        network.load_state_dict(training.best)
    network.eval()
    return network, TrainingHistory(tuple(training.train), tuple(training.validation), training.best_epoch)


def run_dense(network: DenseNet, x: Float[Array, "T f"]) -> Float[Array, "T n"]:
    """Outputs of a dense net."""
    with torch.inference_mode():
        return np.asarray(network(torch.from_numpy(x.astype(np.float32)))[0].numpy(), dtype=float)


def dense_from_arrays(arrays: dict[str, Array], inputs: int, outputs: int, options: NetOptions) -> DenseNet:
    """A dense net from its named weights; torch's own errors where they don't fit."""
    network = DenseNet(inputs, outputs, options.hidden, options.dropout)
    network.load_state_dict({name: torch.from_numpy(value) for name, value in arrays.items()})
    network.eval()
    return network


def dense_arrays(network: DenseNet) -> dict[str, Array]:
    """Its weights by name."""
    return {name: value.detach().numpy() for name, value in network.state_dict().items()}


@dataclass(frozen=True, eq=False)
class _Data:
    """What a training sees: standardised inputs and targets, where they count, and what each member holds back."""

    inputs: torch.Tensor  # (T, ...)
    targets: torch.Tensor  # (T, n)
    mask: torch.Tensor  # (T, n)
    held: torch.Tensor  # (members, T)

    def errors(self, network: DenseNet, rows: torch.Tensor, held: bool) -> torch.Tensor:
        """Mean square error by member and joint over the rows that count, shape (members, n)."""
        side = self.held[:, rows] if held else 1.0 - self.held[:, rows]
        weight = side[:, :, None] * self.mask[rows]
        squares = weight * (network(self.inputs[rows]) - self.targets[rows]) ** 2
        return squares.sum(dim=1) / weight.sum(dim=1).clamp(min=1.0)


def _train(
    network: DenseNet, data: _Data, options: NetOptions, progress: Progress | None, checkpoint: Path | None
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
    better = errors.mean() < training.least.mean()
    training.epoch += 1
    training.train.append(total / len(order))
    training.validation.append(float(errors.mean()))
    if bool(better.any()):
        network.keep(training.best, better)
        training.least = torch.where(better, errors, training.least)
        training.best_epoch = training.epoch
