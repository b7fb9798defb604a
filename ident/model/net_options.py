"""How residual nets are built and trained: the two presets.

The folder in which a training may stop and go on.

How many threads torch may use: one in trainings and searches, whose batches are too small to share.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from ident.files import clear_temporaries
from ident.outputs import MARKER, is_begun

NAME = "checkpoint.safetensors"
# What a checkpoint's folder is marked as.
KIND = "training"


@dataclass(frozen=True)
class NetOptions:
    """How a net is built and trained.

    A net a joint is solved for, not trained, and takes of these the seed alone.
    """

    preset: str = "default"  # `default` (a net a joint) or `paper` (one dense net)
    hidden: tuple[int, ...] = (268,)  # widths of the hidden layers; a net a joint has this one
    dropout: float = 0.0  # dropout rate of the hidden layers while training
    epochs: int = 100  # number of epochs
    batch: int = 256  # most samples a step
    learning_rate: float = 4e-3  # of Adam
    validation_share: float = 0.0  # share of single samples held back
    seed: int = 0  # seeds the weights, the split and the order of the samples


PRESETS = {
    "default": NetOptions(),
    "paper": NetOptions(
        preset="paper",
        hidden=(256, 512, 1024, 512, 256),
        dropout=0.5,
        batch=128,
        learning_rate=1e-3,
        validation_share=0.3,
    ),
}


def remove_checkpoint(folder: Path) -> None:
    """A finished training needs its checkpoint no more, nor what killed ones left beside it."""
    if not is_begun(folder, KIND):
        return
    clear_temporaries(folder / NAME)
    for name in (NAME, MARKER):
        (folder / name).unlink(missing_ok=True)
    with suppress(OSError):  # something else lies in it: that stays
        folder.rmdir()


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """Sets torch's thread count for a block, and puts it back.

    Without torch, which is slow to load, there is none. Whoever uses torch inside the block has
    loaded it before.
    """
    torch = sys.modules.get("torch")
    if torch is None:
        yield
        return
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)
