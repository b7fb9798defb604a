"""The tuned baseline as parameters for a simulator: losses and change of inertia, joint by joint.

The baseline is tuned beside the accepted effects and without them: friction that a Stribeck law
explains must not be in the Coulomb level as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.arrays import Array, Bool, Float, Int, freeze
from ident.effects import optional
from ident.inference.estimate import Estimate
from ident.model.inertia import lift_base
from ident.records import JsonRecord
from ident.regression.baseline import Baseline
from ident.regression.design import LOSS_PARAMETERS, Group
from ident.regression.factors import solve_signed
from ident.regression.gram import Evidence
from ident.regression.least_squares import Prior, Projection, project
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

    def to_dict(self) -> JsonRecord:
        """Its record for JSON: `coefficients`, and `shape` by name."""
        return {"coefficients": list(self.coefficients), "shape": dict(self.shape)}


@dataclass(frozen=True, eq=False)
class TunedJoint:
    """The tuned baseline at one joint.

    Attributes:
        motor_inertia: Reflected rotor inertia, not negative [kg m²].
        viscous: Viscous friction, not negative [N m s/rad].
        coulomb: Coulomb friction, not negative [N m].
        transition: Speed over which dry friction changes its sign, if it does so by speed [rad/s].
        sliding_range: Travel over which dry friction changes its sign after a reversal, or 0 [rad].
        link_change: Least change of the URDF's link inertia that gives the tuned one (`LINK_KEYS`).
        laws: By effect, the law that its reported parameters do not determine.
    """

    motor_inertia: float
    viscous: float
    coulomb: float
    transition: float
    sliding_range: float
    link_change: Float[Array, " 10"]
    laws: Mapping[str, OpenLaw]

    def to_dict(self) -> JsonRecord:
        """Its record for JSON.

        Returns:
            The losses by `LOSS_KEYS`, `transition_rad_s`, `sliding_range_rad`, `link_change` by
            `LINK_KEYS`, and `laws` by effect.
        """
        losses = (self.motor_inertia, self.viscous, self.coulomb)
        link_change = map(float, self.link_change)
        return {
            **dict(zip(LOSS_KEYS, losses, strict=True)),
            "transition_rad_s": self.transition,
            "sliding_range_rad": self.sliding_range,
            "link_change": dict(zip(LINK_KEYS, link_change, strict=True)),
            "laws": {name: law.to_dict() for name, law in self.laws.items()},
        }


def tuned_alone(
    baseline: Baseline, evidence: Evidence, projection: Projection
) -> dict[str, TunedJoint]:
    """The baseline's parameters as a model without effects solved it; see also `tuned_beside`.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence, projection: Scale and layout of the columns, and the solved model.

    Returns:
        The parameters by joint name.
    """
    estimate = projection.estimate[: evidence.layout.tuned]
    return _by_joint(baseline, evidence, estimate, {})


def tuned_beside(
    baseline: Baseline, evidence: Evidence, prior: Prior, estimates: Sequence[Estimate]
) -> dict[str, TunedJoint]:
    """The baseline's parameters that go with the reported parameters of effects, by joint name.

    Reported parameters are not always those of the joint solution: absorbed effects are estimated
    with the URDF fixed, and inner parameters come from a fine grid. So the baseline is solved again
    for the torque less these effects. Negative losses are set to zero, and what of an effect equals
    dry friction is moved to the Coulomb level.

    Args:
        baseline, evidence, prior: The user's arm, the sums of the effects' columns, and what the
            URDF says.
        estimates: The effects.

    Returns:
        The parameters by joint name.
    """
    groups = [estimate.refined for estimate in estimates]
    alone = project(evidence.gram(), evidence, prior)
    columns = np.concatenate([group.columns for group in groups]).astype(int)
    reported = np.concatenate([estimate.coefficients for estimate in estimates])
    beta = reported * evidence.scale[columns]
    scaled_baseline = alone.estimate - alone.slopes[:, columns] @ beta
    losses = _loss_places(evidence)
    if (scaled_baseline[losses] < 0.0).any():
        is_open = [np.full(len(group.columns), group.effect.open_law) for group in groups]
        shaped = np.concatenate(is_open)
        scaled_baseline, beta[shaped] = _without_drive(losses, alone, columns, beta, shaped)
    ends = np.cumsum([len(group.columns) for group in groups])[:-1]
    coefficients = np.split(beta / evidence.scale[columns], ends)
    for k, group in enumerate(groups):
        if not group.effect.open_law:
            continue
        coefficients[k], dry = optional.without_dry_friction(
            group.effect, coefficients[k], group.variant
        )
        coulomb = LOSS_PARAMETERS * group.joint + LOSS_KEYS.index("coulomb_Nm")
        place = losses.start + coulomb
        scaled_baseline[place] += dry * evidence.scale[place]
    laws = _open_laws(groups, coefficients)
    return _by_joint(baseline, evidence, scaled_baseline, laws)


def _loss_places(evidence: Evidence) -> slice:
    """Where the losses of all joints stand among the baseline's coefficients."""
    rank = evidence.layout.rank
    return slice(rank, rank + LOSS_PARAMETERS * evidence.layout.n)


def _open_laws(
    groups: Sequence[Group], coefficients: Sequence[Float[Array, " k"]]
) -> dict[int, dict[str, OpenLaw]]:
    """The laws that reported parameters do not determine, by joint and effect."""
    laws: dict[int, dict[str, OpenLaw]] = {}
    for group, values in zip(groups, coefficients, strict=True):
        if not optional.tells_law(group.effect, group.variant):
            continue
        constants = {**group.variant.shape, **group.variant.inner}
        shape = {name: float(value) for name, value in constants.items()}
        law = OpenLaw(tuple(map(float, values)), shape)
        laws.setdefault(group.joint, {})[group.effect.id] = law
    return laws


def _without_drive(
    losses: slice,
    alone: Projection,
    columns: Int[Array, " k"],
    beta: Float[Array, " k"],
    shaped: Bool[Array, " k"],
) -> tuple[Float[Array, " z"], Float[Array, " s"]]:
    """The baseline with losses that are not negative, and what open laws are beside it.

    Args:
        losses: Where the losses stand among the baseline's coefficients.
        alone: The model without effects.
        columns, beta: The effects' columns, and their scaled coefficients.
        shaped: Which of them are an open law's: these adapt, the others are held.

    Returns:
        Scaled coefficients of the baseline, and of the open laws.
    """
    free = columns[shaped]
    held = columns[~shaped]
    held_beta = beta[~shaped]
    information = np.linalg.inv(alone.spread)
    cross = information @ alone.slopes[:, free]
    free_block = alone.total[np.ix_(free, free)]
    matrix = np.block([[information, cross], [cross.T, free_block]])
    baseline_beside = alone.estimate - alone.slopes[:, held] @ held_beta
    of_held = alone.total[np.ix_(free, held)] @ held_beta
    score_beside = alone.total[free, -1] - of_held
    goal = np.concatenate([information @ baseline_beside, score_beside])
    size = len(alone.estimate)
    signed = np.zeros(len(goal), dtype=bool)
    signed[losses] = True
    power = np.diag(matrix)
    solution = solve_signed(matrix + np.diag(1e-9 * power), goal, signed)
    return solution[:size], solution[size:]


def _by_joint(
    baseline: Baseline,
    evidence: Evidence,
    scaled: Float[Array, " z"],
    laws: Mapping[int, Mapping[str, OpenLaw]],
) -> dict[str, TunedJoint]:
    """Baseline parameters by joint name.

    Args:
        baseline, evidence: The user's arm, and scale and layout of the columns.
        scaled: Coefficients of the baseline in the columns' scale.
        laws: The open laws by joint and effect.
    """
    rank = evidence.layout.rank
    n = evidence.layout.n
    coefficients = scaled / evidence.scale[: evidence.layout.tuned]
    solved_losses = coefficients[_loss_places(evidence)].reshape(n, LOSS_PARAMETERS)
    losses = np.maximum(solved_losses, 0.0)
    tolerance = baseline.settings.inertia_share * parameter_scale(baseline.nominal)
    lift = lift_base(baseline.base, tolerance)
    links = (lift @ coefficients[:rank]).reshape(n, len(LINK_KEYS))
    sliding = baseline.sliding
    # A simulator without memory takes a smooth sign where friction turns round over a range.
    widths = np.where(sliding.range > 0.0, baseline.loss.transition_speed, sliding.speed)
    joints: dict[str, TunedJoint] = {}
    for j, joint in enumerate(baseline.nominal.joint_names):
        joints[joint] = TunedJoint(
            motor_inertia=float(losses[j, 0]),
            viscous=float(losses[j, 1]),
            coulomb=float(losses[j, 2]),
            transition=float(widths[j]),
            sliding_range=float(sliding.range[j]),
            link_change=freeze(links[j]),
            laws=laws.get(j, {}),
        )
    return joints
