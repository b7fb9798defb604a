"""The paper's net in torch: its layers, and its training, which can be stopped and resumed.

Source: paper, eq. 6 and section 4.1.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from errno import EIO
from itertools import pairwise
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from ident.arrays import Array, Float
from ident.files import atomic_write
from ident.model.net_options import KIND, NAME, NetOptions, torch_threads
from ident.outputs import begin_folder

Progress = Callable[[int, int, float], None]

# A short recording still gets this many steps an epoch, as long as a step sees enough samples.
LEAST_STEPS = 32
LEAST_BATCH = 16
# Epochs between two checkpoints.
KEPT_EVERY = 10


class DenseNet(torch.nn.Module):
    """One multilayer perceptron from the whole state to all joints: (T, f) to (T, n)."""

    def __init__(self, inputs: int, outputs: int, hidden: Sequence[int], dropout: float) -> None:
        super().__init__()
        modules: list[torch.nn.Module] = []
        for before, after in pairwise([inputs, *hidden]):
            modules += [
                torch.nn.Linear(before, after),
                torch.nn.Tanh(),
                torch.nn.Dropout(dropout),
            ]
        last = torch.nn.Linear([inputs, *hidden][-1], outputs)
        self.stack = torch.nn.Sequential(*modules, last)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Outputs for a batch of inputs: (B, inputs) to (B, outputs), both scaled."""
        return self.stack(x)

    @classmethod
    def from_arrays(
        cls, arrays: dict[str, Array], inputs: int, outputs: int, options: NetOptions
    ) -> DenseNet:
        """A net in evaluation mode from its named weights.

        Raises:
            RuntimeError: They don't fit: torch's own error.
        """
        network = cls(inputs, outputs, options.hidden, options.dropout)
        network.load_state_dict({name: torch.from_numpy(value) for name, value in arrays.items()})
        return network.eval()

    def arrays(self) -> dict[str, Array]:
        """Its weights by name."""
        return {name: value.detach().numpy() for name, value in self.state_dict().items()}

    def run(self, x: Float[Array, "T f"]) -> Float[Array, "T n"]:
        """Its outputs."""
        with torch.inference_mode():
            return np.asarray(self(torch.from_numpy(x.astype(np.float32))).numpy(), dtype=float)


def train_dense(
    x: Float[Array, "T f"],
    y: Float[Array, "T n"],
    mask: Float[Array, "T n"],
    options: NetOptions,
    progress: Progress | None,
    checkpoint: Path | None,
) -> DenseNet:
    """A dense net in evaluation mode.

    Args:
        x, y: Standardised inputs and targets.
        mask: What counts.
        options: Its own.
        progress: Called after each epoch with (epoch, epochs, held-back error).
        checkpoint: Folder for checkpoints; a training of the same data and options goes on where it
            stopped.
    """
    held = np.zeros(len(x), dtype=bool)
    order = np.random.default_rng(options.seed).permutation(len(x))
    held[order[: int(options.validation_share * len(x))]] = True
    inputs, targets, weights = (
        torch.from_numpy(values.astype(np.float32)) for values in (x, y, mask)
    )
    data = _Data(inputs, targets, weights, held)
    sums = [float(values.double().sum()) for values in data.tensors]
    fingerprint = f"{sums} {asdict(options)}"
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(options.seed)
        network = DenseNet(x.shape[1], y.shape[1], options.hidden, options.dropout)
        training = Training(network, options.learning_rate)
        if checkpoint is not None:
            training.resume(checkpoint, fingerprint)
        # One thread: a net's sums, and so its weights, depend on how many there are, and Pinocchio
        # changes their number. On a busy machine more only wait for each other.
        with torch_threads(1):
            while training.epoch < options.epochs:
                error = training.run_epoch(data, options)
                if checkpoint is not None and training.epoch % KEPT_EVERY == 0:
                    training.save(checkpoint, fingerprint)
                if progress is not None:
                    progress(training.epoch, options.epochs, error)
    return training.network.eval()


@dataclass(frozen=True, eq=False)
class _Data:
    """What a training sees: standardised inputs and targets, and where they count."""

    inputs: torch.Tensor  # (T, f)
    targets: torch.Tensor  # (T, n)
    mask: torch.Tensor  # (T, n)
    held: Array  # which samples are held back, (T,)

    @property
    def tensors(self) -> tuple[torch.Tensor, ...]:
        return self.inputs, self.targets, self.mask

    def error(self, network: DenseNet, rows: Array) -> torch.Tensor:
        """Mean square error over the rows that count, of all joints alike."""
        inputs, targets, mask = (values[torch.from_numpy(rows)] for values in self.tensors)
        squares = mask * (network(inputs) - targets) ** 2
        return (squares.sum(dim=0) / mask.sum(dim=0).clamp(min=1.0)).mean()


@dataclass
class Training:
    """A training that can be stopped at any moment and resumed; a checkpoint holds all of it."""

    network: DenseNet
    learning_rate: float
    epoch: int = 0

    def __post_init__(self) -> None:
        self.optimiser = torch.optim.Adam(self.network.parameters(), lr=self.learning_rate)

    def run_epoch(self, data: _Data, options: NetOptions) -> float:
        """The held-back error after one pass in an order that depends on seed and epoch alone.

        A resumed training is the same training.
        """
        torch.manual_seed(options.seed * 100_003 + self.epoch)  # dropout's masks
        rng = np.random.default_rng((options.seed, self.epoch))
        order = rng.permutation(np.flatnonzero(~data.held))
        batch = min(options.batch, max(LEAST_BATCH, len(order) // LEAST_STEPS))
        self.network.train()
        for start in range(0, len(order), batch):
            rows = order[start : start + batch]
            self.optimiser.zero_grad(set_to_none=True)
            data.error(self.network, rows).backward()
            self.optimiser.step()
        self.network.eval()
        self.epoch += 1
        with torch.inference_mode():
            return float(data.error(self.network, np.flatnonzero(data.held)))

    def save(self, folder: Path, fingerprint: str) -> None:
        """Writes the checkpoint as one file: tensors, and the epoch as its metadata.

        Raises:
            OSError: The system can't: the disk is full, say.
        """
        tensors = {}
        for name, value in self.network.state_dict().items():
            tensors[f"now.{name}"] = value.contiguous()
        for index, entry in self.optimiser.state_dict()["state"].items():
            for name, value in entry.items():
                tensors[f"adam.{index}.{name}"] = torch.as_tensor(value)
        metadata = {"fingerprint": fingerprint, "epoch": str(self.epoch)}
        begin_folder(folder, KIND)
        with atomic_write(folder / NAME) as file:
            try:
                save_file(tensors, file, metadata)
            except SafetensorError as error:
                raise OSError(EIO, str(error), str(file)) from None

    def resume(self, folder: Path, fingerprint: str) -> None:
        """Takes up a checkpoint of the same data and options, if one can be read whole."""
        path = folder / NAME
        if path.is_symlink() or not path.is_file():
            return
        before = copy.deepcopy((self.network.state_dict(), self.optimiser.state_dict()))
        try:
            # Opened once: another run may put its own in the file's place.
            with safe_open(path, framework="pt") as stream:
                metadata = stream.metadata() or {}
                if metadata.get("fingerprint") == fingerprint:
                    names = stream.keys()
                    tensors = {name: stream.get_tensor(name) for name in names}
                    self._take(tensors, int(metadata["epoch"]))
        except (
            OSError,
            SafetensorError,
            ValueError,
            KeyError,
            IndexError,
            AttributeError,
            TypeError,
            RuntimeError,
        ):
            # Damaged: the training starts afresh and writes it anew.
            self.network.load_state_dict(before[0])
            self.optimiser.load_state_dict(before[1])

    def _take(self, tensors: dict[str, torch.Tensor], epoch: int) -> None:
        if not all(bool(torch.isfinite(value).all()) for value in tensors.values()):
            raise ValueError("a checkpoint of another net")
        by_head: dict[str, dict[str, torch.Tensor]] = {"now": {}, "adam": {}}
        for name, value in tensors.items():
            head, rest = name.split(".", 1)
            by_head[head][rest] = value
        self.network.load_state_dict(by_head["now"])
        state = self.optimiser.state_dict()
        for key, value in by_head["adam"].items():
            index, name = key.split(".")
            state["state"].setdefault(int(index), {})[name] = value
        self.optimiser.load_state_dict(state)
        self.epoch = epoch
