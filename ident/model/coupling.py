"""Two joints on one motor's shaft: friction and inertia of that motor act on both.

In many wrists the last motor turns its joint through the joint before it: its shaft turns by u = q_b + s q_a. What it
takes is shared,

    τ_b += I ddq_a s + v dq_a s + f sign(u),   τ_a += s (I ddq_b + v dq_b + f sign(u)),

beside each joint's own figures, which take up the rest. Three linear columns that stand in both joints' torque.

Source: Gautier, Vandanjon and Presse 1994 (coupled wrist of the Stäubli arms).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.errors import InputError
from ident.laws.motion import direction

NAMES = ("inertia", "viscous", "coulomb")
UNITS = ("kg m²", "N m s/rad", "N m")


@dataclass(frozen=True)
class Shaft:
    """Which joints share a shaft.

    Attributes:
        first, second: Their numbers in the arm, from zero: a and b.
        sign: s, 1 or -1.
    """

    first: int
    second: int
    sign: float = 1.0

    @classmethod
    def parse(cls, text: str, joints: Sequence[str]) -> Shaft:
        """Reads `5,6` or `5,-6`: numbers of two joints, from one; or two joints' names.

        Raises:
            InputError: Not two different joints of the arm.
        """
        parts = [part.strip() for part in text.split(",")]
        sign = -1.0 if len(parts) == 2 and parts[1].startswith("-") else 1.0
        known = {name: j for j, name in enumerate(joints)} | {str(j + 1): j for j in range(len(joints))}
        numbers = [known[part.lstrip("-")] for part in parts if part.lstrip("-") in known]
        if len(parts) != 2 or len(set(numbers)) != 2:
            remedy = f"give two of 1 to {len(joints)}, such as 5,6, or two joints' names; 5,-6 where they turn against"
            raise InputError("--coupling", f"{text!r} is no pair of joints of the arm", remedy)
        return cls(numbers[0], numbers[1], sign)

    def turn(self, dq: Float[Array, "T n"]) -> Float[Array, " T"]:
        """Speed of the shaft [rad/s]."""
        return np.asarray(dq[:, self.second] + self.sign * dq[:, self.first])

    def columns(
        self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"], slip: Float[Array, " T"]
    ) -> Float[Array, "T n 3"]:
        """Torque of all joints for an inertia, a viscous and a Coulomb friction of one; `slip` is the turn's sign."""
        out = np.zeros((*dq.shape, 3))
        for joint, other in ((self.first, self.second), (self.second, self.first)):
            out[:, joint, 0], out[:, joint, 1] = self.sign * ddq[:, other], self.sign * dq[:, other]
        out[:, self.first, 2], out[:, self.second, 2] = self.sign * slip, slip
        return out


@dataclass(frozen=True)
class Coupling:
    """A shaft's figures, each as (value, low, high) of its 95 % interval.

    Attributes:
        shaft: The joints.
        inertia: I [kg m²].
        viscous: v [N m s/rad].
        coulomb: f [N m].
        transition_speed: Width of the sign's transition [rad/s].
    """

    shaft: Shaft
    inertia: tuple[float, float, float]
    viscous: tuple[float, float, float]
    coulomb: tuple[float, float, float]
    transition_speed: float = 0.0

    def torque(self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """What the shaft adds to all joints' torque [N m]."""
        slip = direction(self.shaft.turn(dq)[:, None], np.full(1, self.transition_speed))[:, 0]
        figures = np.array([getattr(self, name)[0] for name in NAMES])
        return np.asarray(self.shaft.columns(dq, ddq, slip) @ figures)

    def to_dict(self) -> dict[str, Any]:
        """For model.toml."""
        figures = {name: list(getattr(self, name)) for name in NAMES}
        return {**vars(self.shaft), **figures, "transition_speed_rad_s": self.transition_speed}

    @classmethod
    def from_dict(cls, record: dict[str, Any], joints: int) -> Coupling:
        """Reads it back.

        Raises:
            KeyError, TypeError, ValueError: It is damaged.
        """
        shaft = Shaft(int(record["first"]), int(record["second"]), float(record["sign"]))
        if not (0 <= shaft.first < joints and 0 <= shaft.second < joints) or shaft.sign not in (1.0, -1.0):
            raise ValueError(f"the coupling is of joints that the arm has not: {shaft}")
        triples = []
        for name in NAMES:
            value, low, high = (float(one) for one in record[name])
            triples.append((value, low, high))
        if not np.isfinite(triples).all():
            raise ValueError("a figure of the coupling is not finite")
        return cls(shaft, triples[0], triples[1], triples[2], float(record["transition_speed_rad_s"]))

    def describe(self, joints: Sequence[str]) -> str:
        """In words, for the fit's summary."""
        told = ", ".join(
            f"{name} {getattr(self, name)[0]:.4g} [{getattr(self, name)[1]:.4g}, {getattr(self, name)[2]:.4g}] {unit}"
            for name, unit in zip(NAMES, UNITS, strict=True)
        )
        return f"shared by {joints[self.shaft.first]} and {joints[self.shaft.second]}: {told}"
