"""Losses of a joint: motor inertia, viscous damping, Coulomb friction and a constant torque.

    τ_loss = B_m ddq + C_m dq + f_c tanh(dq / v₀) + offset

Source: paper, eq. 3 and 5; one three-column problem a joint (the printed row form lacks the joint's index).

Two joints on one motor's shaft: friction and inertia of that motor act on both.

In many wrists the last motor turns its joint through the joint before it: its shaft turns by u = q_b + s q_a. What it
takes is shared,

    τ_b += I ddq_a s + v dq_a s + f sign(u),   τ_a += s (I ddq_b + v dq_b + f sign(u)),

beside each joint's own parameters, which take up the rest. Three linear columns that stand in both joints' torque.

Source: Gautier, Vandanjon and Presse 1994 (coupled wrist of the Stäubli arms).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.arrays import Array, Float, freeze
from ident.errors import InputError
from ident.laws.motion import direction
from ident.motion.motion import Motion

NAMES = ("motor_inertia", "viscous", "coulomb", "offset")
UNITS = ("kg m²", "N m s/rad", "N m", "N m")
# Widths tried where none is given [rad/s].
TRANSITION_GRID = (0.002, 0.005, 0.01, 0.02, 0.04, 0.08)


@dataclass(frozen=True, eq=False)
class LossParameters:
    """Loss parameters of n joints, in SI units for revolute joints."""

    motor_inertia: Float[Array, " n"]  # B_m, rotor inertia seen at the joint [kg m²]
    viscous: Float[Array, " n"]  # C_m [N m s/rad]
    coulomb: Float[Array, " n"]  # f_c [N m]
    offset: Float[Array, " n"]  # constant torque [N m]
    # Width v₀ of the sign's transition, tanh(dq / v₀); 0 is a pure sign, as in the paper [rad/s].
    transition_speed: Float[Array, " n"]

    def __post_init__(self) -> None:
        for name in (*NAMES, "transition_speed"):
            object.__setattr__(self, name, freeze(getattr(self, name)))

    @classmethod
    def zero(cls, n: int) -> LossParameters:
        """No loss at all."""
        return cls(*(np.zeros(n) for _ in range(5)))

    def torque(self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """Loss torque [N m]. Source: paper, eq. 3."""
        slip = direction(dq, self.transition_speed)
        return self.motor_inertia * ddq + self.viscous * dq + self.coulomb * slip + self.offset


@dataclass(frozen=True, eq=False)
class LossResults:
    """Losses of n joints as they were fitted, with their covariance."""

    params: LossParameters  # the parameters
    joints: tuple[str, ...]  # joint names
    covariance: Float[Array, "n 4 4"]  # covariance of (B_m, C_m, f_c, offset) of each joint, shape (n, 4, 4)
    residual_rms: Float[Array, " n"]  # root mean square of what is left, where the joint moves [N m]
    # Names of parameters that came to rest on zero, per joint: the data wanted them negative.
    at_bound: tuple[tuple[str, ...], ...]
    dof: Float[Array, "n 4"]  # degrees of freedom of each standard deviation

    def conf_int(self, level: float = 0.95) -> Float[Array, "n 4 2"]:
        """Confidence intervals of (B_m, C_m, f_c, offset), by Student's t with each one's degrees of freedom."""
        reach = stdtrit(np.minimum(self.dof, 1e6), 0.5 + level / 2)
        std = np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        values = np.stack([getattr(self.params, name) for name in NAMES], axis=1)
        return np.stack([values - reach * std, values + reach * std], axis=-1)

    def summary(self) -> str:
        """A table in text: one row a joint and parameter."""
        limits = self.conf_int()
        lines = [f"{'joint':<22}{'figure':<15}{'value':>10}  {'95 % interval':<24}unit"]
        for j, joint in enumerate(self.joints):
            for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True)):
                value = getattr(self.params, name)[j]
                if limits[j, k, 0] == limits[j, k, 1] == 0.0:
                    continue  # was not fitted
                note = "  on its bound" if name in self.at_bound[j] else ""
                interval = f"[{limits[j, k, 0]:.4g}, {limits[j, k, 1]:.4g}]"
                lines.append(f"{joint:<22}{name:<15}{value:>10.4g}  {interval:<24}{unit}{note}")
        return "\n".join(lines)


@dataclass(frozen=True)
class LossFigure:
    """One loss parameter with its 95 % interval, for reports."""

    joint: str
    name: str
    value: float
    low: float
    high: float
    unit: str


def loss_figures(loss: LossResults) -> tuple[LossFigure, ...]:
    """Those that were fitted, one by one."""
    limits = loss.conf_int()
    return tuple(
        LossFigure(
            joint, name, float(getattr(loss.params, name)[j]), float(limits[j, k, 0]), float(limits[j, k, 1]), unit
        )
        for j, joint in enumerate(loss.joints)
        for k, (name, unit) in enumerate(zip(NAMES, UNITS, strict=True))
        if not (name == "offset" and limits[j, k, 0] == limits[j, k, 1] == 0.0)
    )


def loss_columns(motion: Motion, transition_speed: Float[Array, " n"]) -> Float[Array, "t n 4"]:
    """Filtered regressor columns of a run: ddq, dq, direction, one."""
    slip = direction(motion.dq, transition_speed)
    return motion.filtered(np.stack([motion.ddq, motion.dq, slip, np.ones_like(motion.dq)], axis=-1))


SHAFT_NAMES = ("inertia", "viscous", "coulomb")
SHAFT_UNITS = ("kg m²", "N m s/rad", "N m")


@dataclass(frozen=True)
class Shaft:
    """Which joints share a shaft."""

    # Their numbers in the arm, from zero: a and b.
    first: int
    second: int
    sign: float = 1.0  # s, 1 or -1

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
    """A shaft's parameters, each as (value, low, high) of its 95 % interval."""

    shaft: Shaft  # the joints
    inertia: tuple[float, float, float]  # i [kg m²]
    viscous: tuple[float, float, float]  # v [N m s/rad]
    coulomb: tuple[float, float, float]  # f [N m]
    transition_speed: float = 0.0  # width of the sign's transition [rad/s]

    def torque(self, dq: Float[Array, "T n"], ddq: Float[Array, "T n"]) -> Float[Array, "T n"]:
        """What the shaft adds to all joints' torque [N m]."""
        slip = direction(self.shaft.turn(dq)[:, None], np.full(1, self.transition_speed))[:, 0]
        figures = np.array([getattr(self, name)[0] for name in SHAFT_NAMES])
        return np.asarray(self.shaft.columns(dq, ddq, slip) @ figures)

    def to_dict(self) -> dict[str, Any]:
        """For model.toml."""
        figures = {name: list(getattr(self, name)) for name in SHAFT_NAMES}
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
        for name in SHAFT_NAMES:
            value, low, high = (float(one) for one in record[name])
            triples.append((value, low, high))
        if not np.isfinite(triples).all():
            raise ValueError("a figure of the coupling is not finite")
        return cls(shaft, triples[0], triples[1], triples[2], float(record["transition_speed_rad_s"]))

    def describe(self, joints: Sequence[str]) -> str:
        """In words, for the fit's summary."""
        told = ", ".join(
            f"{name} {getattr(self, name)[0]:.4g} [{getattr(self, name)[1]:.4g}, {getattr(self, name)[2]:.4g}] {unit}"
            for name, unit in zip(SHAFT_NAMES, SHAFT_UNITS, strict=True)
        )
        return f"shared by {joints[self.shaft.first]} and {joints[self.shaft.second]}: {told}"
