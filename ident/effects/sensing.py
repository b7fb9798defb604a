"""Torque and position that are not what the log says: gain, offset, flat tops, a shifted zero."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.effects.informative_motions import BRAKES_CLOSED, GAIN_OR_PAYLOAD, KNOWN_MASS
from ident.effects.knowledge import Expression, Range, Typical, exactly_as, nearly_as, not_at_all
from ident.effects.typical_sizes import (
    coefficient_interval,
    exactly,
    grid_interval,
    is_near,
    near_one_pose,
    rated_torque,
    sampled_states,
)

OUTSIDE_URDF = "describes the arm, not its log; correct the log with the module's torque_of_log"
# A reading that loses all but this share of what lies above its knee is flat there.
FLAT = 0.05
LARGEST_GAIN_ERROR = 0.2
# Readings of half to twice the torque; what is farther off is no torque.
GAIN_RANGE = (-0.5, 1.0)
# Of the rated torque.
LARGEST_OFFSET = 0.3
# Modelled torque that varies by less than this share of the rated torque is as good as an offset.
LEAST_TORQUE_VARIATION = 0.004
LARGEST_OFFSET_SHARE = 0.1  # of the rated torque
SATURATION_KNEES = (0.6, 0.7, 0.8, 0.9)  # of the largest modelled torque
# Drives bend into their limit: it may lie this share above the largest reading.
KNEE_SHARE = 0.05
FINE_KNEE_FACTORS = tuple(0.8 + 0.025 * k for k in range(20))
LEAST_PEAK_SHARE = 0.1  # of the rated torque
# What zeros are off by on arms that were calibrated once; to where they are looked for [rad].
LARGEST_ENCODER_OFFSET, LARGEST_SHIFT = 0.07, 0.6
# An offset whose secant is tried beside the slope at zero [rad], and shares of it on the finer grid.
LARGE_OFFSET = 0.25
FINE_OFFSETS = (-2.4, -2.0, -1.6, -1.2, -0.8, -0.4, -0.2, 0.0, 0.2, 0.4, 0.8, 1.2, 1.6, 2.0, 2.4)
# Torque that the largest offset must make, as a share of the rated torque of some joint.
LEAST_ENCODER_SHARE = 5e-4


class TorqueGainError(Effect):
    """A drive gain that is off: the log reads 1 + g times the torque; τ = g τ_model."""

    id = "torque_gain_error"
    inertia_like = True
    summary = "logged torque is too large or small by a factor; look at a known payload"
    set_ups: ClassVar[Mapping[str, str]] = {
        "link_inertial_error": KNOWN_MASS,
        "all_masses": KNOWN_MASS,
        "payload": GAIN_OR_PAYLOAD,
    }
    defining = ("gain",)
    typical = Typical("gain", 0.25)
    of_the_log = True
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all(OUTSIDE_URDF),
        "mjcf": exactly_as("gear of the motor: ctrl and its force sensor are in the log's units"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        # Of friction alone nobody can tell a gain: it is fitted.
        variation = float(np.std(np.concatenate([run.rigid[:, joint] for run in session.runs])))
        if variation < LEAST_TORQUE_VARIATION * rated_torque(session, joint):
            return f"rigid torque of {session.joint_names[joint]} varies by {variation:.2f} N m only"
        return None

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.total[:, [joint]] for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {"gain": coefficient_interval(0, coefficients, covariance)}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        low, high = GAIN_RANGE
        return {"gain": Range(low, high, "a reading so far off is no torque: see effort_not_torque")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        gain = figures["gain"]
        way = "much" if gain.value > 0.0 else "little"
        return f"correct the drive gain of {where}: it reads {gain.words('%', 100.0, size=True)} too {way}"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_GAIN_ERROR])


class TorqueOffset(Effect):
    """A constant, and where the runs share a clock a slow drift: τ = o + d (t − t_mid).

    The interval of o holds what the offset is all through the session, whenever a drift is counted from.
    """

    id = "torque_offset"
    shown_by = "holds"
    parted_by: ClassVar[Mapping[str, str]] = {"asymmetric_friction": "ladder", "thermal_friction": "repeat"}
    set_ups: ClassVar[Mapping[str, str]] = {"asymmetric_friction": BRAKES_CLOSED}
    twins = ("asymmetric_friction",)
    defining = ("offset_Nm", "drift_Nm_s")
    typical = Typical("offset_Nm", 0.05, absent=(1,))  # an offset that stays drifts no more
    of_the_log = True
    left_open = "the instant to which a drift refers is not reported: only the constant is used"
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all(OUTSIDE_URDF),
        "mjcf": exactly_as("constant bias of the motor: ctrl is in the log's units; a drift is left out"),
    }
    inertia_like = True
    summary = "torque is shifted by a constant, at rest too, or drifts; look at static holds"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        first, last = float(session.runs[0].motion.time[0]), float(session.runs[-1].motion.time[-1])
        if not session.common_clock or last <= first:
            return (Variant(),)
        return (Variant(shape={"middle_s": (first + last) / 2, "half_s": (last - first) / 2}),)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        found = []
        for run in session.runs:
            columns = [np.ones(len(run.motion.time))]
            if variant.shape:
                columns.append((run.motion.time - variant.shape["middle_s"]) / variant.shape["half_s"])
            found.append(np.stack(columns, axis=1))
        return found

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        offset = coefficient_interval(0, coefficients, covariance)
        if not variant.shape:
            return {"offset_Nm": offset, "drift_Nm_s": exactly(0.0)}
        reach = float(np.hypot(offset.high - offset.value, coefficients[1]))
        return {
            "offset_Nm": Interval(offset.value, offset.value - reach, offset.value + reach),
            "drift_Nm_s": coefficient_interval(1, coefficients, covariance, 1 / variant.shape["half_s"]),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        most = LARGEST_OFFSET * rated_torque(session, joint)
        lasts = float(session.runs[-1].motion.time[-1] - session.runs[0].motion.time[0])
        reason = "a sensor so far off is broken"
        return {
            "offset_Nm": Range(-most, most, reason),
            "drift_Nm_s": Range(-most / max(lasts, 1.0), most / max(lasts, 1.0), reason),
        }

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        offset = figures["offset_Nm"].words("N m")
        return f"zero the torque reading of {where}: at rest it is off by {offset}"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        scale = np.full(2 if variant.shape else 1, LARGEST_OFFSET_SHARE * rated_torque(session, joint))
        return np.asarray(scale)


class TorqueSaturation(Effect):
    """Torque that flattens above a knee L: τ = −c sign(τ_model) (|τ_model| − L)₊; c is 1 where it is quite flat.

    The limit that is told is the reading at the largest modelled torque P: L + (1 − c) (P − L). Where the reading still
    grows there, the limit may lie as far beyond.
    """

    id = "torque_saturation"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "torque has flat tops; look at the highest loads"
    shown_by = "loaded"
    typical = Typical("limit_Nm", 1.0)
    of_the_log = True
    open_law = True
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all(f"{OUTSIDE_URDF}; no effort limit: the motion shows that the joint got more"),
        "mjcf": exactly_as("cutoff of the motor's force sensor: the log is flat, the joint gets more"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        peak, rated = _peak(session, joint), rated_torque(session, joint)
        if peak < LEAST_PEAK_SHARE * rated:
            return f"torque of {session.joint_names[joint]} stays below {100 * peak / rated:.0f} % of its rated torque"
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        peak = _peak(session, joint)
        return tuple(Variant(shape={"knee_Nm": knee * peak}) for knee in SATURATION_KNEES)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        return tuple(Variant(shape={"knee_Nm": factor * variant.shape["knee_Nm"]}) for factor in FINE_KNEE_FACTORS)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [-_excess(run, joint, variant.shape["knee_Nm"])[:, None] for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        peak, knee = _peak(session, joint), variant.shape["knee_Nm"]
        growing = (1.0 - float(np.clip(coefficients[0], 0.0, 1.0))) * max(peak - knee, 0.0)
        lowest = grid_interval(knee, [share * peak for share in SATURATION_KNEES]).low
        limit = knee + growing
        return {"limit_Nm": Interval(limit, min(lowest + growing, limit), (1.0 + KNEE_SHARE) * limit + growing)}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        peak = _peak(session, joint)
        return {"limit_Nm": Range(0.0, (1.0 + KNEE_SHARE) * peak, "no reading came near it")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        limit = figures["limit_Nm"].words("N m")
        return f"keep {where} below {limit}, where its readings flatten, or raise the range that its drive logs"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([1.0])

    def law_figures(
        self, reported: Mapping[str, float], coefficients: Sequence[float], shape: Mapping[str, float]
    ) -> dict[str, float]:
        """Where the reading begins to flatten, and the share of what lies above that it loses."""
        if not coefficients:
            return {"knee_Nm": reported["limit_Nm"], "lost": 1.0}
        return {"knee_Nm": shape["knee_Nm"], "lost": coefficients[0]}

    def expressed(self, form: str, figures: Mapping[str, float]) -> Expression | None:
        if form == "mjcf" and abs(figures["lost"] - 1.0) > FLAT:
            return nearly_as("cutoff of the motor's force sensor: flat from the limit on, without the bend before it")
        return super().expressed(form, figures)


def _peak(session: SessionContext, joint: int) -> float:
    """Largest modelled torque of a joint but for one sample in a thousand [N m]."""
    return float(np.quantile(np.abs(np.concatenate([run.total[:, joint] for run in session.runs])), 0.999))


def _excess(run: RunContext, joint: int, limit: float) -> Float[Array, " T"]:
    """What of the modelled torque lies beyond a limit, with its sign."""
    torque = run.total[:, joint]
    return torque - np.clip(torque, -limit, limit)


class EncoderOffset(Effect):
    """A shifted zero of a joint's encoder: true position = logged position + o; τ = τ(q + o e_j) − τ(q).

    The columns are the slope of that at zero, and its secants to offsets so large that the slope is no longer enough:
    what it leaves there, 3 % of gravity's torque at a quarter of a radian, would look like a spring. A joint whose axis
    is vertical shows nothing of it: no torque depends on its angle.
    """

    id = "encoder_offset"
    inertia_like = True
    rows = "all"
    summary = "a joint's zero is shifted: gravity's torque is that of another angle; look at many poses"
    defining = ("offset_rad",)
    typical = Typical("offset_rad", 0.12)
    opposite = frozenset({"offset_rad"})  # the simulated arm tells what its encoder reads too much
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": exactly_as("<origin> of the joint, turned about its axis; its limits are moved along"),
        "mjcf": exactly_as("ref of the joint"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        slope = session.runs[0].arm.derivatives(*sampled_states(session))[0][:, :, joint]
        seen = LARGEST_ENCODER_OFFSET * np.sqrt(np.mean(slope**2, axis=0))
        if all(seen[j] < LEAST_ENCODER_SHARE * rated_torque(session, j) for j in range(session.n)):
            return f"no torque depends on the angle of {session.joint_names[joint]}"
        return near_one_pose(session)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return tuple(Variant(shape={"about_rad": about}) for about in (0.0, LARGE_OFFSET, -LARGE_OFFSET))

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        return tuple(Variant(shape={"about_rad": share * LARGE_OFFSET}) for share in FINE_OFFSETS)

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        about = variant.shape["about_rad"]
        return about == 0.0 or is_near(about, float(coefficients[0]), 0.0)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        about = variant.shape["about_rad"]
        if not about:
            return [run.derivatives[0][:, :, [joint]] for run in session.runs]
        found = []
        for run in session.runs:
            motion = run.motion
            shifted = run.arm.inverse_dynamics(motion.q + about * np.eye(session.n)[joint], motion.dq, motion.ddq)
            found.append(((shifted - run.rigid) / about)[:, :, None])
        return found

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {"offset_rad": coefficient_interval(0, coefficients, covariance)}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        shift = Range(-LARGEST_SHIFT, LARGEST_SHIFT, "the joint's zero is another one: mend it in the URDF")
        return {"offset_rad": shift}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        offset = figures["offset_rad"].words("mrad", 1e3)
        return f"set the zero of {where} anew: add {offset} to its reading"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_ENCODER_OFFSET])
