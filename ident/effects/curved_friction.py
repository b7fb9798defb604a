"""Friction that bends over speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Interval, SessionContext, Variant
from ident.effects.bounds import LARGEST_TORQUE_SHARE
from ident.effects.effect_info import Expression, Range
from ident.effects.friction import LEAST_TOP_SPEED
from ident.effects.intervals import coefficient_interval, exactly, grid_interval, linear_interval
from ident.effects.states import StatesEffect
from ident.effects.typical_sizes import (
    friction_level,
    hardly_moves,
    least_rest_speed,
    rated_torque,
    top_speed,
    usual_speed,
)

VISCOUS_EXPONENTS = (0.3, 0.5, 0.7, 2.0)
# Of laws that are straight up to a knee: (its speed [rad/s], exponent beyond it).
KNEES = ((0.05, 0.2), (0.05, 0.5), (0.2, 0.2), (0.2, 0.5), (0.6, 0.2))
# Of finer grids: knees about a law's own, knees of one that has none, steps of the exponent, which knees make up for.
FINE_KNEE_FACTORS, FINE_KNEES = (0.4, 0.63, 1.0, 1.6, 2.5), (0.02, 0.05, 0.1)
FINE_BENT_STEPS = (-0.3, -0.15, -0.07, 0.0, 0.07, 0.15, 0.3)
FINE_EXPONENT_STEPS = (-0.15, -0.1, -0.05, 0.0, 0.05, 0.1, 0.15)
LEAST_EXPONENT = 0.05


def _bend(exponent: float) -> float:
    """How far u^e lies from the straight line u at most, for u from 0 to 1; e is not 1."""
    at = exponent ** (1.0 / (1.0 - exponent))
    return float(abs(at**exponent - at))


class NonlinearViscousFriction(StatesEffect):
    """Friction that bends over speed: τ = c s |v|^α; α below one for grease, two for churning.

    A power below one rises straight up at rest. Lubricants thin only beyond a knee in speed and are Newton's below it:
    such points of the grid are c s |v| (v² + v_k²)^((α − 1) / 2), the same power law far above the knee.

    Non-negative: with a tuned line beside it, a curve that bends the other way is the other exponent's.

    Source: Carreau 1972.
    """

    id = "nonlinear_viscous_friction"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = hardly_moves(session, joint)
        if reason is None and top_speed(session, joint) < LEAST_TOP_SPEED:
            return f"{session.joint_names[joint]} moves no faster than {top_speed(session, joint):.3f} rad/s"
        return reason

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        powers = tuple(Variant({"exponent": exponent}) for exponent in VISCOUS_EXPONENTS)
        fastest, rest = top_speed(session, joint), least_rest_speed(session, joint)
        return powers + tuple(
            Variant({"exponent": exponent}, shape={"knee_rad_s": knee})
            for knee, exponent in KNEES
            if rest < knee < fastest
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        middle, knee = variant.inner["exponent"], variant.shape.get("knee_rad_s")
        knees = [factor * knee for factor in FINE_KNEE_FACTORS] if knee else [*FINE_KNEES] if middle < 1.0 else []
        bent = [
            Variant({"exponent": middle + step}, shape={"knee_rad_s": one})
            for one in knees
            for step in FINE_BENT_STEPS
            if LEAST_EXPONENT <= middle + step < 1.0
        ]
        powers = [] if knee else [Variant({"exponent": middle + step}) for step in FINE_EXPONENT_STEPS]
        # A look at a finer grid begins in its middle: near it lies the point itself.
        return (*bent[: len(bent) // 2], *powers, *bent[len(bent) // 2 :])

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        shape, speed = {**variant.shape, **variant.inner}, usual_speed(session, joint)
        half, whole = (self.at_state(shape, dq=v) for v in (speed, 2.0 * speed))
        return {
            "coefficient": coefficient_interval(0, coefficients, covariance),
            "exponent": grid_interval(variant.inner["exponent"], VISCOUS_EXPONENTS),
            "knee_rad_s": exactly(variant.shape.get("knee_rad_s", 0.0)),
            "bend_Nm": linear_interval(half - 0.5 * whole, coefficients, covariance),
            "at_speed_rad_s": exactly(speed),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        fastest = max(top_speed(session, joint), LEAST_TOP_SPEED)
        exponent = figures["exponent"].value
        # Beside a line only the bend counts: of a law that is nearly straight the line takes any part.
        most = LARGEST_TORQUE_SHARE * rated_torque(session, joint) / (fastest**exponent * _bend(exponent))
        return {"coefficient": Range(0.0, most, "its bend takes more than the motor can spare")}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        coulomb, viscous = friction_level(session, joint)
        speed = max(top_speed(session, joint), LEAST_TOP_SPEED)
        return np.array([(coulomb + viscous * speed) / speed ** variant.inner["exponent"]])

    def expressed(self, form: str, figures: Mapping[str, float]) -> Expression | None:
        if form == "mjcf" and figures["exponent"] == 2.0:
            return replace(self.formats[form], answer="yes", words="second coefficient of damping")
        return super().expressed(form, figures)
