"""What a named effect explains on runs that the fit never saw: of a diagnosis and of a comparison alike."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array
from ident.diagnosis.selection.intervals import Estimate


@dataclass(frozen=True, eq=False)
class Explained:
    """An effect with what it explains.

    Attributes:
        estimate: What it is, its figures, its rivals.
        joints: Where it shows.
        rms_before, rms_after: Error on held-out runs without and with it, by joint [N m].
        shrink: Share of what lay above the noise that it closes there.
    """

    estimate: Estimate
    joints: tuple[str, ...]
    rms_before: dict[str, float]
    rms_after: dict[str, float]
    shrink: float

    @property
    def effect(self) -> str:
        return self.estimate.group.effect.id

    @property
    def closed(self) -> float:
        """Mean square that it closes, its joints together [N² m²]."""
        return sum(self.rms_before[name] ** 2 - self.rms_after[name] ** 2 for name in self.rms_before)

    @property
    def gain(self) -> float:
        """Root mean square of the torque that it explains, its joints together [N m]."""
        return float(np.sqrt(max(self.closed, 0.0)))

    @property
    def action(self) -> str:
        """What a person at the cell can do about it."""
        return self.estimate.told.effect.action(", ".join(self.joints), self.estimate.parameters)

    def told(self) -> dict[str, Any]:
        """What any record says of it first."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "probability": self.estimate.probability,
            "class": list(self.estimate.rivals),
            "action": self.action,
            "parameters": {name: value.to_dict() for name, value in self.estimate.parameters.items()},
        }


def measure_shrink(old: Array, new: Array, floor: Array) -> float:
    """Share of the reducible held-out mean square that is closed.

    Args:
        old, new: Root mean square before and after, by joint [N m].
        floor: What no model goes below [N m].
    """
    reducible = float(np.sum(np.maximum(old**2 - floor**2, 0.0)))
    return float(np.clip(np.sum(old**2 - new**2) / max(reducible, 1e-12), -1.0, 1.0))
