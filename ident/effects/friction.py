"""Friction that depends on low speed, load, place and direction: what a Coulomb and viscous model leaves out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant, linear_interval
from ident.effects.knowledge import LAW_ANGLE, Doubt, Range, Typical
from ident.effects.typical_sizes import (
    coefficient_interval,
    coulomb_level,
    friction_level,
    friction_states,
    grid_interval,
    hardly_moves,
    least_rest_speed,
    rated_torque,
    top_speed,
    travel,
    wave_figures,
)
from ident.model.named_laws import asymmetric, by_load, by_position, stribeck

STRIBECK_VELOCITIES = (0.015, 0.025, 0.06, 0.15)  # [rad/s]
STRIBECK_EXPONENTS = (1.0, 2.0)
FINE_STRIBECK_FACTORS, FINE_STRIBECK_EXPONENTS = (
    (0.5, 0.63, 0.8, 1.0, 1.25, 1.6, 2.0),
    (0.75, 1.0, 1.25, 1.5, 1.75, 2.0),
)
POSITION_ORDERS = (1.0, 2.0)
# Static over sliding friction, less one.
LARGEST_BREAKAWAY = 3.0
# Share of the transmitted torque that a gear may lose: strain-wave gears are worse than half cold and unloaded only.
LARGEST_LOSS = 0.5
LARGEST_LOAD_SHARE = 0.2  # of load-dependent friction in the load
# A load that varies by less than this share of the rated torque gives nothing but more Coulomb friction.
LEAST_LOAD_RANGE = 0.004
# Speeds below this leave nothing of a curve over speed [rad/s].
LEAST_TOP_SPEED = 0.05
LEAST_POSITION_RANGE = 0.5  # [rad]


class StribeckFriction(Effect):
    """Friction that falls as motion sets in: τ = A s exp(−(|v| / v_s)^δ).

    Source: Bittencourt and Gunnarsson 2010, with the static level as what is added to Coulomb friction.
    """

    id = "stribeck_friction"
    beyond_bound = True
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "more friction at low speed than Coulomb and viscous friction have; look at slow stretches"
    shown_by = "ladder"
    parted_by: ClassVar[Mapping[str, str]] = {"presliding_hysteresis": "ladder", "thermal_friction": "repeat"}
    defining = ("amplitude_Nm",)
    typical = Typical("amplitude_Nm", 0.3, {"stribeck_velocity_rad_s": 0.06, "exponent": 1.0})
    open_law = True

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = hardly_moves(session, joint)
        if reason is None and not self.variants(session, joint):
            reason = f"velocity of {session.joint_names[joint]} is too noisy to tell slow motion from rest"
        if reason is None and top_speed(session, joint) < LEAST_TOP_SPEED:
            reason = f"{session.joint_names[joint]} never leaves slow motion"
        return reason

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        rest = least_rest_speed(session, joint)
        return tuple(
            Variant({"stribeck_velocity_rad_s": speed, "exponent": exponent})
            for speed in STRIBECK_VELOCITIES
            for exponent in STRIBECK_EXPONENTS
            if speed > rest
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        middle, rest = variant.inner["stribeck_velocity_rad_s"], least_rest_speed(session, joint)
        return tuple(
            Variant({"stribeck_velocity_rad_s": factor * middle, "exponent": exponent})
            for factor in FINE_STRIBECK_FACTORS
            for exponent in FINE_STRIBECK_EXPONENTS
            if factor * middle > rest
        )

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [stribeck(friction_states(run, joint), variant.inner) for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {
            "amplitude_Nm": coefficient_interval(0, coefficients, covariance),
            "stribeck_velocity_rad_s": grid_interval(variant.inner["stribeck_velocity_rad_s"], STRIBECK_VELOCITIES),
            "exponent": grid_interval(variant.inner["exponent"], STRIBECK_EXPONENTS),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """Breaking away takes at most a few times the force of sliding (Armstrong-Hélouvry 1991)."""
        most = LARGEST_BREAKAWAY * coulomb_level(session, joint)
        return {"amplitude_Nm": Range(0.0, most, "static friction is at most some times Coulomb friction")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        amplitude = figures["amplitude_Nm"].words("N m")
        speed = figures["stribeck_velocity_rad_s"].value
        return f"give {where} in the model {amplitude} more below {speed:.2g} rad/s, or cross slow speeds quickly"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([coulomb_level(session, joint)])

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """The point of the grid that the coefficient was found at."""
        return {"amplitude_Nm": coefficients[0], **shape} if coefficients else {}


class LoadDependentFriction(Effect):
    """Friction that grows with the load on the gear, more so when the motor drives than when the load does.

    With a = s |τ_l| and b = s² τ_l, (a + b) / 2 is the load while driving and (a − b) / 2 while backdriving. The two
    columns are driving + half of backdriving and the reverse: with coefficients that aren't negative the two levels
    differ at most by a factor of two, so that no error of the torque gain (driving = −backdriving) can pass for
    friction. The second variant adds s τ_l² and v |τ_l|. μ is the mean of driving and backdriving, at typical load.

    Source: Hamon, Gautier and Garrec 2010; the load is the modelled one, the measured one is part of what it explains.
    """

    id = "load_dependent_friction"
    nonnegative: ClassVar[tuple[int, ...]] = (0, 1)
    summary = "friction grows with the transmitted torque; look at poses of high and low load at one speed"
    shown_by = "poses"
    defining = ("mu",)
    typical = Typical("mu", 0.3)
    open_law = True

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = hardly_moves(session, joint)
        if reason is not None:
            return reason
        load = np.abs(np.concatenate([run.link[:, joint] for run in session.runs]))
        span = float(np.diff(np.quantile(load, [0.05, 0.95]))[0])
        if span < LEAST_LOAD_RANGE * rated_torque(session, joint):
            return f"load of {session.joint_names[joint]} varies by {span:.2f} N m only"
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        load = np.concatenate([run.link[:, joint] for run in session.runs])
        speed = np.concatenate([run.motion.dq[:, joint] for run in session.runs])
        typical = {
            "load_Nm": max(float(np.sqrt(np.mean(load**2))), 1e-6),
            "speed_rad_s": float(np.mean(np.abs(speed))),
        }
        return (Variant(shape={**typical, "terms": 2}), Variant(shape={**typical, "terms": 4}))

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [by_load(friction_states(run, joint), variant.shape) for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        weights = np.array([0.75, 0.75, 1.0, variant.shape["speed_rad_s"]])[: len(coefficients)]
        return {"mu": linear_interval(weights, coefficients, covariance)}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        return {"mu": Range(0.0, LARGEST_LOSS, "no gear of a robot loses more than half of what it transmits")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        share = figures["mu"].words("%", 100.0)
        return f"let the friction of {where} grow by {share} of the load it carries; look at the gear if that has risen"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return LARGEST_LOAD_SHARE * np.array([1.0, 1.0, 1.0, 1.0])[: int(variant.shape["terms"])]

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Level, excess of driving over backdriving, curvature over the load, growth with speed."""
        if not coefficients:
            return {"level": reported["mu"], "driving": 0.0, "curvature_1_Nm": 0.0, "viscous_s_rad": 0.0}
        one, other, square, speed = (*coefficients, 0.0, 0.0)[:4]
        return {
            "level": 0.75 * (one + other),
            "driving": 0.25 * (one - other),
            "curvature_1_Nm": square / shape["load_Nm"],
            "viscous_s_rad": speed,
        }


class PositionDependentFriction(Effect):
    """Friction that varies over a turn: τ = s A cos(k q − φ)."""

    id = "position_dependent_friction"
    summary = "friction varies with the joint's angle; look at both directions over the whole range"
    shown_by = "poses"
    defining = ("amplitude_Nm",)
    typical = Typical("amplitude_Nm", 0.2)
    doubt = Doubt(places={"phase_rad": LAW_ANGLE}, exact=frozenset({"order"}))
    opposite = frozenset({"phase_rad"})  # the simulated arm has cos(kq + phase)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        low, high = travel(session, joint)
        if high - low < LEAST_POSITION_RANGE:
            return f"{session.joint_names[joint]} covers {high - low:.2f} rad; {LEAST_POSITION_RANGE:g} are needed"
        return hardly_moves(session, joint)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return tuple(Variant({"order": order}) for order in POSITION_ORDERS)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """Over a short way one order looks much like another."""
        return self.variants(session, joint)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [by_position(friction_states(run, joint), variant.inner) for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return wave_figures(variant.inner["order"], coefficients, covariance)

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """Passive: where it takes friction away, no less than none may be left; at angles that were not seen, anything.

        Coulomb friction is what there is on the mean of the way: the wave's own mean on that way is in it.
        """
        turned = figures["order"].value * np.concatenate([run.motion.q[:, joint] for run in session.runs])
        wave = np.cos(turned - figures["phase_rad"].value)
        most = coulomb_level(session, joint) / max(float(wave.mean() - wave.min()), 1e-9)
        return {"amplitude_Nm": Range(0.0, most, "friction would drive the joint: more than Coulomb friction varies")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        amplitude = figures["amplitude_Nm"].words("N m")
        return f"let the friction of {where} vary over its angle by ± {amplitude}; look for a rubbing seal or hose"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.full(2, 0.5 * coulomb_level(session, joint))


class AsymmetricFriction(Effect):
    """Friction that differs between the directions: f₊ − f₋ is reported, half of it acts on either side.

    τ = s² (f_c₊ − f_c₋) / 2 + |v| (C₊ − C₋) / 2. In motion s² is one: the first column is a torque offset then, which
    differs from it only at rest and in reversals.
    """

    id = "asymmetric_friction"
    summary = "friction differs between the two directions; look at equal speeds forwards and backwards"
    shown_by = "ladder"
    defining = ("coulomb_difference_Nm", "viscous_difference_Nms_rad")
    typical = Typical("coulomb_difference_Nm", 0.2)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = hardly_moves(session, joint)
        if reason is not None:
            return reason
        dq = np.concatenate([run.motion.dq[:, joint] for run in session.runs])
        rest = max(float(run.motion.rest_speed[joint]) for run in session.runs)
        forward, backward = float(np.mean(dq > rest)), float(np.mean(dq < -rest))
        if min(forward, backward) < 0.05 * max(forward, backward):
            return f"{session.joint_names[joint]} moves in one direction only"
        return None

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [asymmetric(friction_states(run, joint), variant.inner) for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {
            "coulomb_difference_Nm": coefficient_interval(0, coefficients, covariance),
            "viscous_difference_Nms_rad": coefficient_interval(1, coefficients, covariance),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """Passive in both directions, from slow motion up to the joint's top speed."""
        coulomb, viscous = friction_level(session, joint)
        reason = "friction of one direction would drive the joint"
        slow, fast = 0.1 * top_speed(session, joint), top_speed(session, joint)
        difference, slope = (figures[name].value for name in self.defining)
        least = min(coulomb + viscous * v - 0.5 * abs(difference + slope * v) for v in (slow, fast))
        if least >= 0.0:
            return {}
        return {"coulomb_difference_Nm": Range(-2.0 * coulomb, 2.0 * coulomb, reason)} | {
            "viscous_difference_Nms_rad": Range(-2.0 * viscous, 2.0 * viscous, reason)
        }

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        difference = figures["coulomb_difference_Nm"]
        way = "forwards" if difference.value > 0.0 else "backwards"
        size = difference.words("N m", size=True)
        return f"let {where} have two levels of friction, {size} more {way} than the other way; look for a pulling hose"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        coulomb, viscous = friction_level(session, joint)
        return 0.5 * np.array([coulomb, viscous])
