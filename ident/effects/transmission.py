"""What gears and hoses add beside friction: pull of another joint, springs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import product

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, Range, SessionContext, Variant
from ident.effects.intervals import (
    amplitude_interval,
    coefficient_interval,
    delta_interval,
    exactly,
    linear_interval,
    phase_interval,
)
from ident.effects.session_context import (
    LARGEST_TORQUE_SHARE,
    coulomb_level,
    friction_level,
    hardly_moves,
    joint_range,
    rated_torque,
    slides,
    top_speed,
    travel,
    usual_speed,
)
from ident.effects.settings import TRANSMISSION as LIMIT

# Numbers of a spring's laws in results. 1 was a cubic, which older results may still hold: it
# followed any cable that pulls tight near the end of its way, so no search offers it.
STRAIGHT = 0
PERIODIC = 2
# Parameters of a spring with two rests a turn.
WAVE = ("cosine_Nm", "sine_Nm")


class JointCoupling(Effect):
    """Torque that comes with the motion of another joint o: τ = f s_o + c v_o + b a_o.

    Between neighbours, whose gears may sit on one axis, also friction of the sum or difference of
    the two motions: τ = f s(v_j ± v_o) + c (v_o ± v_j). The part ± c v_j fits as well as viscous
    friction of the joint's own, which then would stay where the coupling is taken out.
    """

    id = "joint_coupling"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        if session.n < 2:
            return "there is no other joint"
        reason = (
            f"the other joints stand still, or move only together with {session.joint_names[joint]}"
        )
        return None if self.variants(session, joint) else reason

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        dq = np.concatenate([run.motion.dq for run in session.runs])
        power = np.maximum(np.sqrt(np.sum(dq**2, axis=0)), 1e-12)
        correlation = np.abs(dq.T @ dq[:, joint]) / (power * power[joint])
        apart = correlation < LIMIT.largest_correlation
        distance = np.abs(np.arange(session.n) - joint)
        is_near = (distance > 0) & (distance <= LIMIT.farthest)
        near = np.flatnonzero(is_near & apart).tolist()
        others = [o for o in near if hardly_moves(session, o) is None]
        single = [Variant(other=other, shape={"mix": 0.0}) for other in others]
        if hardly_moves(session, joint) is not None:
            return tuple(single)
        slow = 2.0 * np.max([run.motion.rest_speed for run in session.runs], axis=0)
        width = {}
        for other in others:
            if abs(other - joint) == 1:
                width[other] = float(slow[[joint, other]].max())
        pairs = product(width.items(), (1.0, -1.0))
        shapes = [(other, {"mix": mix, "width_rad_s": size}) for (other, size), mix in pairs]
        return (*single, *(Variant(other=o, shape=shape) for o, shape in shapes))

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        other = _other(variant)
        mix = variant.shape["mix"]
        columns = []
        for run in session.runs:
            speed = run.motion.dq[:, joint]
            others = run.motion.dq[:, other]
            of_joint = run.motion.rest_speed[joint]
            of_other = run.motion.rest_speed[other]
            width = 2.0 * float(max(of_joint, of_other))
            mixed = speed + mix * others
            both = [np.tanh(mixed / width), others + mix * speed]
            columns.append(
                np.stack(
                    both if mix else [run.direction[:, other], others, run.motion.ddq[:, other]],
                    axis=1,
                )
            )
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        lone = variant.shape["mix"] == 0.0
        speed = usual_speed(session, _other(variant))
        # This joint at rest, the other one at an even speed: its own direction, or that of the sum
        # or difference.
        drag = np.array([variant.shape["mix"] or 1.0, speed, 0.0])
        return {
            "viscous_Nms_rad": coefficient_interval(1, coefficients, covariance),
            "coulomb_Nm": coefficient_interval(0, coefficients, covariance),
            "inertia_kgm2": coefficient_interval(2, coefficients, covariance)
            if lone
            else exactly(0.0),
            "other_joint": exactly(float(_other(variant) + 1)),
            "drag_Nm": linear_interval(drag[: len(coefficients)], coefficients, covariance),
            "at_speed_rad_s": exactly(speed),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        other = round(estimates["other_joint"].value) - 1
        most = LARGEST_TORQUE_SHARE * rated_torque(session, joint)
        speed = max(top_speed(session, other), 1e-6)
        pulls = [float(np.abs(run.motion.ddq[:, other]).max()) for run in session.runs]
        pull = max(pulls)
        reason = "the other joint's motion takes more than the motor can give"
        drags = estimates["inertia_kgm2"].value == 0.0  # friction of a sum or difference: passive
        viscous = most / speed
        inertia = most / max(pull, 1e-6)
        return {
            "coulomb_Nm": Range(0.0 if drags else -most, most, reason),
            "viscous_Nms_rad": Range(-viscous, viscous, reason),
            "inertia_kgm2": Range(-inertia, inertia, reason),
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        coulomb, viscous = friction_level(session, joint)
        if variant.shape["mix"] != 0.0:
            return np.array([coulomb, viscous])
        other = _other(variant)
        pulls = [float(np.abs(run.motion.ddq[:, other]).max()) for run in session.runs]
        top = max(pulls)
        return np.array([coulomb, viscous, coulomb / max(top, 1e-6)])

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs: `mix` and `width_rad_s`.

        `mix` is 1 or −1 for friction of a sum or difference, which has no inertia, and has the sign
        of the viscous part; else 0.
        """
        mix = (
            float(np.sign(reported["viscous_Nms_rad"])) if reported["inertia_kgm2"] == 0.0 else 0.0
        )
        return {"mix": mix, "width_rad_s": LIMIT.coupling_width, **shape}


def _other(variant: Variant) -> int:
    assert variant.other is not None
    return variant.other


class SpringTorque(Effect):
    """A spring across the joint (hoses, cables, a balancer).

    Two laws: straight, τ = k (q − q₀), and with two rests a turn, τ = k sin(2 (q − q₀)) / 2.
    Stiffness k is that at rest in both. A joint that slides has no turn. A constant beside the
    wave is no part of a spring: it is an offset of the torque, and another effect's.
    """

    id = "spring_torque"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        centre = sum(travel(session, joint)) / 2
        low, high = _rests(session, joint)
        laws = (STRAIGHT,) if slides(session, joint) else (STRAIGHT, PERIODIC)
        shape = {"centre_rad": centre, "least_rest_rad": low, "most_rest_rad": high}
        return tuple(Variant(shape={**shape, "law": float(law)}) for law in laws)

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        """Whether a spring has a rest where one can be: a pull that is the same everywhere is an
        offset of the torque.
        """
        if variant.shape["law"] == PERIODIC:
            return True
        slope, pull = coefficients
        centre = variant.shape["centre_rad"]
        to_low = centre - variant.shape["least_rest_rad"]
        to_high = variant.shape["most_rest_rad"] - centre
        return bool(-slope * to_high <= pull <= slope * to_low)

    def signed(self, variant: Variant) -> tuple[int, ...]:
        """Indices of coefficients that can't be negative: a straight spring's slope, no wave's."""
        return (0,) if variant.shape["law"] == STRAIGHT else ()

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return [_spring(run.motion.q[:, joint], variant) for run in session.runs]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        ends = travel(session, joint)
        pulls = (
            linear_interval(row, coefficients, covariance)
            for row in _spring(np.array(ends), variant)
        )
        return {
            **self._at_rest(session, joint, variant, coefficients, covariance),
            **dict(zip(("low_Nm", "high_Nm"), pulls, strict=True)),
            **{
                f"at_{end}_rad": exactly(float(q))
                for end, q in zip(("low", "high"), ends, strict=True)
            },
        }

    def _at_rest(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        """Stiffness at rest and the angle of rest."""
        centre = variant.shape["centre_rad"]
        if variant.shape["law"] == STRAIGHT:
            stiffness = coefficient_interval(0, coefficients, covariance)
            slope = max(abs(stiffness.value), 1e-9) * (1.0 if stiffness.value >= 0 else -1.0)
            rest = delta_interval(
                lambda c: centre - c[1] / (c[0] or slope), coefficients, covariance
            )
            return {"stiffness_Nm_rad": stiffness, "rest_rad": rest}
        # k sin(2 (q − q₀)) = k cos 2q₀ · sin 2q − k sin 2q₀ · cos 2q: φ = 2q₀ + π/2.
        wave = coefficients[:2]
        spread = covariance[:2, :2]
        phase = phase_interval(wave, spread)
        value, low, high = (
            (angle - np.pi / 2) / 2 for angle in (phase.value, phase.low, phase.high)
        )
        # Of the two rests a turn, the one nearer to the middle of the range.
        turns = np.pi * np.round((centre - value) / np.pi)
        return {
            "stiffness_Nm_rad": amplitude_interval(wave, spread),
            "rest_rad": Interval(value + turns, low + turns, high + turns),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """A spring pulls towards its rest, which lies where the joint can go or, with preload, half
        a turn beyond.

        A balancer may pull, from one end of the motion to the other, from all that the motor can
        hold to as much the other way.
        """
        seen = travel(session, joint)
        low, high = _rests(session, joint)
        span = max(seen[1] - seen[0], LIMIT.least_spring_range)
        most = 2.0 * rated_torque(session, joint) / span
        return {
            "stiffness_Nm_rad": Range(
                0.0, most, "a spring that pushes away from its rest, or is beyond the motor"
            ),
            "rest_rad": Range(low, high, "the joint never comes near such a rest"),
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        largest = max(
            LIMIT.largest_spring_share * rated_torque(session, joint), coulomb_level(session, joint)
        )
        return np.full(2, largest)

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """A line about an angle (no square, no cube), and a wave with two rests a turn."""
        names = ("linear_Nm_rad", "constant_Nm", "square_Nm_rad2", "cube_Nm_rad3", *WAVE)
        values = np.zeros(len(names))
        if not coefficients:
            values[0] = reported["stiffness_Nm_rad"]
        elif shape["law"] == PERIODIC:
            values[-2:] = 0.5 * np.asarray(coefficients)
        else:
            values[: len(coefficients)] = coefficients
        parameters = dict(zip(names, map(float, values), strict=True))
        return {"centre_rad": shape.get("centre_rad", reported["rest_rad"]), **parameters}


def _rests(session: SessionContext, joint: int) -> tuple[float, float]:
    """Between which positions a spring can rest [rad]: the joint's range and half a turn more."""
    low, high = joint_range(session, joint, travel(session, joint))
    return low - np.pi, high + np.pi


def _spring(q: Float[Array, " T"], variant: Variant) -> Float[Array, "T k"]:
    """Columns of a spring at angles: a line, or a wave with two rests a turn."""
    if variant.shape["law"] == PERIODIC:
        cosine = 0.5 * np.cos(2 * q)
        sine = 0.5 * np.sin(2 * q)
        return np.stack([cosine, sine], axis=1)
    return np.stack([q - variant.shape["centre_rad"], np.ones_like(q)], axis=1)
