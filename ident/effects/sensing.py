"""Torque and position that are not what the log says: gain, offset, delay, flat tops, a shifted zero."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.effects.typical_sizes import (
    coefficient_interval,
    exactly,
    grid_interval,
    near_one_pose,
    rated_torque,
    root_mean_square,
    sampled_states,
)

LARGEST_GAIN_ERROR = 0.2
# Modelled torque that varies by less than this share of the rated torque is as good as an offset.
LEAST_TORQUE_VARIATION = 0.004
LARGEST_OFFSET_SHARE = 0.1  # of the rated torque
DELAYS = (0.002, 0.008, 0.02)  # [s]
LARGEST_DELAY = 0.05  # [s]
# What a delay of so much must change, as a share of the rated torque of some joint, to be seen.
TYPICAL_DELAY, LEAST_DELAY_SHARE = 0.01, 5e-4
SATURATION_KNEES = (0.6, 0.7, 0.8, 0.9)  # of the largest modelled torque
# Drives bend into their limit: it may lie this share above the largest reading.
KNEE_SHARE = 0.05
FINE_KNEE_FACTORS = tuple(0.8 + 0.025 * k for k in range(20))
LEAST_PEAK_SHARE = 0.1  # of the rated torque
LARGEST_ENCODER_OFFSET = 0.07  # [rad]
# Torque that the largest offset must make, as a share of the rated torque of some joint.
LEAST_ENCODER_SHARE = 5e-4


class TorqueGainError(Effect):
    """A drive gain that is off: the log reads 1 + g times the torque; τ = g τ_model."""

    id = "torque_gain_error"
    inertia_like = True
    summary = "logged torque is too large or small by a factor; look at a known payload"

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

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_GAIN_ERROR])


class TorqueOffset(Effect):
    """A constant, and where the runs share a clock a slow drift: τ = o + d (t − t_mid)."""

    id = "torque_offset"
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
        drifts = bool(variant.shape)
        return {
            "offset_Nm": coefficient_interval(0, coefficients, covariance),
            "drift_Nm_s": coefficient_interval(1, coefficients, covariance, 1 / variant.shape["half_s"])
            if drifts
            else exactly(0.0),
        }

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        scale = np.full(2 if variant.shape else 1, LARGEST_OFFSET_SHARE * rated_torque(session, joint))
        return np.asarray(scale)


class TorqueDelay(Effect):
    """Torque logged late against position: τ = [τ_model(t − d₀) − τ_model(t)] / d₀ · d.

    Every point d₀ of the grid has the limit −dτ/dt · d, so that the coefficient is the delay at each; curvature beyond
    the first order is right at d = d₀ and about right around it.
    """

    id = "torque_delay"
    scope = "arm"
    rows = "all"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "torque lags behind position on all joints alike; look at fast changes of torque"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        for j in range(session.n):
            change = root_mean_square([np.gradient(run.total[:, j], run.interval) for run in session.runs])
            if change * TYPICAL_DELAY > LEAST_DELAY_SHARE * rated_torque(session, j):
                return None
        return "torque changes too slowly in all joints"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return tuple(Variant(shape={"delay_s": delay}) for delay in DELAYS)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        delay = variant.shape["delay_s"]
        return [((shifted(run.total, delay / run.interval) - run.total) / delay)[:, :, None] for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {"delay_s": coefficient_interval(0, coefficients, covariance)}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_DELAY])


def shifted(values: Float[Array, "T n"], delay: float) -> Float[Array, "T n"]:
    """Signals late by some samples, whole or not: the cubic through the four samples around each instant."""
    whole = int(np.floor(delay))
    u = delay - whole  # the instant lies u samples before sample t − whole
    weights = (
        -u * (1 - u) * (2 - u) / 6,  # of one sample later
        (1 + u) * (1 - u) * (2 - u) / 2,
        (1 + u) * u * (2 - u) / 2,
        -(1 + u) * u * (1 - u) / 6,
    )
    at = np.arange(len(values)) - whole
    total = np.zeros_like(values)
    for offset, weight in zip((1, 0, -1, -2), weights, strict=True):
        total += weight * values[np.clip(at + offset, 0, len(values) - 1)]
    return total


class TorqueSaturation(Effect):
    """Torque that flattens above a knee L: τ = −c sign(τ_model) (|τ_model| − L)₊; c is 1 where it is quite flat.

    The limit that is told is the reading at the largest modelled torque P: L + (1 − c) (P − L). Where the reading still
    grows there, the limit may lie as far beyond.
    """

    id = "torque_saturation"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "torque has flat tops; look at the highest loads"

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

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([1.0])


def _peak(session: SessionContext, joint: int) -> float:
    """Largest modelled torque of a joint but for one sample in a thousand [N m]."""
    return float(np.quantile(np.abs(np.concatenate([run.total[:, joint] for run in session.runs])), 0.999))


def _excess(run: RunContext, joint: int, limit: float) -> Float[Array, " T"]:
    """What of the modelled torque lies beyond a limit, with its sign."""
    torque = run.total[:, joint]
    return torque - np.clip(torque, -limit, limit)


class EncoderOffset(Effect):
    """A shifted zero of a joint's encoder: true position = logged position + o; τ = ∂τ/∂q_j · o.

    A joint whose axis is vertical shows nothing of it: no torque depends on its angle.
    """

    id = "encoder_offset"
    inertia_like = True
    rows = "all"
    summary = "a joint's zero is shifted: gravity's torque is that of another angle; look at many poses"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        slope = session.runs[0].arm.derivatives(*sampled_states(session))[0][:, :, joint]
        seen = LARGEST_ENCODER_OFFSET * np.sqrt(np.mean(slope**2, axis=0))
        if all(seen[j] < LEAST_ENCODER_SHARE * rated_torque(session, j) for j in range(session.n)):
            return f"no torque depends on the angle of {session.joint_names[joint]}"
        return near_one_pose(session)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        return [run.derivatives[0][:, :, [joint]] for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {"offset_rad": coefficient_interval(0, coefficients, covariance)}

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_ENCODER_OFFSET])
