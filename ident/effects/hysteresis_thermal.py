"""Friction with a memory: of the last reversals (hysteresis) and of the work done so far
(warmth).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.intervals import delta_interval, drawn_interval, exactly, grid_interval
from ident.effects.session_context import coulomb_level, friction_level
from ident.effects.settings import MEMORY as LIMIT
from ident.model.linearisation import stop_operator

# Displacement of a smooth build-up over the mean range of the stops that imitate it, each weighted
# by its area.
SMOOTH_SHARE = 2.0 / 3.0


class ThermalFriction(Effect):
    """Friction that changes as the gear warms up: τ = −θ c_v v + θ c_s s, θ from 0 (cold) to 1
    (warmest here).

    θ is the measured temperature; where there is none, or the sensor sits where it hardly warms, θ
    follows the modelled friction power P over the session's clock, pauses included: θ' = P − θ /
    τ_θ. Viscous friction falls with warmth; Coulomb friction may do either. Both changes are shares
    of the cold level, between the coldest and the warmest moment of the session.

    Source: Wolf and Iskandar 2018; Simoni 2017.
    """

    id = "thermal_friction"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = super().untestable(session, joint)
        if reason is not None:
            return reason
        measured = _measured(session, joint)
        if _warms(measured):
            return None
        why = (
            "no temperature"
            if measured is None
            else f"temperature of {session.joint_names[joint]} hardly varies"
        )
        if not session.common_clock:
            return f"{why}, and the runs share no clock"
        if _span(session) < LIMIT.least_session:
            return f"{why}, and the session lasts {_span(session):.0f} s only"
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        measured = _measured(session, joint)
        if measured is not None and _warms(measured):
            return (Variant(shape=_scale(measured)),)
        longest = max(
            LIMIT.longest_time_constant * max(_span(session), LIMIT.least_session),
            LIMIT.time_constants[0],
        )
        return _of_constants(
            session, joint, [constant for constant in LIMIT.time_constants if constant <= longest]
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        if "time_constant_s" not in variant.inner:
            return (variant,)
        return _of_constants(
            session,
            joint,
            [factor * variant.inner["time_constant_s"] for factor in LIMIT.fine_time_factors],
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        measured = None if "time_constant_s" in variant.inner else _measured(session, joint)
        if measured is None:
            measured, _ = _warmth(session, joint, variant.inner["time_constant_s"], variant.shape)
        warmth = [
            (values - variant.shape["coldest"]) / variant.shape["range"] for values in measured
        ]
        columns = []
        for run, warm in zip(session.runs, warmth, strict=True):
            viscous = -warm * run.motion.dq[:, joint]
            coulomb = warm * run.direction[:, joint]
            columns.append(np.stack([viscous, coulomb], axis=1))
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        coulomb, viscous = friction_level(session, joint)
        mean = variant.shape["mean"]
        # The tuned level is that of the mean warmth; the cold one follows from it and the change
        # itself.
        signed = coefficients * (-1.0, 1.0)
        cells = covariance * np.outer((-1.0, 1.0), (-1.0, 1.0))
        estimates = {
            name: delta_interval(
                lambda c, k=k, level=level: c[k] / max(level - mean * c[k], 0.05 * level),
                signed,
                cells,
            )
            for k, (name, level) in enumerate(
                (("viscous_change", viscous), ("coulomb_change", coulomb))
            )
        }
        if "time_constant_s" in variant.inner:
            estimates["time_constant_s"] = grid_interval(
                variant.inner["time_constant_s"], LIMIT.time_constants
            )
        return estimates

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        change = estimates["viscous_change"].words("%", 100.0)
        constant = estimates.get("time_constant_s")
        minutes = max(2.0 * constant.value / 60.0, 1.0) if constant else 0.0
        how_long = (
            f"for {minutes:.0f} minute{'s' * (round(minutes) != 1)}"
            if constant
            else "until its temperature is steady"
        )
        warm = f"warm {where} up {how_long} before precise work, or compensate"
        return f"{warm}: its viscous friction changes by {change}"


class PreslidingHysteresis(Effect):
    """Friction that builds up over a displacement after each reversal: τ = Σ k_i stop_i[q] / r_i,
    k_i ≥ 0.

    Stop operators of several ranges side by side bend the build-up, as contacts that slip one after
    the other do. Each run starts unstressed. The shortest ranges can't be distinguished from dry
    friction that turns round at once, and their share of the amplitude is anybody's guess; so
    amplitude A and displacement d are those of the smooth build-up A (1 − 2 e^(−x/d)) with the same
    area Σ k_i r_i = A d and the same second moment Σ k_i r_i² = 3/2 A d².

    Source: Al-Bender 2005 (generalised Maxwell slip, without the dynamics of slip).
    """

    id = "presliding_hysteresis"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        reason = super().untestable(session, joint)
        if reason is not None:
            return reason
        name = session.joint_names[joint]
        least = min(LIMIT.displacements)
        if not _usable(session, joint):
            return f"position of {name} is too noisy to follow some mrad after a reversal"
        count = sum(
            _count_reversals(np.ascontiguousarray(run.motion.q[:, joint]), least)
            for run in session.runs
        )
        return f"{name} reverses fewer than three times" if count < 3 else None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        return (_of_ranges(_usable(session, joint)),)

    def parts(self, variant: Variant) -> Sequence[tuple[Variant, Sequence[int]]]:
        """Neighbouring ranges: a build-up needs a few of them, and each that it may have costs
        evidence.

        The shortest one alone is none: it can't be distinguished from dry friction that turns round
        at once.
        """
        sizes = list(variant.shape.values())
        stretches = [
            range(k, k + width)
            for width in LIMIT.stops_side_by_side
            for k in range(len(sizes) - width + 1)
        ]
        stated = [some for some in stretches if some[-1] > 0 and len(some) < len(sizes)]
        points = []
        for some in stated:
            ranges = [sizes[k] for k in some]
            points.append((_of_ranges(ranges), some))
        return points

    def stands_for(self, variant: Variant, coefficients: Float[Array, " k"]) -> bool:
        """Whether its displacement is longer than the shortest range, over which contacts of all
        gears bend.
        """
        return _displacement(np.array(list(variant.shape.values())), coefficients) > min(
            LIMIT.displacements
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """All ranges: the parameters of one law hang on all of its build-up."""
        return self.variants(session, joint)

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        paths = (np.ascontiguousarray(run.motion.q[:, joint]) for run in session.runs)
        sizes = variant.shape.values()
        columns = []
        for q in paths:
            shares = [stop_operator(q, size) / size for size in sizes]
            columns.append(np.stack(shares, axis=1))
        return columns

    def parameters(
        self,
        session: SessionContext,
        joint: int,
        variant: Variant,
        coefficients: Array,
        covariance: Array,
    ) -> dict[str, Interval]:
        sizes = np.array(list(variant.shape.values()))

        def displacement(k: Array) -> float:
            return _displacement(sizes, k) or float(sizes[0])

        def amplitude(k: Array) -> float:
            return float(np.maximum(k, 0.0) @ sizes) / displacement(k)

        def reversal(k: Array) -> float:
            bent, _ = self.without_dry_friction(k, variant)
            return float(bent @ np.clip(where.value / sizes, 0.0, 2.0))

        where = drawn_interval(displacement, coefficients, covariance)
        reach = grid_interval(where.value, LIMIT.displacements)
        strength = drawn_interval(amplitude, coefficients, covariance)
        if delta_interval(lambda k: float(k @ sizes), coefficients, covariance).low <= 0.0:
            # draws that are not negative can't tell that there may be none
            strength = replace(strength, low=0.0)
        nearest = max(min(where.low, reach.low), sizes[0] / 4)
        return {
            "amplitude_Nm": strength,
            "displacement_rad": Interval(where.value, nearest, max(where.high, reach.high)),
            "reversal_Nm": drawn_interval(reversal, coefficients, covariance),
            "at_travel_rad": exactly(where.value),
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.full(len(variant.shape), coulomb_level(session, joint))

    def without_dry_friction(
        self, coefficients: Float[Array, " k"], variant: Variant
    ) -> tuple[Float[Array, " k"], float]:
        """Its coefficients less what is dry friction that turns round at once, and that friction [N
        m].

        All ranges together are the amplitude of the smooth build-up; what they have more, the
        shortest ones lose.
        """
        sizes = np.array(list(variant.shape.values()))
        parts = np.maximum(coefficients, 0.0)
        bent = float(parts @ sizes**2)
        amplitude = float(parts @ sizes) ** 2 / (SMOOTH_SHARE * bent) if bent > 0.0 else 0.0
        before = np.cumsum(parts) - parts
        taken = np.clip(parts.sum() - amplitude - before, 0.0, parts)
        return parts - taken, float(taken.sum())

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Every range (`range_0_rad`, …) and its torque (`part_0_Nm`, …).

        Without coefficients the two ranges next to the displacement.
        """
        parts = tuple(coefficients)
        ranges = list(shape.values())
        if not parts:
            where = reported["displacement_rad"]
            amplitude = reported["amplitude_Nm"]
            within = [size for size in LIMIT.displacements[:-1] if size <= where]
            index = max(len(within) - 1, 0)
            ranges = [LIMIT.displacements[index], LIMIT.displacements[index + 1]]
            beyond = (where - ranges[0]) / (ranges[1] - ranges[0])
            share = min(1.0, max(0.0, beyond))
            parts = amplitude * (1.0 - share), amplitude * share
        parameters = {f"range_{i}_rad": size for i, size in enumerate(ranges)}
        return parameters | {f"part_{i}_Nm": torque for i, torque in enumerate(parts)}


def _displacement(sizes: Float[Array, " k"], parts: Float[Array, " k"]) -> float:
    """Displacement over which friction builds up that some elastic stops share [rad].

    Each stop yields beyond its own range; together they follow one smooth build-up, whose
    displacement is that share of the ranges' mean, weighed by the area under each. 0 where no stop
    bears anything.

    Args:
        sizes: Range of each stop [rad].
        parts: Torque that each bears [N m]; below 0 it counts as none.
    """
    area = float(np.maximum(parts, 0.0) @ sizes)
    if not area > 0.0:
        return 0.0
    return SMOOTH_SHARE * float(np.maximum(parts, 0.0) @ sizes**2) / area


def _of_ranges(sizes: Sequence[float]) -> Variant:
    return Variant(shape={f"range_{k}_rad": size for k, size in enumerate(sizes)})


def _usable(session: SessionContext, joint: int) -> list[float]:
    """Ranges that stand clear of the noise of the position."""
    noise = max(float(run.motion.std[0, joint]) for run in session.runs)
    return [size for size in LIMIT.displacements if noise < LIMIT.largest_noise_share * size]


@compiled(error_model="numpy", nogil=True)
def _count_reversals(q: Array, least: float) -> int:
    """The number of reversals after which the path goes back by some distance at least."""
    count = 0
    heading = 0
    extreme = q[0]
    for value in q:
        if heading == 0:
            if abs(value - extreme) > least:
                heading = 1 if value > extreme else -1
                extreme = value
        elif (value - extreme) * heading > 0:
            extreme = value
        elif abs(value - extreme) > least:
            count += 1
            heading = -heading
            extreme = value
    return count


def warm_up(
    power: Float[Array, " T"], interval: float, constant: float, start: float
) -> Float[Array, " T"]:
    """Warmth θ over a run [J]: θ' = P − θ / τ from a start, the power even between samples.

    Args:
        power: What friction turns into heat [W].
        interval: Between samples [s].
        constant: τ, how long it keeps its heat [s].
        start: θ at the first sample [J].
    """
    keep = float(np.exp(-interval / constant))
    return np.asarray(_warm_up(np.ascontiguousarray(power), keep, constant * (1.0 - keep), start))


@compiled(error_model="numpy", nogil=True)
def _warm_up(power: Array, keep: float, gain: float, start: float) -> Array:
    """Warmth, sample by sample: what is kept of the last one's, and what its power adds."""
    out = np.empty(len(power))
    out[0] = start
    for k in range(1, len(power)):
        heat_left = keep * out[k - 1]
        out[k] = gain * power[k - 1] + heat_left
    return out


def _of_constants(
    session: SessionContext, joint: int, constants: Sequence[float]
) -> tuple[Variant, ...]:
    """Points of the grid by their time constants."""
    warmths = [(constant, *_warmth(session, joint, constant)) for constant in constants]
    return tuple(
        Variant({"time_constant_s": constant}, shape=_scale(warmth) | starts)
        for constant, warmth, starts in warmths
    )


def _span(session: SessionContext) -> float:
    """Time from the first sample of the session to the last [s]."""
    first = session.runs[0].motion.time[0]
    last = session.runs[-1].motion.time[-1]
    return float(last - first)


def _measured(session: SessionContext, joint: int) -> list[Float[Array, " T"]] | None:
    """Measured temperature of every run, averaged a little; None if a run has none."""
    from scipy.ndimage import uniform_filter1d  # slow to load, and few logs have temperatures

    averaged = []
    for run in session.runs:
        if run.temperature is None:
            return None
        if not np.all(np.isfinite(run.temperature[:, joint])):
            return None
        width = max(1, round(LIMIT.temperature_average / run.interval))
        averaged.append(
            uniform_filter1d(
                run.temperature[:, joint], min(width, len(run.temperature)), mode="nearest"
            )
        )
    return averaged


def _warms(measured: Sequence[Float[Array, " T"]] | None) -> bool:
    """Whether a measured temperature varies enough to tell warm from cold."""
    if measured is None:
        return False
    coldest = min(values.min() for values in measured)
    warmest = max(values.max() for values in measured)
    return bool(warmest - coldest >= LIMIT.least_temperature_range)


def _scale(values: Sequence[Float[Array, " T"]]) -> dict[str, float]:
    """Parameters that map warmth to 0 … 1 over the whole session, and its mean there."""
    coldest = min(float(v.min()) for v in values)
    warmest = max(float(v.max()) for v in values)
    span = max(warmest - coldest, 1e-12)
    count = sum(len(v) for v in values)
    mean = sum(float(v.sum()) for v in values) / count
    return {"coldest": coldest, "range": span, "mean": (mean - coldest) / span}


def _warmth(
    session: SessionContext, joint: int, constant: float, known: Mapping[str, float] | None = None
) -> tuple[list[Float[Array, " T"]], dict[str, float]]:
    """Warmth θ of every run, and that at the start of each run under the name of its start time.

    `known` holds the latter where the session is only a part of the whole.
    """
    warmths = []
    starts = {}
    level = 0.0
    last = float(session.runs[0].motion.time[0])
    for run in session.runs:  # warmed by the modelled power of friction [W]
        start = float(run.motion.time[0])
        name = f"start_{start!r}"
        cooled = level * np.exp(-max(start - last, 0.0) / constant)
        level = (known or {}).get(name, cooled)
        starts[name] = level
        dq = run.motion.dq[:, joint]
        friction = run.friction[:, joint]
        if not friction.any():  # none is modelled: that of a typical joint
            coulomb, viscous = friction_level(session, joint)
            friction = coulomb * run.direction[:, joint] + viscous * dq
        warmths.append(warm_up(np.maximum(friction * dq, 0.0), run.interval, constant, level))
        level = float(warmths[-1][-1])
        last = float(run.motion.time[-1])
    return warmths, starts
