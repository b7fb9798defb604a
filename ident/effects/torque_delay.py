"""Torque that is logged late against position."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.intervals import coefficient_interval
from ident.effects.typical_sizes import is_near, rated_torque, root_mean_square
from ident.laws.sensing import shifted
from ident.motion.encoder import mean_spectrum

DELAYS = (0.002, 0.008, 0.02)  # [s]
# What a delay of so much must change, as a share of the rated torque of some joint, to be seen.
TYPICAL_DELAY, LEAST_DELAY_SHARE = 0.01, 5e-4
# Samples of a stretch of which a spectrum is taken; from which share of the corner on torque that is smooth is gone.
SPECTRUM_SAMPLES, NEAR_CORNER = 512, 0.6


class TorqueDelay(Effect):
    """Torque logged late against position: τ = [τ_model(t − d₀) − τ_model(t)] / d₀ · d.

    Every point d₀ of the grid has the limit −dτ/dt · d, so that the coefficient is the delay at each; curvature beyond
    the first order is right at d = d₀ and about right around it.

    Torque that steps where it is sampled (controllers log in step with what they command) is read half an interval of
    the log early or late, and no later look can tell. The interval of d holds that, by the share of the torque's change
    that may be steps.
    """

    id = "torque_delay"

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
        return [((shifted(run.total, delay, run.interval) - run.total) / delay)[:, :, None] for run in session.runs]

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        return is_near(variant.shape["delay_s"], float(coefficients[0]), DELAYS[0])

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        found = coefficient_interval(0, coefficients, covariance)
        doubt = 0.5 * max(run.motion.log_interval for run in session.runs) * share_of_steps(session)
        reach = float(np.hypot(found.high - found.value, doubt))
        return {"delay_s": Interval(found.value, found.value - reach, found.value + reach)}


def share_of_steps(session: SessionContext) -> float:
    """Largest share of the modelled torque's change, below the common corner, that can be steps.

    The rate of torque that steps has a flat spectrum: it is as dense at all frequencies as it is near the corner, where
    what is smooth has gone.
    """
    steps = change = 0.0
    rated = np.array([rated_torque(session, j) for j in range(session.n)])
    for run in session.survey.runs:
        corner, rate = run.motion.lowpass.cutoff, np.diff(run.total, axis=0) / run.interval / rated
        frequency, density = mean_spectrum(rate, run.motion.lowpass.rate, min(SPECTRUM_SAMPLES, len(rate)))
        below = density[frequency <= corner].sum(axis=1)
        high = below[frequency[frequency <= corner] >= NEAR_CORNER * corner]
        steps += len(rate) * len(below) * float(high.mean() if len(high) else below.mean())
        change += len(rate) * float(below.sum())
    return min(steps / max(change, 1e-300), 1.0)
