"""Changes that are no effects of the catalogue.

Of plain friction, and of torque that follows no known law.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.diagnosis.change.settings import CHANGE
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.effect_info import AsChange, Range
from ident.effects.intervals import coefficient_interval, delta_interval, linear_interval
from ident.effects.session_context import friction_level, hardly_moves, travel
from ident.units import TORQUE

# Id of a change that follows no law of the catalogue.
UNLISTED = "unlisted_change"
# Id of a change of plain friction.
PLAIN_FRICTION = "friction_change"


class FrictionChange(Effect):
    """Change of plain friction, τ = f s + c v.

    F of the Coulomb level, c of the viscous slope, s the direction.

    In one recording these are tuned as losses of the baseline; only between two is their change a
    finding.
    """

    id = PLAIN_FRICTION
    summary = "the joint turns harder or more easily than before"
    defining = ("coulomb_change_Nm", "viscous_change_Nms_rad")
    as_change = AsChange(friction=True)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return hardly_moves(session, joint)

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        """Friction that trebles is the most that is plausible."""
        return 2.0 * np.array(friction_level(session, joint))

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return [
            np.stack([run.direction[:, joint], run.motion.dq[:, joint]], axis=1)
            for run in session.runs
        ]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        """The two changes, and their sum as a share of the friction at the joint's mean speed."""
        coulomb, viscous = friction_level(session, joint)
        speeds = [run.motion.dq[:, joint] for run in session.runs]
        speed = np.abs(np.concatenate(speeds))
        rest = min(float(run.motion.rest_speed[joint]) for run in session.runs)
        usual = float(speed[speed > rest].mean()) if (speed > rest).any() else rest
        share = np.array([1.0, usual]) / (coulomb + viscous * usual)
        return {
            "coulomb_change_Nm": coefficient_interval(0, coefficients, covariance),
            "viscous_change_Nms_rad": coefficient_interval(1, coefficients, covariance),
            "friction_change": linear_interval(share, coefficients, covariance),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        if estimates["friction_change"].high < -1.0:
            return {"friction_change": Range(-1.0, np.inf, "friction would drive the joint")}
        return {}

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        share = estimates["friction_change"]
        way = "more" if share.value > 0.0 else "less"
        words = share.words("%", 100.0, size=True)
        if share.value > 0.0:
            return f"look at grease, seal and brake of {where}: it rubs {words} {way} than before"
        return f"tune the friction of {where} anew: it rubs {words} {way} than before"


class UnlistedChange(Effect):
    """Torque that follows no law of the catalogue.

    Piecewise linear in the angle, with a part odd in the direction.
    """

    id = UNLISTED
    summary = "torque differs over the joint's angle or direction, by no law of the catalogue"
    defining = ("rms_Nm",)
    as_change = AsChange(friction=True)
    variance_floor: ClassVar[float] = 1e-12

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        return hardly_moves(session, joint)

    def variants(self, session: SessionContext, joint: int) -> tuple[Variant, ...]:
        low, high = travel(session, joint)
        return (Variant(shape={"low_rad": low, "high_rad": high}),)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        low = variant.shape["low_rad"]
        high = variant.shape["high_rad"]
        columns = []
        for run in session.runs:
            place = (run.motion.q[:, joint] - low) / max(high - low, 1e-9)
            odd = run.direction[:, joint, None] * _hats(place, CHANGE.points_odd)
            columns.append(np.concatenate([_hats(place, CHANGE.points_even), odd], axis=1))
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        columns = np.concatenate(self.columns(session, joint, variant))
        power = columns.T @ columns / len(columns)
        size = delta_interval(
            lambda c: np.sqrt(max(c @ power @ c, self.variance_floor)), coefficients, covariance
        )
        return {"rms_Nm": size}

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        size = estimates["rms_Nm"].words(TORQUE)
        return (
            f"look at {where}: its torque differs by {size} (rms), as no law of the catalogue does"
        )


def _hats(place: Float[Array, " T"], points: int) -> Float[Array, "T p"]:
    """Piecewise linear basis functions over [0, 1]: each one at its node, zero at all others."""
    in_nodes = np.clip(place, 0.0, 1.0)[:, None] * (points - 1)
    distance = np.abs(in_nodes - np.arange(points))
    return np.asarray(np.maximum(0.0, 1.0 - distance))
