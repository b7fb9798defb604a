"""A torsion spring between motor and link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.gear_twist import FINE_FACTORS, deflect, felt_torque, mean_inertia
from ident.effects.knowledge import Expression, Range, Typical, exactly_as, not_at_all
from ident.effects.typical_sizes import coefficient_interval, high_passed, rated_torque, root_mean_square

# Resonances of the link on its gear; above the last the deflection follows the load at once: one point serves all [Hz].
RESONANCES = (4.5, 6.5, 9.0, 12.5, 18.0, 30.0)
SOFTEST, STIFFEST = 1e2, 2e5  # [N m/rad]
# Damping ratios: of the search, and of the finer grid; beyond that, this many times more or less looks the same.
DAMPING_RATIO, FINE_DAMPING_RATIOS = 0.06, (0.025, 0.06, 0.14)
DAMPING_DOUBT = 4.0
# Wind-up at rated torque: soft gears and springs in series give way by ten degrees [rad]; those of large arms may still
# be as soft as small ones [N m/rad].
LARGEST_WIND_UP, SOFT = 0.2, 1e3
# Torque above this frequency shows elasticity; less of it than this share of the rated torque does not.
LOW_FREQUENCY = 2.0  # [Hz]
LEAST_HIGH_SHARE = 0.002


class JointElasticity(Effect):
    """A torsion spring between motor and link: K δ + D δ' = τ_gear. The coefficient is the compliance 1/K.

    Each point of the grid is exact at its own stiffness and follows 1/K around it.
    """

    id = "joint_elasticity"
    rows = "all"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "the gear twists under load: torque differs near the arm's resonance; look at fast changes of load"
    shown_by = "chirp"
    parted_by: ClassVar[Mapping[str, str]] = {"link_inertial_error": "chirp"}
    typical = Typical("stiffness_Nm_rad", 0.05, inverse=True)
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all("a joint has no spring between motor and link; add the module's torque"),
        "mjcf": exactly_as("a second joint `<joint>_spring` with stiffness and damping behind the motor's"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        high = root_mean_square([high_passed(run.link[:, joint], run.interval, LOW_FREQUENCY) for run in session.runs])
        if high < LEAST_HIGH_SHARE * rated_torque(session, joint):
            return (
                f"load of {session.joint_names[joint]} changes too slowly ({high:.2f} N m above {LOW_FREQUENCY:g} Hz)"
            )
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        inertia = mean_inertia(session, joint)
        found = np.unique(np.clip(inertia * (2 * np.pi * np.array(RESONANCES)) ** 2, SOFTEST, STIFFEST))
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
        compliance = coefficient_interval(0, coefficients, covariance)
        value, low, high = (
            float(np.clip(1.0 / max(c, 1.0 / STIFFEST), SOFTEST, STIFFEST))
            for c in (compliance.value, compliance.high, compliance.low)
        )
        damping = variant.shape["damping_Nms_rad"]
        return {
            "stiffness_Nm_rad": Interval(value, low, high),
            "damping_Nms_rad": Interval(damping, damping / DAMPING_DOUBT, damping * DAMPING_DOUBT),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """Soft gears wind up by ten degrees at their rated torque; of those that hold zero compliance none is told."""
        least = min(rated_torque(session, joint) / LARGEST_WIND_UP, SOFT)
        most = STIFFEST if figures["stiffness_Nm_rad"].high < STIFFEST else 0.0
        return {"stiffness_Nm_rad": Range(least, most, "the joint would fold up, or is as good as rigid")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        stiffness = figures["stiffness_Nm_rad"].words("N m/rad")
        return f"model {where} as an elastic joint of {stiffness}, or plan its motions smoother"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([1.0 / SOFTEST])


def _elastic(stiffness: float, inertia: float, ratio: float) -> Variant:
    """A point of the grid: a spring with a share of its critical damping."""
    damping = 2 * ratio * float(np.sqrt(stiffness * inertia))
    return Variant(shape={"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping})
