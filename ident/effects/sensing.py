"""Torque and position that are not what the log says: gain, offset, flat tops, a shifted zero.

Torque that is logged late against position.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, Range, SessionContext, Variant
from ident.effects.intervals import coefficient_interval, exactly, grid_interval
from ident.effects.session_context import (
    is_near,
    joined,
    rated_torque,
    root_mean_square,
    sampled_states,
)
from ident.effects.settings import SENSING as LIMIT
from ident.laws.acting import shifted

LARGEST_OFFSET_SHARE = 0.1  # of the rated torque
FINE_KNEE_FACTORS = tuple(0.8 + 0.025 * k for k in range(20))


class TorqueGainError(Effect):
    """A drive gain that is off: the log reads 1 + g times the torque; τ = g τ_model."""

    id = "torque_gain_error"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        # Of friction alone nobody can tell a gain: it is fitted.
        variation = float(np.std(joined(session, "rigid", joint)))
        reason = f"rigid torque of {session.joint_names[joint]} varies by {variation:.2f} N m only"
        return (
            reason
            if variation < LIMIT.least_torque_variation * rated_torque(session, joint)
            else None
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        return [run.total[:, [joint]] for run in session.runs]

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        """The gain g of the true torque, whatever of it the tuned inertias have taken on.

        Its column is τ_model as tuned before, which a log with a wrong gain has tuned, too. With k
        the log as a multiple of τ_model (least squares), the coefficient c leaves (k - c) τ_model
        as true torque: g = c / (k - c).
        """
        model, log = (joined(session, signal, joint) for signal in ("total", "tau"))
        size = float(log @ model) / max(float(model @ model), 1e-300)
        share = coefficient_interval(0, coefficients, covariance)
        value, low, high = (
            end / max(size - end, 1e-3) for end in (share.value, share.low, share.high)
        )
        return {"gain": Interval(value, low, high)}


class TorqueOffset(Effect):
    """A constant, and where the runs share a clock a slow drift: τ = o + d (t − t_mid).

    The interval of o holds what the offset is all through the session, whenever a drift is counted
    from. Without a common clock nothing is known of d, and it is not reported.
    """

    id = "torque_offset"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        first = float(session.runs[0].motion.time[0])
        last = float(session.runs[-1].motion.time[-1])
        if not session.common_clock or last <= first:
            return (Variant(),)
        return (Variant(shape={"middle_s": (first + last) / 2, "half_s": (last - first) / 2}),)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        times = [run.motion.time for run in session.runs]
        if not variant.shape:
            return [np.ones((len(time), 1)) for time in times]
        middle = variant.shape["middle_s"]
        half = variant.shape["half_s"]
        columns = []
        for time in times:
            drift = (time - middle) / half
            columns.append(np.stack([np.ones(len(time)), drift], axis=1))
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        offset = coefficient_interval(0, coefficients, covariance)
        if not variant.shape:
            return {"offset_Nm": offset}
        reach = float(np.hypot(offset.high - offset.value, coefficients[1]))
        return {
            "offset_Nm": Interval(offset.value, offset.value - reach, offset.value + reach),
            "drift_Nm_s": coefficient_interval(
                1, coefficients, covariance, 1 / variant.shape["half_s"]
            ),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        most = LIMIT.largest_offset * rated_torque(session, joint)
        first = session.runs[0].motion.time[0]
        lasts = float(session.runs[-1].motion.time[-1] - first)
        limits = {"offset_Nm": most, "drift_Nm_s": most / max(lasts, 1.0)}
        reason = "a sensor so far off is broken"
        return {
            name: Range(-limit, limit, reason)
            for name, limit in limits.items()
            if name in estimates
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.full(
            2 if variant.shape else 1, LARGEST_OFFSET_SHARE * rated_torque(session, joint)
        )


class TorqueSaturation(Effect):
    """Torque that flattens above a knee L: τ = −c sign(τ_model) (|τ_model| − L)₊; c is 1 where it
    is quite flat.

    The limit that is reported is the reading at the largest modelled torque P: L + (1 − c) (P − L).
    Where the reading still grows there, the limit may lie as far beyond.
    """

    id = "torque_saturation"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        share = _peak(session, joint) / rated_torque(session, joint)
        reason = (
            f"torque of {session.joint_names[joint]} stays below {100 * share:.0f} % of its rated "
            "torque"
        )
        return reason if share < LIMIT.least_peak_share else None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        peak = _peak(session, joint)
        return tuple(Variant(shape={"knee_Nm": knee * peak}) for knee in LIMIT.saturation_knees)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        return tuple(
            Variant(shape={"knee_Nm": factor * variant.shape["knee_Nm"]})
            for factor in FINE_KNEE_FACTORS
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        knee = variant.shape["knee_Nm"]
        return [
            np.clip(run.total[:, [joint]], -knee, knee) - run.total[:, [joint]]
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
        peak = _peak(session, joint)
        knee = variant.shape["knee_Nm"]
        clipped = float(np.clip(coefficients[0], 0.0, 1.0))
        growing = (1.0 - clipped) * max(peak - knee, 0.0)
        lowest = grid_interval(knee, [share * peak for share in LIMIT.saturation_knees]).low
        limit = knee + growing
        return {
            "limit_Nm": Interval(
                limit, min(lowest + growing, limit), (1.0 + LIMIT.knee_share) * limit + growing
            ),
            "at_knee_Nm": exactly(knee),
            "at_peak_Nm": exactly(max(peak, knee)),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        peak = _peak(session, joint)
        return {"limit_Nm": Range(0.0, (1.0 + LIMIT.knee_share) * peak, "no reading came near it")}

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs.

        `knee_Nm`, where the reading begins to flatten, and `lost`, the share that it loses of what
        lies above that.
        """
        if not coefficients:
            return {"knee_Nm": reported["limit_Nm"], "lost": 1.0}
        return {"knee_Nm": shape["knee_Nm"], "lost": coefficients[0]}


def _peak(session: SessionContext, joint: int) -> float:
    """Largest modelled torque of a joint but for one sample in a thousand [N m]."""
    return float(np.quantile(np.abs(joined(session, "total", joint)), 0.999))


class EncoderOffset(Effect):
    """A shifted zero of a joint's encoder: true position = logged position + o; τ = τ(q + o e_j) −
    τ(q).

    The columns are the slope of that at zero, and its secants to offsets so large that the slope is
    no longer enough: what it leaves there, 3 % of gravity's torque at a quarter of a radian, would
    look like a spring. A joint whose axis is vertical shows nothing of it: no torque depends on its
    angle.
    """

    id = "encoder_offset"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        states = sampled_states(session)
        stiffness, *_ = session.runs[0].arm.derivatives(*states)
        slope = stiffness[:, :, joint]
        seen = LIMIT.largest_encoder_offset * np.sqrt(np.mean(slope**2, axis=0))
        if all(
            seen[j] < LIMIT.least_encoder_share * rated_torque(session, j) for j in range(session.n)
        ):
            return f"no torque depends on the angle of {session.joint_names[joint]}"
        return super().untestable(session, joint)

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (Variant(shape={"about_rad": 0.0}),)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        return tuple(
            Variant(shape={"about_rad": share * LIMIT.large_offset}) for share in LIMIT.fine_offsets
        )

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        about = variant.shape["about_rad"]
        return about == 0.0 or is_near(about, float(coefficients[0]), 0.0)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        about = variant.shape["about_rad"]
        if not about:
            return [run.derivatives[0][:, :, [joint]] for run in session.runs]
        columns = []
        offset = about * np.eye(session.n)[joint]
        for run in session.runs:
            moved = run.arm.inverse_dynamics(run.motion.q + offset, run.motion.dq, run.motion.ddq)
            columns.append(((moved - run.rigid) / about)[:, :, None])
        return columns


class TorqueDelay(Effect):
    """Torque logged late against position: τ = [τ_model(t − d₀) − τ_model(t)] / d₀ · d.

    Every point d₀ of the grid has the limit −dτ/dt · d, so that the coefficient is the delay at
    each; curvature beyond the first order is right at d = d₀ and about right around it.
    """

    id = "torque_delay"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        for j in range(session.n):
            change = root_mean_square(
                [np.gradient(run.total[:, j], run.interval) for run in session.runs]
            )
            if change * LIMIT.typical_delay > LIMIT.least_delay_share * rated_torque(session, j):
                return None
        return "torque changes too slowly in all joints"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return tuple(Variant(shape={"delay_s": delay}) for delay in LIMIT.delays)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        delay = variant.shape["delay_s"]
        return [
            ((shifted(run.total, delay, run.interval) - run.total) / delay)[:, :, None]
            for run in session.runs
        ]

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        return is_near(variant.shape["delay_s"], float(coefficients[0]), LIMIT.delays[0])

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        return {"delay_s": coefficient_interval(0, coefficients, covariance)}
