"""Map of the gap: its share in cells of speed, direction, load, position, reach, reversal age, frequency and time.

A cell is a bin of one axis at one joint. It holds a share of the residual's power and work, and a share of the time (of
the noise's power, along frequency). Whether the gap is denser inside the cell than outside is tested block by block,
with

    d_b = n_in n_out / (n_in + n_out) · (mean |r| inside − mean |r| outside)  over block b,

or, along axes that hardly vary within a block, with the block's excess over its share of the time. Under the null d_b
has a symmetric distribution: the studentised sum is compared with its distribution under random signs of the blocks.
The maximum over a joint's cells sets the level, so p-values hold for all cells of a joint together. |r| is used and not
r², which few peaks would dominate. Along frequency the residual is compared with the spectrum of the coloured noise.

Source: Westfall and Young 1993 (maximum statistic); Winkler et al. 2014 (sign flips of exchangeable blocks).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.gap.residuals import RunResidual, block_labels
from ident.diagnosis.gap.settings import USUAL_MAP, MapSettings
from ident.regression.noise import Whitening

# The reach changes slowly: it is computed at this rate [1/s], at most for so many samples, and interpolated.
REACH_RATE, MOST_REACHES = 10.0, 20_000

Axis = Callable[[RunResidual, int], Float[Array, " t"]]

View = Literal["before", "fixed"]
VIEWS: tuple[View, ...] = ("before", "fixed")


@dataclass(frozen=True)
class Place:
    """One cell of the map."""

    joint: str  # joint name
    axis: str  # name of the axis
    low: float  # lower edge of the bin [rad/s, N m, rad, m, s, degC or Hz]
    high: float  # upper edge of the bin, in the same unit
    share_of_gap: float  # share of the joint's residual power
    share_of_time: float  # share of the samples; along frequency, of the noise's power
    energy_J: float | None  # work of the residual over the session [J]; None along frequency
    p_value: float  # of the gap's density in the cell, corrected for all cells of the joint
    beyond_noise_Nm: float | None = None  # the joint's error beyond noise [N m]; None if the cell is not ranked

    @property
    def density(self) -> float:
        """Share of the gap over share of the time."""
        return self.share_of_gap / max(self.share_of_time, 1e-9)

    def to_dict(self) -> dict[str, Any]:
        """Its record, for JSON."""
        return vars(self).copy()


def says_where(axis: str, low: float) -> bool:
    """Whether a cell that begins at `low` can say where a gap lies: in the slowest frequencies every gap does."""
    return axis != "frequency" or low > 0.0


@dataclass(frozen=True, eq=False)
class _Cell:
    """A cell before its test."""

    place: Place  # its contents
    contrast: Float[Array, " B"]  # excess of the residual inside over outside, block by block


def map_gap(
    series: Sequence[RunResidual],
    joints: Sequence[str],
    noise: Whitening,
    rng: np.random.Generator,
    settings: MapSettings = USUAL_MAP,
) -> dict[View, list[Place]]:
    """All cells of every joint whose residual exceeds its noise, joint by joint and axis by axis, in each view.

    Args:
        series, joints: Residuals of all runs, and joint names.
        noise, rng: Noise model of each joint, and generator of the random signs.
        settings: Bins, blocks, and the threshold above which a joint is mapped.
    """
    duration = sum(item.time[-1] - item.time[0] for item in series)
    labels = block_labels(series, max(settings.shortest_block_s, duration / settings.most_blocks))
    axes = session_axes(series)
    maps: dict[View, list[Place]] = {view: [] for view in VIEWS}
    for view, places in maps.items():
        for j, name in enumerate(joints):
            one = _JointMap(series, labels, name, j, view, settings)
            if np.sum(one.left**2) > settings.least_excess * noise.level[j] ** 2 * len(one.left):
                cells = [cell for axis, pick in axes.items() for cell in one.along(axis, pick)]
                cells += one.along_frequency(noise.coefficients[j])
                places += _with_p_values(cells, rng, settings.flips)
    return maps


def maps_record(places: Sequence[Place]) -> list[dict[str, Any]]:
    """Record of the whole map: one entry for each joint and axis."""
    strips: dict[tuple[str, str], list[Place]] = {}
    for place in places:
        strips.setdefault((place.joint, place.axis), []).append(place)
    return [
        {
            "joint": joint,
            "axis": axis,
            "edges": [cells[0].low, *(cell.high for cell in cells)],
            "share_of_gap": [cell.share_of_gap for cell in cells],
            "share_of_time": [cell.share_of_time for cell in cells],
            "energy_J": [cell.energy_J for cell in cells],
            "p_value": [cell.p_value for cell in cells],
        }
        for (joint, axis), cells in strips.items()
    ]


@dataclass(frozen=True, eq=False)
class _JointMap:
    """Residual of one model at one joint, which is binned along each axis."""

    series: Sequence[RunResidual]
    labels: Sequence[Int[Array, " t"]]  # block of each sample, run by run
    joint: str
    j: int
    view: View
    settings: MapSettings

    def _of_runs(self, pick: Axis) -> Array:
        """Values of all runs at the joint's valid samples."""
        return np.concatenate([pick(item, self.j)[item.valid[:, self.j]] for item in self.series])

    @cached_property
    def left(self) -> Float[Array, " t"]:
        """Residual [N m]."""
        return self._of_runs(lambda item, j: getattr(item, self.view)[:, j])

    @cached_property
    def _work(self) -> Float[Array, " t"]:
        return self.left * self._of_runs(lambda item, j: item.speed[:, j] * item.step)

    @cached_property
    def _block(self) -> Int[Array, " t"]:
        each = zip(self.labels, self.series, strict=True)
        return np.concatenate([label[item.valid[:, self.j]] for label, item in each])

    @property
    def _blocks(self) -> int:
        return int(self.labels[-1][-1]) + 1

    def along(self, axis: str, pick: Axis) -> list[_Cell]:
        """Cells of an axis: bins of equal time, or the two directions."""
        values, left = self._of_runs(pick), self.left
        bins = np.linspace(0.0, 1.0, self.settings.bins + 1)
        edges = np.array([-1.0, 0.0, 1.0]) if axis == "direction" else np.unique(np.quantile(values, bins))
        if len(edges) < 3:
            return []
        place = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        cells = []
        for k, (low, high) in enumerate(pairwise(edges.tolist())):
            inside = place == k
            share, time = float(np.sum(left[inside] ** 2) / np.sum(left**2)), float(inside.mean())
            if 0.0 < time < 1.0:
                here = Place(self.joint, axis, low, high, share, time, float(self._work[inside].sum()), 1.0)
                contrast = _contrast(inside, np.abs(left), self._block, self._blocks, self.settings.within_from)
                cells.append(_Cell(here, contrast))
        return cells

    def along_frequency(self, whitening: Float[Array, " p"]) -> list[_Cell]:
        """Cells of frequency, compared with the noise's share of each band.

        Args:
            whitening: Coefficients of the filter that whitens the joint's noise.
        """
        series = self.series
        edges = np.unique(
            np.minimum(self.settings.frequency_edges_hz, max(item.run.motion.lowpass.cutoff for item in series))
        )
        power = np.zeros((self._blocks, len(edges) - 1))
        for item, label in zip(series, self.labels, strict=True):
            left = getattr(item, self.view)[:, self.j] * item.valid[:, self.j]
            for piece in np.unique(label):
                part = left[label == piece]
                frequency = np.fft.rfftfreq(len(part), item.step)
                power[piece] = np.histogram(frequency, edges, weights=np.abs(np.fft.rfft(part)) ** 2)[0]
        fine = np.linspace(0.0, edges[-1], 2001)[1:]
        response = np.abs(np.polynomial.polynomial.polyval(np.exp(-2j * np.pi * series[0].step * fine), whitening))
        width = np.histogram(fine, edges, weights=1.0 / response**2)[0] / np.sum(1.0 / response**2)
        shares = power.sum(axis=0) / max(float(power.sum()), 1e-300)
        excess = power - width * power.sum(axis=1, keepdims=True)
        each = zip(pairwise(edges.tolist()), shares.tolist(), width.tolist(), strict=True)
        places = [Place(self.joint, "frequency", *edge, share, noise, None, 1.0) for edge, share, noise in each]
        return [_Cell(place, column) for place, column in zip(places, excess.T, strict=True)]


def _contrast(
    inside: Array, size: Array, block: Int[Array, " t"], blocks: int, within_from: float
) -> Float[Array, " B"]:
    """Excess of the residual inside a cell, block by block; compared within blocks where these hold both sides."""

    def total(weights: Array) -> Array:
        return np.bincount(block, weights=weights, minlength=blocks)

    n_in, n_out = total(inside.astype(float)), total((~inside).astype(float))
    r_in, r_out = total(size * inside), total(size * ~inside)
    weight = n_in * n_out / np.maximum(n_in + n_out, 1.0)
    if weight.sum() < within_from * n_in.sum() * n_out.sum() / len(size):
        return r_in - inside.mean() * (r_in + r_out)
    return weight * (r_in / np.maximum(n_in, 1.0) - r_out / np.maximum(n_out, 1.0))


def _with_p_values(cells: Sequence[_Cell], rng: np.random.Generator, flips: int) -> list[Place]:
    """Cells with p-values, corrected over all cells of the joint, by sign flips of whole blocks."""
    contrast = np.stack([cell.contrast for cell in cells], axis=1)
    size = np.maximum(np.sqrt(np.sum(contrast**2, axis=0)), 1e-300)
    signs = rng.choice([-1.0, 1.0], size=(flips, len(contrast)))
    highest = (signs @ contrast / size).max(axis=1)
    seen = contrast.sum(axis=0) / size
    values = (1 + np.sum(highest[:, None] >= seen, axis=0)) / (1 + flips)
    return [replace(cell.place, p_value=float(value)) for cell, value in zip(cells, values, strict=True)]


def session_axes(series: Sequence[RunResidual]) -> dict[str, Axis]:
    """The axes for which these recordings have data, by their names in the record."""
    duration = sum(item.time[-1] - item.time[0] for item in series)
    rate = min(REACH_RATE, MOST_REACHES / max(duration, 1.0))

    @cache  # expensive kinematics, shared by all joints
    def reached(item: RunResidual) -> Float[Array, " t"]:
        return reach(item, rate)

    axes: dict[str, Axis] = {
        "speed": lambda item, j: np.abs(item.speed[:, j]),
        "direction": lambda item, j: np.sign(item.speed[:, j]),
        "load": lambda item, j: np.abs(item.run.link[item.run.motion.coarse][:, j]),
        "position": lambda item, j: item.run.motion.q[item.run.motion.coarse][:, j],
        "pose": lambda item, _: reached(item),
        "reversal": reversal_age,
        "time": lambda item, _: item.time,
    }
    if all(item.run.temperature is not None for item in series):
        axes["temperature"] = lambda item, j: np.asarray(item.run.temperature)[item.run.motion.coarse][:, j]
    return axes


def reversal_age(item: RunResidual, joint: int) -> Float[Array, " t"]:
    """Time since the joint last changed its direction [s]."""
    speed = item.speed[:, joint]
    turns = np.concatenate([[0], np.flatnonzero(np.diff(np.sign(speed)) != 0) + 1])
    return item.time - item.time[turns[np.searchsorted(turns, np.arange(len(speed)), side="right") - 1]]


def reach(item: RunResidual, rate: float) -> Float[Array, " t"]:
    """Distance of the last link from the base [m]."""
    every = max(1, round(1.0 / (rate * item.step)))
    at = np.unique(np.append(np.arange(0, len(item.time), every), len(item.time) - 1))
    arm = item.run.arm
    _, places = arm.link_poses(item.run.motion.q[item.run.motion.coarse][at], arm.links[-1:])[arm.links[-1]]
    return np.interp(np.arange(len(item.time)), at, np.linalg.norm(places, axis=1))
