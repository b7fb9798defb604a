"""The tuned baseline as parameters for a simulator: losses of each joint, and change of its link's inertia.

The baseline is tuned beside the accepted effects and without them: friction that a Stribeck law explains must not be in
the Coulomb level as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.effects import optional
from ident.inference.estimate import Estimate
from ident.model.inertia import lift_base
from ident.regression.baseline import Baseline
from ident.regression.design import LOSS_PARAMETERS
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project, solve_signed
from ident.robot.tolerance import parameter_scale

LOSS_KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Order of a link's ten inertial parameters, in its joint's frame.
LINK_KEYS = (
    "mass_kg",
    *(f"moment_{axis}_kgm" for axis in "xyz"),
    *(f"inertia_{axes}_kgm2" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")),
)


@dataclass(frozen=True)
class OpenLaw:
    """Coefficients of a law whose reported parameters do not determine it completely."""

    coefficients: tuple[float, ...]  # of its columns, in their order
    shape: Mapping[str, float]  # inner parameters and other constants of its columns

    def to_dict(self) -> dict[str, Any]:
        """Its record, for JSON."""
        return {"coefficients": list(self.coefficients), "shape": dict(self.shape)}


@dataclass(frozen=True, eq=False)
class TunedJoint:
    """The tuned baseline at one joint."""

    motor_inertia: float  # reflected rotor inertia, not negative [kg m²]
    viscous: float  # viscous friction, not negative [N m s/rad]
    coulomb: float  # Coulomb friction, not negative [N m]
    transition: float  # speed over which dry friction changes its sign, if it does so by speed [rad/s]
    sliding_range: float  # travel over which dry friction changes its sign after a reversal, or 0 [rad]
    link_change: Float[Array, " 10"]  # least change of the URDF's link inertia that gives the tuned one (`LINK_KEYS`)
    laws: Mapping[str, OpenLaw]  # by effect, the law that its reported parameters do not determine

    def to_dict(self) -> dict[str, Any]:
        """Its record, for JSON."""
        return {
            **dict(zip(LOSS_KEYS, (self.motor_inertia, self.viscous, self.coulomb), strict=True)),
            "transition_rad_s": self.transition,
            "sliding_range_rad": self.sliding_range,
            "link_change": dict(zip(LINK_KEYS, map(float, self.link_change), strict=True)),
            "laws": {name: law.to_dict() for name, law in self.laws.items()},
        }


def tuned_alone(baseline: Baseline, evidence: Evidence, projection: Projection) -> dict[str, TunedJoint]:
    """The baseline's parameters as a model without effects solved it, by joint name; see also `tuned_beside`.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence, projection: Scale and layout of the columns, and the solved model.
    """
    return _by_joint(baseline, evidence, projection.estimate[: evidence.layout.tuned], {})


def tuned_beside(
    baseline: Baseline, evidence: Evidence, prior: Prior, estimates: Sequence[Estimate]
) -> dict[str, TunedJoint]:
    """The baseline's parameters that go with the reported parameters of effects, by joint name.

    Reported parameters are not always those of the joint solution: absorbed effects are estimated with the URDF fixed,
    and inner parameters come from a fine grid. So the baseline is solved again for the torque less these effects.
    Negative losses are set to zero, and the part of an effect that equals dry friction is moved to the Coulomb level.

    Args:
        baseline, evidence, prior: The user's arm, the sums of the effects' columns, and what the URDF says.
        estimates: The effects.
    """
    groups = [one.refined for one in estimates]
    alone = project(evidence.gram(), evidence, prior)
    columns = np.concatenate([group.columns for group in groups]).astype(int)
    beta = np.concatenate([one.coefficients for one in estimates]) * evidence.scale[columns]
    scaled_baseline = alone.estimate - alone.slopes[:, columns] @ beta
    rank = evidence.layout.rank
    losses = slice(rank, rank + LOSS_PARAMETERS * evidence.layout.n)
    if (scaled_baseline[losses] < 0.0).any():
        shaped = np.concatenate([np.full(len(g.columns), g.effect.open_law) for g in groups])
        scaled_baseline, beta[shaped] = _without_drive(losses, alone, columns, beta, shaped)
    ends = np.cumsum([len(group.columns) for group in groups])[:-1]
    found = np.split(beta / evidence.scale[columns], ends)
    for k, group in enumerate(groups):
        if group.effect.open_law:
            found[k], dry = optional.without_dry_friction(group.effect, found[k], group.variant)
            place = evidence.layout.rank + LOSS_PARAMETERS * group.joint + LOSS_KEYS.index("coulomb_Nm")
            scaled_baseline[place] += dry * evidence.scale[place]
    laws: dict[int, dict[str, OpenLaw]] = {}
    for group, values in zip(groups, found, strict=True):
        if optional.tells_law(group.effect, group.variant):
            shape = {**group.variant.shape, **group.variant.inner}
            law = OpenLaw(tuple(map(float, values)), {name: float(value) for name, value in shape.items()})
            laws.setdefault(group.joint, {})[group.effect.id] = law
    return _by_joint(baseline, evidence, scaled_baseline, laws)


def _without_drive(
    losses: slice, alone: Projection, columns: Int[Array, " k"], beta: Float[Array, " k"], shaped: Bool[Array, " k"]
) -> tuple[Float[Array, " z"], Float[Array, " s"]]:
    """The baseline with losses constrained to be non-negative, and the coefficients of open laws that adapt to it."""
    free = columns[shaped]
    held = columns[~shaped]
    information = np.linalg.inv(alone.spread)
    cross = information @ alone.slopes[:, free]
    matrix = np.block([[information, cross], [cross.T, alone.total[np.ix_(free, free)]]])
    goal = np.concatenate(
        [
            information @ (alone.estimate - alone.slopes[:, held] @ beta[~shaped]),
            alone.total[free, -1] - alone.total[np.ix_(free, held)] @ beta[~shaped],
        ]
    )
    size = len(alone.estimate)
    signed = np.zeros(len(goal), dtype=bool)
    signed[losses] = True
    power = np.diag(matrix)
    solution = solve_signed(matrix + np.diag(1e-9 * power), goal, signed)
    return solution[:size], solution[size:]


def _by_joint(
    baseline: Baseline, evidence: Evidence, scaled: Float[Array, " z"], laws: Mapping[int, Mapping[str, OpenLaw]]
) -> dict[str, TunedJoint]:
    """Baseline parameters by joint name, from scaled coefficients and the open laws by joint and effect."""
    rank = evidence.layout.rank
    n = evidence.layout.n
    scaled_baseline = scaled / evidence.scale[: evidence.layout.tuned]
    losses = np.maximum(scaled_baseline[rank : rank + LOSS_PARAMETERS * n].reshape(n, LOSS_PARAMETERS), 0.0)
    lift = lift_base(baseline.base, baseline.settings.inertia_share * parameter_scale(baseline.nominal))
    links = (lift @ scaled_baseline[:rank]).reshape(n, len(LINK_KEYS))
    sliding = baseline.sliding
    # A simulator without memory takes a smooth sign where friction turns round over a range.
    widths = np.where(sliding.range > 0.0, baseline.loss.transition_speed, sliding.speed)
    return {
        joint: TunedJoint(
            motor_inertia=float(losses[j, 0]),
            viscous=float(losses[j, 1]),
            coulomb=float(losses[j, 2]),
            transition=float(widths[j]),
            sliding_range=float(sliding.range[j]),
            link_change=freeze(links[j]),
            laws=laws.get(j, {}),
        )
        for j, joint in enumerate(baseline.nominal.joint_names)
    }
