"""Whether intervals hold what they should, and by what factor they would have to be wider."""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float
from ident.benchmark.corpus_table import Table

HOLDS = 0.95  # share of true parameters that an interval is meant to hold
FEWEST = 20  # parameters, below which no factor is worked out


@dataclass(frozen=True)
class WidthFactor:
    """How wide intervals ought to be."""

    count: int  # parameters with a known truth
    coverage: float  # share that the intervals hold as they are
    factor: float  # that the half-widths are to be multiplied with
    coverage_held_out: float  # share that they hold, each unit with the factor of all others

    def to_dict(self) -> dict[str, float]:
        return {key: round(float(value), 4) for key, value in vars(self).items()}


def misses_of(table: Table, counted: Bool[Array, " N"]) -> tuple[Float[Array, " M"], Array]:
    """Distance of each true parameter from the estimate [half-widths on its side], and its unit."""
    misses: list[float] = []
    units: list[str] = []
    for row, is_counted in zip(table.rows, counted, strict=True):
        for interval in json.loads(row["intervals"]) if is_counted else ():
            above = interval["true"] >= interval["value"]
            half = interval["high"] - interval["value"] if above else interval["value"] - interval["low"]
            miss = abs(interval["true"] - interval["value"])
            if interval["parameter"] == "phase_rad":
                miss = abs(float(np.angle(np.exp(1j * miss))))
            misses.append(miss / max(half, 1e-12))
            units.append(table.sessions[row["case"]].unit)
    return np.array(misses), np.array(units, dtype=object)


def fit_width(table: Table, counted: Bool[Array, " N"]) -> WidthFactor | None:
    """The factor by which 95 % of the counted rows' parameters lie inside; None of too few."""
    misses, units = misses_of(table, counted)
    if len(misses) < FEWEST:
        return None
    inside = np.zeros(len(misses), dtype=bool)
    for unit in np.unique(units):
        inside_unit = units == unit
        others = misses[~inside_unit]
        factor = float(np.quantile(others, HOLDS)) if len(others) else 1.0
        inside[inside_unit] = misses[inside_unit] <= factor
    factor = float(np.quantile(misses, HOLDS))
    return WidthFactor(len(misses), float(np.mean(misses <= 1.0)), factor, float(inside.mean()))
