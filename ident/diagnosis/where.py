"""Where the gap lies: shares of what the tuned baseline leaves, over speed, direction, load, position, reversal age,
frequency and time, tested block by block.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.residuals import RunResidual, block_labels

BINS = 5
FLIPS = 999
FREQUENCY_EDGES = (0.0, 1.0, 3.0, 10.0, 40.0)  # [Hz]


@dataclass(frozen=True)
class Place:
    """One cell of the map.

    Attributes:
        joint: Joint name.
        axis: What is binned.
        low, high: The bin [rad/s, N m, rad, s or Hz].
        share_of_gap: Share of the joint's residual power that falls into it.
        share_of_time: Share of the samples that do.
        p_value: Of its being richer in gap than in time.
    """

    joint: str
    axis: str
    low: float
    high: float
    share_of_gap: float
    share_of_time: float
    p_value: float

    def to_dict(self) -> dict[str, Any]:
        return vars(self).copy()


def map_gap(
    series: Sequence[RunResidual], joints: Sequence[str], floor: Float[Array, " n"], rng: np.random.Generator
) -> list[Place]:
    """Cells in which the gap is denser than elsewhere, densest first, of every joint that has a gap."""
    labels = np.concatenate(block_labels(series))
    places = []
    for j, name in enumerate(joints):
        counts = np.concatenate([item.counts[:, j] for item in series])
        power = np.concatenate([item.before[:, j] ** 2 for item in series])[counts]
        if len(power) < 100 or np.mean(power) < 1.05 * floor[j] ** 2:
            continue
        block = np.unique(labels[counts], return_inverse=True)[1]
        for axis, values in _axes(series, j).items():
            places += _cells(name, axis, values[counts], power, block, rng)
        places += _spectrum(name, series, j)
    return sorted(places, key=lambda place: (place.p_value > 0.05, -place.share_of_gap / place.share_of_time))


def _axes(series: Sequence[RunResidual], j: int) -> dict[str, Float[Array, " t"]]:
    def gather(pick: Any) -> Array:
        return np.concatenate([pick(item) for item in series])

    def coarse(name: str) -> Any:
        return lambda item: getattr(item.run.motion, name)[item.run.motion.coarse][:, j]

    axes = {
        "speed": np.abs(gather(coarse("dq"))),
        "direction": np.sign(gather(coarse("dq"))),
        "load": np.abs(gather(lambda item: item.run.link[item.run.motion.coarse][:, j])),
        "position": gather(coarse("q")),
        "reversal": gather(lambda item: _age(item, j)),
        "time": gather(lambda item: item.time),
    }
    if all(item.run.temperature is not None for item in series):
        axes["temperature"] = gather(lambda item: item.run.temperature[item.run.motion.coarse][:, j])
    return axes


def _age(item: RunResidual, j: int) -> Float[Array, " t"]:
    """Time since the joint last reversed [s]."""
    dq = item.run.motion.dq[item.run.motion.coarse][:, j]
    turns = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(dq)) != 0) + 1])
    return item.time - item.time[turns[np.searchsorted(turns, np.arange(len(dq)), side="right") - 1]]


def _cells(joint: str, axis: str, values: Array, power: Array, block: Array, rng: np.random.Generator) -> list[Place]:
    edges = (
        np.array([-1.5, 0.0, 1.5])
        if axis == "direction"
        else np.unique(np.quantile(values, np.linspace(0, 1, BINS + 1)))
    )
    if len(edges) < 3:
        return []
    place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    signs = rng.choice([-1.0, 1.0], size=(FLIPS, int(block.max()) + 1))
    cells = []
    for k in range(len(edges) - 1):
        inside = place == k
        time_share = float(inside.mean())
        share = float(power[inside].sum() / power.sum())
        # Under the null a block's gap in the cell is as often above its share of time as below.
        excess = np.bincount(block, weights=power * (inside - time_share), minlength=signs.shape[1])
        p_value = (1 + int(np.sum(signs @ excess >= excess.sum()))) / (1 + FLIPS)
        if share > time_share:
            cells.append(Place(joint, axis, float(edges[k]), float(edges[k + 1]), share, time_share, float(p_value)))
    return cells


def _spectrum(joint: str, series: Sequence[RunResidual], j: int) -> list[Place]:
    """Share of the residual's power by frequency band; told where a band is richer than its width."""
    total = np.zeros(len(FREQUENCY_EDGES) - 1)
    width = 0.0
    for item in series:
        left = item.before[:, j] * item.counts[:, j]
        step = item.run.motion.interval * item.run.motion.lowpass.factor
        spectrum = np.abs(np.fft.rfft(left)) ** 2
        frequency = np.fft.rfftfreq(len(left), step)
        width = max(width, item.run.motion.lowpass.cutoff)
        total += np.histogram(frequency, FREQUENCY_EDGES, weights=spectrum)[0]
    edges = np.minimum(FREQUENCY_EDGES, width)
    k = int(np.argmax(total))
    share, part = float(total[k] / max(total.sum(), 1e-300)), float((edges[k + 1] - edges[k]) / width)
    return [Place(joint, "frequency", float(edges[k]), float(edges[k + 1]), share, max(part, 1e-3), 1.0)]
