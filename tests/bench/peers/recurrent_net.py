"""A gated recurrent unit as a peer: what plain least squares leaves of torque, foretold from sequences.

One layer over all joints' angle, speed, acceleration and load. It is trained on overlapping windows
by Adam for a number of steps; or every fifth window of each training run is held back, and the weights
of the step that is best there are the ones that count. On short recordings that stops it at once, and
it is worse than plain least squares where it goes on: both are measured. The head starts at zero, so
that it starts from plain least squares.

Source: Cho et al. 2014 (the unit); Prechelt 1998 (early stopping).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ident.arrays import Array, Bool, Float

WIDTH = 32
LEARNING_RATE = 5e-3
WEIGHT_DECAY = 1e-4
BATCH = 16
STEPS = 400
# The most steps where the best one is sought.
MOST_STEPS = 1200
# Steps from one look at what is held back to the next, and looks without a better one.
STEPS_A_LOOK = 30
PATIENCE = 12
EVERY = 5  # one of so many windows is held back
LEAST_STD = 1e-9


@dataclass(frozen=True, eq=False)
class Sequences:
    """A run as the net sees it."""

    inputs: Float[Array, "t f"]
    left: Float[Array, "t n"]  # torque that is left [N m]
    moving: Bool[Array, "t n"]


def foretell_left(
    train: Sequence[Sequences],
    asked: Sequence[Float[Array, "t f"]],
    window: int,
    stopped: bool,
) -> list[Float[Array, "t n"]]:
    """What the net says is left of other runs [N m].

    Args:
        train: Training runs.
        asked: Inputs of the other runs.
        window: Length of a window [samples].
        stopped: Whether the step is sought that is best on windows held back.
    """
    torch.manual_seed(0)
    seen = np.concatenate([run.inputs for run in train])
    left = np.concatenate([run.left for run in train])
    mean = seen.mean(axis=0)
    scales = seen.std(axis=0) + LEAST_STD, left.std(axis=0) + LEAST_STD
    windows = []
    held_back = []
    for run in train:
        whole = range(0, len(run.inputs), window)
        starts = list(range(0, len(run.inputs), window // 2))
        if stopped:
            held_back += _cut(run, mean, scales, whole[::EVERY], window)
            # Neither half of a window is held back.
            starts = [start for start in starts if start // window % EVERY]
            starts = [start for start in starts if (start + window // 2) // window % EVERY]
        windows += _cut(run, mean, scales, starts, window)
    net = torch.nn.GRU(len(mean), WIDTH, batch_first=True)
    head = torch.nn.Linear(WIDTH, left.shape[1])
    torch.nn.init.zeros_(head.weight)
    torch.nn.init.zeros_(head.bias)
    both = torch.nn.ModuleList([net, head])
    _train(both, windows, held_back)
    foretold = []
    with torch.inference_mode():
        for inputs in asked:
            x = torch.tensor((inputs - mean) / scales[0], dtype=torch.float32)[None]
            foretold.append(scales[1] * head(net(x)[0])[0].numpy())
    return foretold


def _cut(run: Sequences, mean: Array, scales: tuple[Array, Array], starts: Sequence[int], window: int) -> list:
    """Windows of a run, standardised; a last one may be padded with samples that do not count."""
    windows = []
    for start in starts:
        rows = np.minimum(np.arange(start, start + window), len(run.inputs) - 1)
        real = np.arange(start, start + window) < len(run.inputs)
        x = (run.inputs[rows] - mean) / scales[0]
        y = run.left[rows] / scales[1]
        windows.append((x, y, run.moving[rows] & real[:, None]))
    return windows


def _train(both: torch.nn.ModuleList, windows: list, held_back: list) -> None:
    """Trains, and leaves the weights that were best on what was held back; those of plain without windows."""
    if not windows:
        return
    optimiser = torch.optim.Adam(both.parameters(), lr=LEARNING_RATE, weight_decay=WEIGHT_DECAY)
    stacked = [torch.tensor(np.stack(values), dtype=torch.float32) for values in zip(*windows, strict=True)]
    if not held_back:
        for _ in range(STEPS):
            _step(both, optimiser, stacked)
        return
    unseen = [torch.tensor(np.stack(values), dtype=torch.float32) for values in zip(*held_back, strict=True)]
    least = float("inf")
    best = copy.deepcopy(both.state_dict())
    waited = 0
    for step in range(MOST_STEPS):
        if step % STEPS_A_LOOK == 0:
            with torch.inference_mode():
                error = float(_error(both, *unseen).detach())
            waited += 1
            if error < least:
                least = error
                best = copy.deepcopy(both.state_dict())
                waited = 0
            if waited > PATIENCE:
                break
        _step(both, optimiser, stacked)
    both.load_state_dict(best)


def _step(both: torch.nn.ModuleList, optimiser: torch.optim.Optimizer, stacked: list) -> None:
    batch = torch.randint(len(stacked[0]), (BATCH,))
    optimiser.zero_grad()
    _error(both, *(values[batch] for values in stacked)).backward()
    optimiser.step()


def _error(both: torch.nn.ModuleList, x: torch.Tensor, y: torch.Tensor, counts: torch.Tensor) -> torch.Tensor:
    """Mean square of what is left where a joint moves."""
    net, head = both
    return (counts * (head(net(x)[0]) - y) ** 2).sum() / counts.sum().clamp(min=1.0)
