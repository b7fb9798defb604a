"""A training that can be stopped at any moment and resumed: its state, and the file that holds it."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass, field
from errno import EIO
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file

from ident.files import atomic_write
from ident.model.checkpoint_folder import KIND, NAME
from ident.model.networks import DenseNet
from ident.outputs import begin_folder

# Figures of a training that are no tensors.
FIGURES = ("epoch", "best_epoch", "train", "validation")


@dataclass
class Training:
    """State of a training that can be stopped and resumed; all that a checkpoint holds."""

    network: DenseNet
    optimiser: torch.optim.Optimizer
    least: torch.Tensor  # least held-back error by member and joint
    epoch: int = 0
    best: dict[str, torch.Tensor] = field(default_factory=dict)
    best_epoch: int = 0
    train: list[float] = field(default_factory=list)
    validation: list[float] = field(default_factory=list)

    def save(self, folder: Path, fingerprint: str) -> None:
        """Writes the checkpoint as one file: tensors, and the rest as its metadata."""
        tensors = {f"now.{name}": value for name, value in self.network.state_dict().items()}
        tensors |= {f"best.{name}": value for name, value in self.best.items()} | {"least": self.least}
        for index, entry in self.optimiser.state_dict()["state"].items():
            tensors |= {f"adam.{index}.{name}": torch.as_tensor(value) for name, value in entry.items()}
        record = {name: getattr(self, name) for name in FIGURES}
        begin_folder(folder, KIND)
        with atomic_write(folder / NAME) as part:
            metadata = {"fingerprint": fingerprint, "record": json.dumps(record)}
            save_tensors(tensors, part, metadata)

    def resume(self, folder: Path, fingerprint: str) -> None:
        """Takes up a checkpoint of the same data and options, if there is one that can be read whole."""
        path = folder / NAME
        if path.is_symlink() or not path.is_file():
            return
        try:
            with safe_open(path, framework="pt") as stream:
                metadata = stream.metadata() or {}
            if metadata.get("fingerprint") != fingerprint:
                return
            tensors, record = load_file(path), json.loads(metadata["record"])
        except (OSError, SafetensorError, ValueError, KeyError, RecursionError):
            return  # damaged: the training starts afresh and writes it anew
        before = copy.deepcopy((self.network.state_dict(), self.optimiser.state_dict()))
        try:
            self._take(tensors, record)
        except (AttributeError, IndexError, KeyError, RuntimeError, TypeError, ValueError):
            self.network.load_state_dict(before[0])
            self.optimiser.load_state_dict(before[1])

    def _take(self, tensors: dict[str, torch.Tensor], record: dict[str, Any]) -> None:
        def part(prefix: str) -> dict[str, torch.Tensor]:
            return {name[len(prefix) :]: value for name, value in tensors.items() if name.startswith(prefix)}

        figures = [record[name] for name in FIGURES]
        best, least, now = part("best."), tensors["least"], part("now.")
        # A dense net has no best weights before it was better than nothing.
        known = {*best} <= {*now} and {*best} >= {*self.best}
        if least.shape != self.least.shape or not known or not all(map(_is_finite, tensors.values())):
            raise ValueError("a checkpoint of another net")
        self.network.load_state_dict(now)
        state = self.optimiser.state_dict()
        for key, value in part("adam.").items():
            index, name = key.split(".")
            state["state"].setdefault(int(index), {})[name] = value
        self.optimiser.load_state_dict(state)
        self.best, self.least = best, least
        for name, value in zip(FIGURES, figures, strict=True):
            setattr(self, name, value)


def _is_finite(tensor: torch.Tensor) -> bool:
    return bool(torch.isfinite(tensor).all())


def save_tensors(tensors: dict[str, torch.Tensor], path: Path, metadata: dict[str, str] | None = None) -> None:
    """Writes tensors as safetensors.

    Raises:
        OSError: The system can't: the disk is full, say.
    """
    try:
        save_file({name: value.contiguous() for name, value in tensors.items()}, path, metadata)
    except SafetensorError as error:
        raise OSError(EIO, str(error), str(path)) from None
