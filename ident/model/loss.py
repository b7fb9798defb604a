"""Losses of a joint: motor inertia, viscous damping, Coulomb friction and a constant torque.

    τ_loss = B_m ddq + C_m dq + f_c tanh(dq / v₀) + offset

Source: paper, eq. 3 and 5; one three-column problem a joint (the printed row form lacks the joint's
index).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Float, freeze
from ident.laws.motion import direction
from ident.model.intervals import limits
from ident.units import DAMPING, INERTIA, TORQUE

NAMES = ("motor_inertia", "viscous", "coulomb", "offset")
UNITS = (INERTIA, DAMPING, TORQUE, TORQUE)
WORDS = {
    "motor_inertia": "rotor inertia",
    "viscous": "damping",
    "coulomb": "dry friction",
    "offset": "constant torque",
}
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
    # Mean products of the errors of (B_m, C_m, f_c, offset) of each joint, shape (n, 4, 4).
    covariance: Float[Array, "n 4 4"]
    # Standard deviations of the values of least variance, and how far the parameters lie beside.
    least_std: Float[Array, "n 4"]
    shift: Float[Array, "n 4"]
    # Root mean square of what is left, where the joint moves [N m].
    residual_rms: Float[Array, " n"]
    # Names of parameters that came to rest on zero, per joint: the data wanted them negative.
    at_bound: tuple[tuple[str, ...], ...]
    dof: Float[Array, "n 4"]  # degrees of freedom of each standard deviation

    def conf_int(self, level: float = 0.95) -> Float[Array, "n 4 2"]:
        """Confidence intervals of (B_m, C_m, f_c, offset), by Student's t.

        Each has degrees of freedom of its own.
        """
        values = np.stack([getattr(self.params, name) for name in NAMES], axis=1)
        return limits(values, self.shift, self.least_std, self.dof, level)

    def summary(self) -> str:
        """A table in text: one row a joint and parameter; one at zero can't be negative."""
        wide = max(len(joint) for joint in (*self.joints, "joint"))
        lines = [f"{'joint':<{wide}} {'':<15} {'value':>9}  {'95 % interval':<20} unit"]
        bounds = dict(zip(self.joints, self.at_bound, strict=True))
        for figure in self.figures():
            if figure.low == figure.high == 0.0:
                continue  # was not fitted
            at_zero = figure.name in bounds[figure.joint]
            value = 0.0 if at_zero else figure.value
            low = 0.0 if at_zero else figure.low
            note = ", none found" if at_zero else ""
            interval = f"[{low:.4g}, {figure.high:.4g}]"
            name = f"{figure.joint:<{wide}} {WORDS[figure.name]:<15}"
            lines.append(f"{name} {value:>9.4g}  {interval:<20} {figure.unit}{note}")
        return "\n".join(lines)

    def figures(self) -> list[LossFigure]:
        """All parameters, joint by joint, with 95 % intervals.

        Those of what can't be negative end at zero.
        """
        intervals = self.conf_int().tolist()
        figures = []
        for j, joint in enumerate(self.joints):
            for k, name in enumerate(NAMES):
                value = float(getattr(self.params, name)[j])
                low, high = intervals[j][k]
                low = low if name == "offset" else max(low, 0.0)
                figures.append(LossFigure(joint, name, value, low, high, UNITS[k]))
        return figures


@dataclass(frozen=True)
class LossFigure:
    """One loss parameter with its 95 % interval, for reports."""

    joint: str
    name: str
    value: float
    low: float
    high: float
    unit: str


@dataclass(frozen=True)
class InertiaFigure:
    """One base parameter of the identified arm with its 95 % interval."""

    name: str  # link and number of the independent column; other links' numbers may be added to it
    # SI units.
    value: float
    low: float
    high: float
    # Share of its prior variance that the recordings take away: near 0 it is the URDF's.
    informed: float


def loss_figures(loss: LossResults) -> tuple[LossFigure, ...]:
    """Those that were fitted, one by one."""
    return tuple(
        figure
        for figure in loss.figures()
        if figure.name != "offset" or not figure.low == figure.high == 0.0
    )
