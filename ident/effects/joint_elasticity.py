"""A torsion spring between motor and link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.effect_info import Range
from ident.effects.gear_twist import FINE_FACTORS, deflect, felt_torque, mean_inertia
from ident.effects.intervals import coefficient_interval
from ident.effects.typical_sizes import high_passed, rated_torque, root_mean_square

# Resonances of the link on its gear; above the last the deflection follows the load at once: one point serves all [Hz].
RESONANCES = (2.2, 4.5, 6.5, 9.0, 12.5, 18.0, 30.0)
# Wind-up of a gear at its joint's rated torque: of springs in series, and of what is as good as rigid [rad].
LARGEST_WIND_UP, LEAST_WIND_UP = 2.0, 1e-4
# Damping ratios: of the search, and of the finer grid; beyond that, this many times more or less looks the same.
DAMPING_RATIO, FINE_DAMPING_RATIOS = 0.06, (0.025, 0.06, 0.14)
DAMPING_DOUBT = 4.0
# Torque above this frequency shows elasticity; less of it than this share of the rated torque does not.
LOW_FREQUENCY = 2.0  # [Hz]
LEAST_HIGH_SHARE = 0.002


class JointElasticity(Effect):
    """A torsion spring between motor and link: K δ + D δ' = τ_gear. The coefficient is the compliance 1/K.

    Each point of the grid is exact at its own stiffness and follows 1/K around it.
    """

    id = "joint_elasticity"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        high = root_mean_square([high_passed(run.link[:, joint], run.interval, LOW_FREQUENCY) for run in session.runs])
        if high < LEAST_HIGH_SHARE * rated_torque(session, joint):
            return (
                f"load of {session.joint_names[joint]} changes too slowly ({high:.2f} N m above {LOW_FREQUENCY:g} Hz)"
            )
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        inertia = mean_inertia(session, joint)
        found = np.unique(np.clip(inertia * (2 * np.pi * np.array(RESONANCES)) ** 2, *_bounds(session, joint)))
        return tuple(_elastic(float(k), inertia, DAMPING_RATIO) for k in found)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        inertia = mean_inertia(session, joint)
        return tuple(
            _elastic(factor * variant.shape["stiffness_Nm_rad"], inertia, ratio)
            for ratio in FINE_DAMPING_RATIOS
            for factor in FINE_FACTORS
        )

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        stiffness, damping = variant.shape["stiffness_Nm_rad"], variant.shape["damping_Nms_rad"]
        return [
            stiffness * felt_torque(run, joint, *deflect(run, joint, stiffness, damping, 0.0))[:, :, None]
            for run in session.runs
        ]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        compliance, (softest, stiffest) = coefficient_interval(0, coefficients, covariance), _bounds(session, joint)
        value, low, high = (
            float(np.clip(1.0 / max(c, 1.0 / stiffest), softest, stiffest))
            for c in (compliance.value, compliance.high, compliance.low)
        )
        damping = variant.shape["damping_Nms_rad"]
        return {
            "stiffness_Nm_rad": Interval(value, low, high),
            "damping_Nms_rad": Interval(damping, damping / DAMPING_DOUBT, damping * DAMPING_DOUBT),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """A joint that winds up by radians would fold; one whose interval holds zero compliance is as good as rigid."""
        least, stiffest = _bounds(session, joint)
        most = stiffest if figures["stiffness_Nm_rad"].high < stiffest else 0.0
        return {"stiffness_Nm_rad": Range(least, most, "the joint would fold up, or is as good as rigid")}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([1.0 / _bounds(session, joint)[0]])


def _bounds(session: SessionContext, joint: int) -> tuple[float, float]:
    """Stiffness of the softest gear that turns at all, and of one as good as rigid [N m/rad]."""
    rated = rated_torque(session, joint)
    return rated / LARGEST_WIND_UP, rated / LEAST_WIND_UP


def _elastic(stiffness: float, inertia: float, ratio: float) -> Variant:
    """A point of the grid: a spring with a share of its critical damping."""
    damping = 2 * ratio * float(np.sqrt(stiffness * inertia))
    return Variant(shape={"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping})
