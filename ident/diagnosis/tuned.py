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
        For each joint `LOSS_KEYS`, none negative; `transition_rad_s`, the width of the sign of Coulomb friction; and
        `link_change`, by `LINK_KEYS`, the smallest change of the URDF's link inertias that gives the tuned ones.
    """
    rank, n = evidence.layout.rank, evidence.layout.n
    figures = projection.estimate[: evidence.layout.tuned] / evidence.scale[: evidence.layout.tuned]
    losses = np.maximum(figures[rank:].reshape(n, LOSS_FIGURES), 0.0)
    links = _link_changes(baseline, figures[:rank])
    widths = baseline.loss.transition_speed
    return {
        joint: {
            **dict(zip(LOSS_KEYS, map(float, losses[j]), strict=True)),
            "transition_rad_s": float(widths[j]),
            "link_change": dict(zip(LINK_KEYS, map(float, links[j]), strict=True)),
        }
        for j, joint in enumerate(baseline.nominal.joint_names)
    }


def _link_changes(baseline: Baseline, change: Array) -> Float[Array, "n 10"]:
    """Change of all inertial numbers from that of the base parameters."""
    lift = lift_base(baseline.base, INERTIA_SHARE * parameter_scale(baseline.nominal))
    return (lift @ change).reshape(baseline.nominal.n, len(LINK_KEYS))
