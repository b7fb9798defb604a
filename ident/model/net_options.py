"""How residual nets are built and trained: the two presets, and the record of a training."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class NetOptions:
    """How a net is built and trained.

    Attributes:
        preset: `default` (a net a joint) or `paper` (one dense net).
        hidden: Widths of the hidden layers; a net a joint comes with its own when it is fitted.
        members: Nets that are averaged; one is fitted, older models have more.
        dropout: Dropout rate of the hidden layers while training.
        epochs: Most epochs.
        patience: Epochs without any better held-back error before training stops; 0 never stops early.
        batch: Most samples a step.
        learning_rate, weight_decay: Of Adam (AdamW where the decay is not zero).
        validation_share: Share of single samples held back.
        cosine: Whether the learning rate falls along a half cosine.
        seed: Seeds the weights, the split and the order of the samples.

    A net a joint is solved for, not trained: of these it takes the seed alone.
    """

    preset: str = "default"
    hidden: tuple[int, ...] = (268,)
    members: int = 1
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
    """Mean square errors of a training in steps, in units of each joint's residual variance, epoch by epoch."""

    train: tuple[float, ...]
    validation: tuple[float, ...]
    best_epoch: int
