"""The tuned baseline as figures for a simulator: losses of each joint, and change of its link's inertia.

A baseline is tuned with the named effects and without them: friction that a Stribeck curve explains must not stand in
the Coulomb level as well.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.baseline import INERTIA_SHARE, Baseline
from ident.diagnosis.evidence import Evidence
from ident.diagnosis.layout import LOSS_FIGURES
from ident.diagnosis.projection import Projection
from ident.inertia import lift_base, parameter_scale

LOSS_KEYS = ("motor_inertia_kgm2", "viscous_Nms_rad", "coulomb_Nm")
# Effects whose law has more figures than are reported.
SHAPED = (
    "load_dependent_friction",
    "presliding_hysteresis",
    "spring_torque",
    "torque_ripple",
    "torque_saturation",
)
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
        projection: The solved model: the baseline alone, or with effects.

    Returns:
        For each joint `LOSS_KEYS`, none negative; how its friction turns round, `sliding_range_rad`, or over
        `transition_rad_s` where that is zero; `link_change`, by `LINK_KEYS`, the smallest change of the URDF's link
        inertias that gives the tuned ones; and `laws`, what the reported figures of its effects leave open, by effect.
    """
    rank, n = evidence.layout.rank, evidence.layout.n
    figures = projection.estimate[: evidence.layout.tuned] / evidence.scale[: evidence.layout.tuned]
    losses = np.maximum(figures[rank:].reshape(n, LOSS_FIGURES), 0.0)
    links = _link_changes(baseline, figures[:rank])
    sliding = baseline.sliding
    # A simulator without memory takes a smooth sign where friction turns round over a range.
    widths = np.where(sliding.range > 0.0, baseline.loss.transition_speed, sliding.speed)
    laws = _laws(evidence, projection)
    return {
        joint: {
            **dict(zip(LOSS_KEYS, map(float, losses[j]), strict=True)),
            "transition_rad_s": float(widths[j]),
            "sliding_range_rad": float(sliding.range[j]),
            "link_change": dict(zip(LINK_KEYS, map(float, links[j]), strict=True)),
            "laws": laws[j],
        }
        for j, joint in enumerate(baseline.nominal.joint_names)
    }


def _laws(evidence: Evidence, projection: Projection) -> list[dict[str, dict[str, Any]]]:
    """Coefficients and shape of the model's effects whose reported figures do not say all of their law, by joint."""
    found: list[dict[str, dict[str, Any]]] = [{} for _ in range(evidence.layout.n)]
    at = {int(column): k for k, column in enumerate(projection.inside)}
    for group in evidence.layout.groups:
        if group.effect.id in SHAPED and all(int(column) in at for column in group.columns):
            estimate = [projection.estimate[at[int(column)]] / evidence.scale[column] for column in group.columns]
            shape = {name: float(value) for name, value in group.variant.shape.items()}
            found[group.joint][group.effect.id] = {"coefficients": list(map(float, estimate)), "shape": shape}
    return found


def _link_changes(baseline: Baseline, change: Array) -> Float[Array, "n 10"]:
    """Change of all inertial numbers from that of the base parameters."""
    lift = lift_base(baseline.base, INERTIA_SHARE * parameter_scale(baseline.nominal))
    return (lift @ change).reshape(baseline.nominal.n, len(LINK_KEYS))
