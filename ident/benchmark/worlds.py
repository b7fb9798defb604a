"""Cases by what their worlds differ in: numbers cut at powers of ten or at terciles, words at themselves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ident.benchmark.scoring import Outcome

# Properties by which scores are told, and their names for a person. A number that spans decades is cut at these.
DECADES = ("encoder_noise_rad",)
NUMBERS = {
    "encoder_noise_rad": "encoder noise and rounding [rad]",
    "rate_hz": "log rate [Hz]",
    "run_spread": "friction from run to run",
    "friction_drift": "drift of friction",
    "torque_noise": "torque noise [of rated]",
    "jitter": "jitter [of the interval]",
    "lost": "samples lost",
    "bandwidth_hz": "controller's bandwidth [Hz]",
    "friction_scale": "friction, of the usual",
    "rotor_scale": "rotor inertia, of the usual",
    "runs": "runs",
    "duration_s": "duration [s]",
    "link_error": "error of the URDF's masses",
}
WORDS = {
    "world": "world",
    "robot": "arm",
    "velocity": "velocity channel",
    "encoder_at": "encoder on the",
    "feed_forward": "feed-forward",
    "reference": "reference",
}


@dataclass(frozen=True, eq=False)
class Stratum:
    """Cases whose worlds are alike in one property: between bounds of a number, or in a word (empty for a number)."""

    axis: str
    cases: Sequence[Outcome]
    low: float = 0.0
    high: float = 0.0
    value: str = ""

    @property
    def label(self) -> str:
        """For a person."""
        return f"{self.axis} {self.value}" if self.value else f"{self.axis} {self.low:.3g} to {self.high:.3g}"


def world_axes(world: Mapping[str, Any]) -> dict[str, float | str]:
    """What cases are sorted by."""
    counts = 2.0 ** world["encoder_bits"] * (100.0 if world["encoder_at"] == "motor" else 1.0)
    noise = float(np.hypot(world["encoder_noise_rad"], 2.0 * np.pi / counts / np.sqrt(12.0)))
    own = {"encoder_noise_rad": noise, "world": world["name"], "run_spread": world["friction_spread"]}
    return {name: {**world, **own}[name] for name in (*NUMBERS, *WORDS)}


def stratify(outcomes: Sequence[Outcome]) -> dict[str, list[Stratum]]:
    """Strata of every property in which the worlds differ."""
    placed = [(world_axes(one.world), one) for one in outcomes if one.world]
    differing = [axis for axis in (*NUMBERS, *WORDS) if len({place[axis] for place, _ in placed}) > 1]
    return {axis: _cut(axis, [(place[axis], one) for place, one in placed]) for axis in differing}


def _cut(axis: str, placed: Sequence[tuple[Any, Outcome]]) -> list[Stratum]:
    if axis in WORDS:
        words = sorted({str(value) for value, _ in placed})
        return [Stratum(axis, [one for value, one in placed if value == word], value=word) for word in words]
    values = np.array([float(value) for value, _ in placed])
    edges = np.unique(np.quantile(values, [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0]))
    if axis in DECADES:
        edges = 10.0 ** np.arange(np.floor(np.log10(values.min())), np.ceil(np.log10(values.max() * (1.0 + 1e-9))) + 1)
    at = np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(edges) - 2)
    strata = [
        Stratum(axis, [one for (_, one), k in zip(placed, at, strict=True) if k == i], float(low), float(high))
        for i, (low, high) in enumerate(pairwise(edges))
    ]
    return [one for one in strata if one.cases]
