"""Map of the gap: its share in cells of what the joints do.

The axes are speed, direction, load, position, reach, reversal age, frequency and time. A cell is a
bin of one axis at one joint. It holds a share of the residual's power and work, and a share of the
time (of the noise's power, along frequency). Whether the gap is denser inside the cell than outside
is tested block by block, with

    d_b = n_in n_out / (n_in + n_out) · (mean |r| inside − mean |r| outside)  over block b,

or, along axes that hardly vary within a block, with the block's excess over its share of the time.
Under the null d_b has a symmetric distribution: the studentised sum is compared with its
distribution under random signs of the blocks. The maximum over a joint's cells sets the level, so
p-values hold for all cells of a joint together. |r| is used and not r², which few peaks would
dominate. Along frequency the residual is compared with the spectrum of the coloured noise.

Source: Westfall and Young 1993 (maximum statistic); Winkler et al. 2014 (sign flips of exchangeable
blocks).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import pairwise
from typing import Literal

import numpy as np

from ident.arrays import Array, Float, Int
from ident.diagnosis.gap.residuals import RunResidual, block_labels
from ident.diagnosis.gap.settings import USUAL_MAP, MapSettings
from ident.recordings.blocks import block_length
from ident.records import JsonRecord
from ident.regression.noise import Whitening

# The reach changes slowly: it is computed at this rate [1/s], at most for so many samples, and
# interpolated.
REACH_RATE = 10.0
MOST_REACHES = 20_000
# Frequencies at which the noise's spectrum is taken.
FREQUENCIES = 2001

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
    # The joint's error beyond noise [N m]; None if the cell is not ranked.
    beyond_noise_Nm: float | None = None

    @property
    def density(self) -> float:
        """Share of the gap over share of the time; 1 is the joint's average."""
        return self.share_of_gap / max(self.share_of_time, 1e-9)

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: its fields by their names."""
        return vars(self).copy()


def says_where(axis: str, low: float) -> bool:
    """Whether a cell that begins at `low` can say where a gap lies.

    All but that of the slowest frequencies: every gap lies there.

    Args:
        axis: Name of the axis.
        low: Where the cell begins, in the axis's unit.
    """
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
    """All cells of every joint whose residual exceeds its noise, in each view.

    They come joint by joint and axis by axis.

    Args:
        series, joints: Residuals of all runs, and joint names.
        noise, rng: Noise model of each joint, and generator of the random signs.
        settings: Bins, blocks, and the threshold above which a joint is mapped.
    """
    duration = sum(item.time[-1] - item.time[0] for item in series)
    length = block_length(duration, settings.shortest_block_s, settings.most_blocks)
    labels = block_labels(series, length)
    axes = session_axes(series)
    maps: dict[View, list[Place]] = {view: [] for view in VIEWS}
    for view, places in maps.items():
        for j, name in enumerate(joints):
            joint_map = _JointMap(series, labels, name, j, view, settings)
            square = np.sum(joint_map.left**2)
            if square <= settings.least_excess * noise.level[j] ** 2 * len(joint_map.left):
                continue
            cells = []
            for axis, pick in axes.items():
                cells += joint_map.along(axis, pick)
            cells += joint_map.along_frequency(noise.coefficients[j])
            places += _with_p_values(cells, rng, settings.flips)
    return maps


def maps_record(places: Sequence[Place]) -> list[JsonRecord]:
    """Record of the whole map: one entry for each joint and axis.

    Returns:
        Entries of `joint`, `axis`, `edges` (one more than cells), and for each cell `share_of_gap`,
        `share_of_time`, `energy_J` (None where there is none) and `p_value`.
    """
    strips: dict[tuple[str, str], list[Place]] = {}
    for place in places:
        strips.setdefault((place.joint, place.axis), []).append(place)
    records = []
    for (joint, axis), cells in strips.items():
        record = {
            "joint": joint,
            "axis": axis,
            "edges": [cells[0].low, *(cell.high for cell in cells)],
            "share_of_gap": [cell.share_of_gap for cell in cells],
            "share_of_time": [cell.share_of_time for cell in cells],
            "energy_J": [cell.energy_J for cell in cells],
            "p_value": [cell.p_value for cell in cells],
        }
        records.append(record)
    return records


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
        picked = [pick(item, self.j)[item.valid[:, self.j]] for item in self.series]
        return np.concatenate(picked)

    @cached_property
    def left(self) -> Float[Array, " t"]:
        """Residual [N m]."""
        return self._of_runs(lambda item, j: getattr(item, self.view)[:, j])

    @cached_property
    def _work(self) -> Float[Array, " t"]:
        travel = self._of_runs(lambda item, j: item.speed[:, j] * item.step)
        return self.left * travel

    @cached_property
    def _block(self) -> Int[Array, " t"]:
        pairs = zip(self.labels, self.series, strict=True)
        labels = [label[item.valid[:, self.j]] for label, item in pairs]
        return np.concatenate(labels)

    @property
    def _blocks(self) -> int:
        return int(self.labels[-1][-1]) + 1

    def along(self, axis: str, pick: Axis) -> list[_Cell]:
        """Cells of an axis: bins of equal time, or the two directions."""
        left = self.left
        values = self._of_runs(pick)
        if axis == "direction":
            edges = np.array([-1.0, 0.0, 1.0])
        else:
            edges = np.unique(np.quantile(values, np.linspace(0.0, 1.0, self.settings.bins + 1)))
        if len(edges) < 3:
            return []
        number = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
        cells = []
        for k, (low, high) in enumerate(pairwise(edges.tolist())):
            inside = number == k
            time = float(inside.mean())
            if not 0.0 < time < 1.0:
                continue
            share = float(np.sum(left[inside] ** 2) / np.sum(left**2))
            work = float(self._work[inside].sum())
            place = Place(self.joint, axis, low, high, share, time, work, 1.0)
            cells.append(_Cell(place, self._contrast(inside)))
        return cells

    def _contrast(self, inside: Array) -> Float[Array, " B"]:
        """Excess of the residual inside a cell, block by block.

        Compared within blocks where these hold both sides.
        """
        size = np.abs(self.left)

        def total(weights: Array) -> Array:
            return np.bincount(self._block, weights=weights, minlength=self._blocks)

        samples_inside = total(inside.astype(float))
        samples_outside = total((~inside).astype(float))
        residual_inside = total(size * inside)
        residual_outside = total(size * ~inside)
        samples = np.maximum(samples_inside + samples_outside, 1.0)
        weight = samples_inside * samples_outside / samples
        mixed = samples_inside.sum() * samples_outside.sum() / len(size)
        if weight.sum() < self.settings.within_from * mixed:
            return residual_inside - inside.mean() * (residual_inside + residual_outside)
        mean_inside = residual_inside / np.maximum(samples_inside, 1.0)
        mean_outside = residual_outside / np.maximum(samples_outside, 1.0)
        return weight * (mean_inside - mean_outside)

    def along_frequency(self, whitening: Float[Array, " p"]) -> list[_Cell]:
        """Cells of frequency, compared with the noise's share of each band.

        Args:
            whitening: Coefficients of the filter that whitens the joint's noise.
        """
        highest = max(item.run.motion.lowpass.cutoff for item in self.series)
        edges = np.unique(np.minimum(self.settings.frequency_edges_hz, highest))
        power = self._power(edges)
        of_noise = _shares_of_noise(edges, whitening, self.series[0].step)
        of_gap = power.sum(axis=0) / max(float(power.sum()), 1e-300)
        excess = power - of_noise * power.sum(axis=1, keepdims=True)
        cells = []
        for k, (low, high) in enumerate(pairwise(edges.tolist())):
            shares = (float(of_gap[k]), float(of_noise[k]))
            place = Place(self.joint, "frequency", low, high, *shares, None, 1.0)
            cells.append(_Cell(place, excess[:, k]))
        return cells

    def _power(self, edges: Float[Array, " e"]) -> Float[Array, "B e-1"]:
        """Power of the residual in each band between edges [Hz], block by block."""
        power = np.zeros((self._blocks, len(edges) - 1))
        for item, label in zip(self.series, self.labels, strict=True):
            every = getattr(item, self.view)[:, self.j]
            left = every * item.valid[:, self.j]
            for block in np.unique(label):
                samples = left[label == block]
                frequency = np.fft.rfftfreq(len(samples), item.step)
                spectrum = np.abs(np.fft.rfft(samples)) ** 2
                power[block] = np.histogram(frequency, edges, weights=spectrum)[0]
        return power


def _shares_of_noise(
    edges: Float[Array, " e"], whitening: Float[Array, " p"], step: float
) -> Float[Array, " e-1"]:
    """Shares of a coloured noise's power in bands.

    Args:
        edges: Of the bands [Hz].
        whitening: Coefficients of the filter that whitens the noise.
        step: Time between samples [s].
    """
    frequency = np.linspace(0.0, edges[-1], FREQUENCIES)[1:]
    delay = np.exp(-2j * np.pi * step * frequency)
    response = np.abs(np.polynomial.polynomial.polyval(delay, whitening))
    spectrum = 1.0 / response**2
    return np.histogram(frequency, edges, weights=spectrum)[0] / np.sum(spectrum)


def _with_p_values(cells: Sequence[_Cell], rng: np.random.Generator, flips: int) -> list[Place]:
    """Cells with p-values, corrected over all cells of the joint, by sign flips of whole blocks."""
    contrast = np.stack([cell.contrast for cell in cells], axis=1)
    size = np.maximum(np.sqrt(np.sum(contrast**2, axis=0)), 1e-300)
    signs = rng.choice([-1.0, 1.0], size=(flips, len(contrast)))
    highest = (signs @ contrast / size).max(axis=1)
    seen = contrast.sum(axis=0) / size
    values = (1 + np.sum(highest[:, None] >= seen, axis=0)) / (1 + flips)
    pairs = zip(cells, values, strict=True)
    return [replace(cell.place, p_value=float(value)) for cell, value in pairs]


def session_axes(series: Sequence[RunResidual]) -> dict[str, Axis]:
    """The axes of the map for which these recordings have data.

    Args:
        series: Residuals of all runs.

    Returns:
        By the axis's name in the record, a function of a run and a joint's number to the axis's
        value at the run's t filtered samples [rad/s, N m, rad, m, s or °C; m/s, N and m for joints
        that slide]; `direction` is 1, 0 or -1.
    """
    duration = sum(item.time[-1] - item.time[0] for item in series)
    rate = min(REACH_RATE, MOST_REACHES / max(duration, 1.0))

    @cache  # expensive kinematics, shared by all joints
    def reached(item: RunResidual) -> Float[Array, " t"]:
        return reach(item, rate)

    def coarse(values: Array, item: RunResidual, j: int) -> Float[Array, " t"]:
        """A joint's column at the filtered samples."""
        return values[item.run.motion.coarse][:, j]

    axes: dict[str, Axis] = {
        "speed": lambda item, j: np.abs(item.speed[:, j]),
        "direction": lambda item, j: np.sign(item.speed[:, j]),
        "load": lambda item, j: np.abs(coarse(item.run.link, item, j)),
        "position": lambda item, j: coarse(item.run.motion.q, item, j),
        "pose": lambda item, _: reached(item),
        "reversal": reversal_age,
        "time": lambda item, _: item.time,
    }
    if all(item.run.temperature is not None for item in series):
        axes["temperature"] = lambda item, j: coarse(np.asarray(item.run.temperature), item, j)
    return axes


def reversal_age(item: RunResidual, joint: int) -> Float[Array, " t"]:
    """Time since the joint last changed its direction [s]."""
    speed = item.speed[:, joint]
    changes = np.flatnonzero(np.diff(np.sign(speed)) != 0)
    turns = np.concatenate([[0], changes + 1])
    last = np.searchsorted(turns, np.arange(len(speed)), side="right") - 1
    return item.time - item.time[turns[last]]


def reach(item: RunResidual, rate: float) -> Float[Array, " t"]:
    """Distance of the last link from the base [m].

    Args:
        item: The run.
        rate: How often it is worked out; interpolated between [Hz].
    """
    every = max(1, round(1.0 / (rate * item.step)))
    count = len(item.time)
    samples = np.unique(np.append(np.arange(0, count, every), count - 1))
    arm = item.run.arm
    motion = item.run.motion
    last = arm.links[-1]
    sampled = motion.q[motion.coarse][samples]
    _, places = arm.link_poses(sampled, [last])[last]
    return np.interp(np.arange(count), samples, np.linalg.norm(places, axis=1))
