"""The tuned baseline as numbers for a simulator: losses of each joint, and change of its link's inertia.

A baseline is tuned with the named effects and without them: friction that a Stribeck curve explains must not stand in
the Coulomb level as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.diagnosis.selection.name_probability import Estimate
from ident.diagnosis.selection.refine import Refined
from ident.model.inertia import lift_base, parameter_scale
from ident.regression.baseline import Baseline
from ident.regression.design import LOSS_PARAMETERS
from ident.regression.gram import Evidence
from ident.regression.least_squares import Projection, project, solve_signed

LOSS_KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Order of a link's ten inertial numbers, about its joint's frame.
LINK_KEYS = (
    "mass_kg",
    *(f"moment_{axis}_kgm" for axis in "xyz"),
    *(f"inertia_{axes}_kgm2" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")),
)


@dataclass(frozen=True)
class OpenLaw:
    """What the reported parameters of an effect leave open of its law."""

    coefficients: tuple[float, ...]  # of its columns, in their order
    shape: Mapping[str, float]  # its inner parameters, and what gives its columns their form

    def to_dict(self) -> dict[str, Any]:
        return {"coefficients": list(self.coefficients), "shape": dict(self.shape)}


@dataclass(frozen=True, eq=False)
class TunedJoint:
    """The tuned baseline at one joint."""

    motor_inertia: float  # losses, none negative [kg m², N m s/rad, N m]
    viscous: float
    coulomb: float
    transition: float  # speed over which dry friction turns round where it does not over a range [rad/s]
    sliding_range: float  # range over which it does, or 0 [rad]
    # Smallest change of the URDF's link inertias that gives the tuned ones, in the order of `LINK_KEYS`.
    link_change: Float[Array, " 10"]
    laws: Mapping[str, OpenLaw]  # by effect, what its reported parameters leave open

    def to_dict(self) -> dict[str, Any]:
        return {
            **dict(zip(LOSS_KEYS, (self.motor_inertia, self.viscous, self.coulomb), strict=True)),
            "transition_rad_s": self.transition,
            "sliding_range_rad": self.sliding_range,
            "link_change": dict(zip(LINK_KEYS, map(float, self.link_change), strict=True)),
            "laws": {name: law.to_dict() for name, law in self.laws.items()},
        }


def tuned_alone(baseline: Baseline, evidence: Evidence, projection: Projection) -> dict[str, TunedJoint]:
    """Parameters of the baseline as a model solved it, by joint.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence: Scale and layout of the columns.
        projection: The solved model: the baseline alone; beside effects it is `tuned_beside`.
    """
    return _by_joint(baseline, evidence, projection.estimate[: evidence.layout.tuned], {})


def tuned_beside(baseline: Baseline, fine: Refined, estimates: Sequence[Estimate]) -> dict[str, TunedJoint]:
    """Parameters of the baseline that goes with the reported ones of effects, as `tuned_alone`.

    Reported parameters are not always those of the model that solves everything at once: what tuning would absorb is
    reported against the URDF fixed, and inner parameters from a finer grid. What the tuned arm has to explain then is
    the torque less these effects. Losses that would drive are held at zero, and what of an effect is as well a joint's
    dry friction is counted there.

    Args:
        baseline: The user's arm.
        fine: Sums that hold the effects' columns.
        estimates: The effects.
    """
    evidence, groups = fine.search.evidence, [one.refined for one in estimates]
    alone = project(evidence.gram(), evidence, fine.search.prior)
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
            found[k], dry = group.effect.without_dry_friction(found[k], group.variant)
            place = evidence.layout.rank + LOSS_PARAMETERS * group.joint + LOSS_KEYS.index("coulomb_Nm")
            scaled_baseline[place] += dry * evidence.scale[place]
    laws: dict[int, dict[str, OpenLaw]] = {}
    for group, values in zip(groups, found, strict=True):
        if group.effect.tells_law(group.variant):
            shape = {**group.variant.shape, **group.variant.inner}
            law = OpenLaw(tuple(map(float, values)), {name: float(value) for name, value in shape.items()})
            laws.setdefault(group.joint, {})[group.effect.id] = law
    return _by_joint(baseline, evidence, scaled_baseline, laws)


def _without_drive(
    losses: slice, alone: Projection, columns: Int[Array, " k"], beta: Float[Array, " k"], shaped: Bool[Array, " k"]
) -> tuple[Float[Array, " z"], Float[Array, " s"]]:
    """The baseline with losses that aren't negative, and the coefficients of laws that may follow it."""
    free, held = columns[shaped], columns[~shaped]
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
    rank, n = evidence.layout.rank, evidence.layout.n
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
