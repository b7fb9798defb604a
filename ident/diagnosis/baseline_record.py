"""The tuned baseline as figures for a simulator: losses of each joint, and change of its link's inertia.

A baseline is tuned with the named effects and without them: friction that a Stribeck curve explains must not stand in
the Coulomb level as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ident.arrays import Array, Bool, Float, Int
from ident.diagnosis.regression.baseline import Baseline
from ident.diagnosis.regression.design import LOSS_FIGURES, Group
from ident.diagnosis.regression.gram import Evidence
from ident.diagnosis.regression.least_squares import Projection, solve_signed
from ident.model.inertia import lift_base, parameter_scale

LOSS_KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Order of a link's ten inertial numbers, about its joint's frame.
LINK_KEYS = (
    "mass_kg",
    *(f"moment_{axis}_kgm" for axis in "xyz"),
    *(f"inertia_{axes}_kgm2" for axes in ("xx", "xy", "yy", "xz", "yz", "zz")),
)


def tuned_record(baseline: Baseline, evidence: Evidence, projection: Projection) -> dict[str, dict[str, Any]]:
    """Figures of the baseline as a model solved it, by joint.

    Args:
        baseline: The user's arm, and which combinations of its inertias were tuned.
        evidence: Scale and layout of the columns.
        projection: The solved model: the baseline alone; beside effects it is `tuned_beside`.

    Returns:
        For each joint `LOSS_KEYS`, none negative; how its friction turns round, `sliding_range_rad`, or over
        `transition_rad_s` where that is zero; `link_change`, by `LINK_KEYS`, the smallest change of the URDF's link
        inertias that gives the tuned ones; and `laws`, by effect, what the reported figures of effects leave open.
    """
    return _record(baseline, evidence, projection.estimate[: evidence.layout.tuned], {})


def tuned_beside(
    baseline: Baseline,
    evidence: Evidence,
    alone: Projection,
    groups: Sequence[Group],
    coefficients: Sequence[Float[Array, " k"]],
) -> dict[str, dict[str, Any]]:
    """Figures of the baseline that goes with effects of given size, as `tuned_record`.

    Reported figures are not always those of the model that solves everything at once: what tuning would absorb is told
    against the URDF held fast, and inner figures from a finer grid. What the tuned arm has to explain then is the
    torque less these effects. Losses that would drive are held at zero.

    Args:
        baseline: The user's arm.
        evidence: Sums that hold the effects' columns.
        alone: The baseline alone, solved on them.
        groups: The effects at the points that are told.
        coefficients: Their coefficients.
    """
    columns = np.concatenate([group.columns for group in groups]).astype(int)
    beta = np.concatenate(list(coefficients)) * evidence.scale[columns]
    figures = alone.estimate - alone.slopes[:, columns] @ beta
    if (figures[evidence.layout.rank :] < 0.0).any():
        shaped = np.concatenate([np.full(len(g.columns), g.effect.open_law) for g in groups])
        figures, beta[shaped] = _without_drive(evidence.layout.rank, alone, columns, beta, shaped)
    ends = np.cumsum([len(group.columns) for group in groups])[:-1]
    return _record(baseline, evidence, figures, _laws(groups, np.split(beta / evidence.scale[columns], ends)))


def _without_drive(
    rank: int, alone: Projection, columns: Int[Array, " k"], beta: Float[Array, " k"], shaped: Bool[Array, " k"]
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
    signed = (np.arange(len(goal)) >= rank) & (np.arange(len(goal)) < size)
    power = np.diag(matrix)
    solution = solve_signed(matrix + np.diag(1e-9 * power), goal, signed)
    return solution[:size], solution[size:]


def _record(
    baseline: Baseline, evidence: Evidence, scaled: Float[Array, " z"], laws: Mapping[int, dict[str, Any]]
) -> dict[str, dict[str, Any]]:
    rank, n = evidence.layout.rank, evidence.layout.n
    figures = scaled / evidence.scale[: evidence.layout.tuned]
    losses = np.maximum(figures[rank:].reshape(n, LOSS_FIGURES), 0.0)
    links = _link_changes(baseline, figures[:rank])
    sliding = baseline.sliding
    # A simulator without memory takes a smooth sign where friction turns round over a range.
    widths = np.where(sliding.range > 0.0, baseline.loss.transition_speed, sliding.speed)
    return {
        joint: {
            **dict(zip(LOSS_KEYS, map(float, losses[j]), strict=True)),
            "transition_rad_s": float(widths[j]),
            "sliding_range_rad": float(sliding.range[j]),
            "link_change": dict(zip(LINK_KEYS, map(float, links[j]), strict=True)),
            "laws": laws.get(j, {}),
        }
        for j, joint in enumerate(baseline.nominal.joint_names)
    }


def _laws(groups: Sequence[Group], coefficients: Sequence[Float[Array, " k"]]) -> dict[int, dict[str, dict[str, Any]]]:
    """Coefficients and shape of the effects whose reported figures do not say all of their law, by joint."""
    found: dict[int, dict[str, dict[str, Any]]] = {}
    for group, values in zip(groups, coefficients, strict=True):
        if group.effect.open_law:
            figures = {**group.variant.shape, **group.variant.inner}
            shape = {name: float(value) for name, value in figures.items()}
            law = {"coefficients": list(map(float, values)), "shape": shape}
            found.setdefault(group.joint, {})[group.effect.id] = law
    return found


def _link_changes(baseline: Baseline, change: Array) -> Float[Array, "n 10"]:
    """Change of all inertial numbers from that of the base parameters."""
    lift = lift_base(baseline.base, baseline.settings.inertia_share * parameter_scale(baseline.nominal))
    return (lift @ change).reshape(baseline.nominal.n, len(LINK_KEYS))
