"""Friction that depends on low speed, load, place and direction: what a Coulomb and viscous model
leaves out.

Friction that bends over speed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Interval, Range, SessionContext, Variant
from ident.effects.intervals import (
    coefficient_interval,
    exactly,
    grid_interval,
    linear_interval,
    wave_parameters,
)
from ident.effects.session_context import (
    LARGEST_TORQUE_SHARE,
    coulomb_level,
    friction_level,
    joined,
    least_rest_speed,
    rated_torque,
    top_speed,
    travel,
    typical_load,
    usual_speed,
)
from ident.effects.settings import FRICTION as LIMIT
from ident.effects.states_effect import StatesEffect


class StribeckFriction(StatesEffect):
    """Friction that falls as motion sets in: τ = A s exp(−(|v| / v_s)^δ).

    Source: Bittencourt and Gunnarsson 2010, with the static level as what is added to Coulomb
    friction.
    """

    id = "stribeck_friction"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        noisy = (
            f"velocity of {session.joint_names[joint]} is too noisy to tell slow motion from rest"
        )
        return super().untestable(session, joint) or (
            None if self.variants(session, joint) else noisy
        )

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        speed = variant.inner["stribeck_velocity_rad_s"]
        left = linear_interval(self.at_state(variant.inner, dq=speed), coefficients, covariance)
        estimates = super().parameters(session, joint, variant, coefficients, covariance)
        return {**estimates, "left_Nm": left, "at_speed_rad_s": exactly(speed)}


class LoadDependentFriction(StatesEffect):
    """Friction that grows with the load on the gear, more so when the motor drives than when the
    load does.

    With a = s |τ_l| and b = s² τ_l, (a + b) / 2 is the load while driving and (a − b) / 2 while
    backdriving. The two columns are driving + half of backdriving and the reverse: with
    coefficients that aren't negative the two levels differ at most by a factor of two, so that no
    error of the torque gain (driving = −backdriving) can pass for friction. The second variant adds
    s τ_l² and v |τ_l|. μ is the mean of driving and backdriving, at typical load.

    Source: Hamon, Gautier and Garrec 2010; the load is the modelled one, the measured one is part
    of what it explains.
    """

    id = "load_dependent_friction"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        name = session.joint_names[joint]
        least = LIMIT.least_load_range * rated_torque(session, joint)
        load = np.abs(joined(session, "link", joint))
        low, high = np.quantile(load, [0.05, 0.95])
        span = float(high - low)
        steady = f"load of {name} varies by {span:.2f} N m only"
        if np.ptp(session.runs[0].arm.weight_in_poses[:, joint]) < least:
            steady = f"no torque depends on it: gravity loads {name} alike in every pose"
        return super().untestable(session, joint) or (None if span >= least else steady)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        typical = {"load_Nm": typical_load(session, joint)}
        typical["speed_rad_s"] = float(np.mean(np.abs(joined(session, "dq", joint))))
        return (Variant(shape={**typical, "terms": 2}), Variant(shape={**typical, "terms": 4}))

    def is_plain(self, variant: Variant) -> bool:
        return int(variant.shape["terms"]) == 2

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        load = variant.shape["load_Nm"]
        speed = variant.shape["speed_rad_s"]
        both = [self.at_state(variant.shape, dq=speed, load=sign * load) for sign in (1.0, -1.0)]
        return {
            "mu": linear_interval((both[0] + both[1]) / (2.0 * load), coefficients, covariance),
            "at_load_Nm": exactly(load),
            "at_speed_rad_s": exactly(speed),
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.full(int(variant.shape["terms"]), LIMIT.largest_load_share)

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs; without coefficients driving and backdriving are alike."""
        return super().law_figures(reported, coefficients or 2 * [reported["mu"] / 1.5], shape)


class PositionDependentFriction(StatesEffect):
    """Friction that varies over a turn: τ = s A cos(k q − φ)."""

    id = "position_dependent_friction"

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        """Those of the wave, and by how much friction varies over the angles that were seen.

        Half of that is `swing_Nm`, which may be far less than the amplitude; `at_low_rad` and
        `at_high_rad` are where friction is least and greatest.
        """
        order = variant.inner["order"]
        seen = np.linspace(*travel(session, joint), 100)
        wave = np.column_stack([np.cos(order * seen), np.sin(order * seen)])
        least = int(np.argmin(wave @ coefficients))
        most = int(np.argmax(wave @ coefficients))
        swing = linear_interval(0.5 * (wave[most] - wave[least]), coefficients, covariance)
        shown = {"swing_Nm": replace(swing, low=max(swing.low, 0.0))}
        shown |= {
            "at_low_rad": exactly(float(seen[least])),
            "at_high_rad": exactly(float(seen[most])),
        }
        return wave_parameters(order, coefficients, covariance) | shown

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """Passive: where it takes friction away, no less than none may be left; at angles that were
        not seen, anything.

        Coulomb friction is what there is on the mean of the way: the wave's own mean on that way is
        in it.
        """
        turned = estimates["order"].value * joined(session, "q", joint)
        wave = np.cos(turned - estimates["phase_rad"].value)
        most = coulomb_level(session, joint) / max(float(wave.mean() - wave.min()), 1e-9)
        return {
            "amplitude_Nm": Range(
                0.0, most, "friction would drive the joint: more than Coulomb friction varies"
            )
        }

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs: cosine and sine of its wave [N m], and its order."""
        if not coefficients:
            size = reported["amplitude_Nm"]
            phase = reported["phase_rad"]
            coefficients = (
                size * float(np.cos(phase)),
                size * float(np.sin(phase)),
            )
        return super().law_figures(reported, coefficients, shape)


class AsymmetricFriction(StatesEffect):
    """Friction that differs between the directions: f₊ − f₋ is reported, half of it acts on either
    side.

    τ = s² (f_c₊ − f_c₋) / 2 + |v| (C₊ − C₋) / 2. In motion s² is one: the first column is a torque
    offset then, which differs from it only at rest and in reversals.
    """

    id = "asymmetric_friction"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        dq = joined(session, "dq", joint)
        rest = max(float(run.motion.rest_speed[joint]) for run in session.runs)
        forward = float(np.mean(dq > rest))
        backward = float(np.mean(dq < -rest))
        one_way = min(forward, backward) < 0.05 * max(forward, backward)
        reason = f"{session.joint_names[joint]} moves in one direction only"
        return super().untestable(session, joint) or (reason if one_way else None)

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        speed = usual_speed(session, joint)
        both = self.at_state({}, dq=speed) + self.at_state({}, dq=-speed)
        difference = linear_interval(both, coefficients, covariance)
        estimates = super().parameters(session, joint, variant, coefficients, covariance)
        return {**estimates, "difference_Nm": difference, "at_speed_rad_s": exactly(speed)}

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """Passive in both directions, from slow motion up to the joint's top speed."""
        coulomb, viscous = friction_level(session, joint)
        reason = "friction of one direction would drive the joint"
        slow = 0.1 * top_speed(session, joint)
        fast = top_speed(session, joint)
        difference, slope = (estimates[name].value for name in self.defining)
        least = min(coulomb + viscous * v - 0.5 * abs(difference + slope * v) for v in (slow, fast))
        limits = zip(self.defining, (2.0 * coulomb, 2.0 * viscous), strict=True)
        return {} if least >= 0.0 else {name: Range(-most, most, reason) for name, most in limits}


class NonlinearViscousFriction(StatesEffect):
    """Friction that bends over speed: τ = c s |v|^α; α below one for grease, two for churning.

    A power below one rises straight up at rest. Lubricants thin only beyond a knee in speed and are
    Newton's below it: such points of the grid are c s |v| (v² + v_k²)^((α − 1) / 2), the same power
    law far above the knee.

    Non-negative: with a tuned line beside it, a curve that bends the other way is the other
    exponent's.

    Source: Carreau 1972.
    """

    id = "nonlinear_viscous_friction"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        powers = tuple(Variant({"exponent": exponent}) for exponent in LIMIT.viscous_exponents)
        fastest = top_speed(session, joint)
        rest = least_rest_speed(session, joint)
        return powers + tuple(
            Variant({"exponent": exponent}, shape={"knee_rad_s": knee})
            for knee, exponent in LIMIT.knees
            if rest < knee < fastest
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        middle = variant.inner["exponent"]
        knee = variant.shape.get("knee_rad_s")
        knees = (
            [factor * knee for factor in LIMIT.fine_knee_factors]
            if knee
            else [*LIMIT.fine_knees]
            if middle < 1.0
            else []
        )
        bent = [
            Variant({"exponent": middle + step}, shape={"knee_rad_s": fine_knee})
            for fine_knee in knees
            for step in LIMIT.fine_bent_steps
            if LIMIT.least_exponent <= middle + step < 1.0
        ]
        powers = (
            []
            if knee
            else [Variant({"exponent": middle + step}) for step in LIMIT.fine_exponent_steps]
        )
        # A look at a finer grid begins in its middle: near it lies the point itself.
        half = len(bent) // 2
        return (*bent[:half], *powers, *bent[half:])

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        shape = {**variant.shape, **variant.inner}
        speed = usual_speed(session, joint)
        half, whole = (self.at_state(shape, dq=v) for v in (speed, 2.0 * speed))
        return {
            "coefficient": coefficient_interval(0, coefficients, covariance),
            "exponent": grid_interval(variant.inner["exponent"], LIMIT.viscous_exponents),
            "knee_rad_s": exactly(variant.shape.get("knee_rad_s", 0.0)),
            "bend_Nm": linear_interval(half - 0.5 * whole, coefficients, covariance),
            "at_speed_rad_s": exactly(speed),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        fastest = max(top_speed(session, joint), LIMIT.least_top_speed)
        exponent = estimates["exponent"].value
        # Beside a line only the bend counts: of a law that is nearly straight the line takes any
        # part.
        farthest = exponent ** (1.0 / (1.0 - exponent))  # where u^e lies farthest from u
        bend = abs(farthest**exponent - farthest)
        most = LARGEST_TORQUE_SHARE * rated_torque(session, joint) / (fastest**exponent * bend)
        return {"coefficient": Range(0.0, most, "its bend takes more than the motor can give")}

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        coulomb, viscous = friction_level(session, joint)
        speed = max(top_speed(session, joint), LIMIT.least_top_speed)
        return np.array([(coulomb + viscous * speed) / speed ** variant.inner["exponent"]])
