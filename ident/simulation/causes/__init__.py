"""What can be wrong with the simulated arm, by the catalogue's id, and what no catalogue lists."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.simulation.causes import mechanisms
from ident.simulation.causes.mechanisms import Circumstances, Parameters, Size, View
from ident.simulation.hardware import Hardware

_ROWS = tomllib.loads(Path(__file__).with_name("causes.toml").read_text(encoding="utf-8"))
EVENTS = frozenset({"external_contact"})
"""Effects that no simulator of the arm can hold: a push that came once."""
ALIKE = (
    frozenset({"torque_offset", "asymmetric_friction"}),
    frozenset({"torque_gain_error", "payload", "link_inertial_error"}),
)
"""Effects whose torques are one and the same: with both, no truth could be told from another."""


@dataclass(frozen=True)
class Cause:
    """One thing that may be wrong: a row of `causes.toml`, where each field is explained."""

    id: str
    parameter: str
    typical_size: Size
    least: Size
    most: tuple[Size, ...]
    law: str = ""
    column: str = ""
    healthy: float = 0.0
    drawn: Mapping[str, tuple[str, str, float, float]] = field(default_factory=dict)
    whole_arm: bool = False
    view: View = "refit"
    inverse: bool = False
    needs_all: bool = False
    beside: float | None = None

    @classmethod
    def of_row(cls, name: str, typical: Size, bounds: Sequence[Size], **fields: Any) -> Cause:
        """The cause of a row of the table."""
        return cls(name, fields.pop("parameter"), typical, bounds[0], tuple(bounds[1:]), **fields)

    def typical(self, scene: Circumstances) -> float:
        """A typical size."""
        return scene.size_of(self.typical_size)

    def bounds(self, scene: Circumstances) -> tuple[float, float]:
        """Smallest and largest size that physics or the motions allow."""
        return scene.size_of(self.least), min(map(scene.size_of, self.most))

    def apply(self, scene: Circumstances, size: float) -> tuple[Hardware, Parameters]:
        """The hardware with the cause, and what is true.

        Args:
            scene: The hardware, the joint, the motions, and a source of chance.
            size: In the cause's own unit.

        Returns:
            The other hardware; parameters by name with their units.
        """
        if not self.law:
            return getattr(mechanisms, self.id)(scene, size)
        if self.law == "sensing":
            sensing = scene.hardware.sensing.set(scene.joint, **{self.column: self.healthy + size})
            return scene.hardware.replace(sensing=sensing), {self.parameter: size}
        values = {
            column: _draw(scene.rng, how, low, high)
            for column, (_, how, low, high) in self.drawn.items()
        }
        true = {self.drawn[column][0]: value for column, value in values.items()}
        return scene.with_laws(self.law, **{self.column: size}, **values), {
            self.parameter: size,
            **true,
        }

    def checked(self, scene: Circumstances, size: float) -> float:
        """The size, if it is physical.

        Raises:
            InputError: It is not; the message tells the bounds.
        """
        low, high = self.bounds(scene)
        if not low <= size <= high:
            what = f"{self.parameter} = {size:g} is outside physics"
            raise InputError(
                f"--effect {self.id}", what, f"choose between {low:.4g} and {high:.4g}"
            )
        return size


def _draw(rng: np.random.Generator, how: str, low: float, high: float) -> float:
    """A number between two: `even`ly, `whole`, or evenly in the `log`arithm."""
    if how == "log":
        return float(np.exp(rng.uniform(np.log(low), np.log(high))))
    return float(rng.integers(int(low), int(high)) if how == "whole" else rng.uniform(low, high))


CATALOGUE: dict[str, Cause] = {
    name: Cause.of_row(name, **row) for name, row in _ROWS["catalogue"].items()
}
"""The 21 effects of the catalogue."""

OUTSIDE: dict[str, Cause] = {
    name: Cause.of_row(name, **row) for name, row in _ROWS["outside"].items()
}
"""Causes outside the catalogue."""


__all__ = ["ALIKE", "CATALOGUE", "EVENTS", "OUTSIDE", "Cause", "Circumstances", "find_cause"]


def find_cause(name: str) -> Cause:
    """The cause of an id.

    Raises:
        InputError: No such id.
    """
    known = {**CATALOGUE, **OUTSIDE}
    if name not in known:
        raise InputError("--effect", f"unknown effect {name!r}", f"choose from: {', '.join(known)}")
    return known[name]
