"""Ripple of the teeth, and order tracking: at which cycles a turn of a joint its torque ripples,
whatever its gear.

A ripple is a line in the angle, not in time: the residual's Fourier sum over the joint's angle,

    S(k) = Σ r exp(−i k q),    P(k) = 2 |S|² / (N σ²),

over the N samples at which k |q'| / 2π lies below the common filter's corner. P is about twice a
unit exponential where there is only noise. Residuals of slow laws rise towards low k: P is held
against its own median around k, with the line itself taken out of the residual.

Source: Fyfe and Munck 1997 (order tracking by the shaft's angle); Lomb 1976 for the normalisation;
Högbom 1974 (one line after the other is taken out).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter

from ident.arrays import Array, Bool, Float
from ident.effects.base import Effect, Interval, SessionContext, Variant
from ident.effects.intervals import exactly, wave_parameters
from ident.effects.session_context import travel, typical_load, wave
from ident.effects.settings import RIPPLE as LIMIT
from ident.units import TORQUE

# Where a line is looked for around what stood out, in lines that the joint's travel tells apart.
FINE_LINES = tuple(0.05 * k for k in range(-8, 9))
# Where a line's wave is looked for about a point of the sum, in steps between its points.
BETWEEN_POINTS = tuple(0.125 * k for k in range(-4, 5))


@dataclass(frozen=True)
class TorqueRipple(Effect):
    """Torque at the teeth's pace: τ = A cos(k N q − φ), or as a share of the load, τ_l a cos(k N q
    − φ).

    The order k counts cycles a turn of the motor, N is the gear ratio; k N also comes from lines
    that stand out of the residual over the joint's angle (`screened`), and where the ratio is not
    known, the order is that of the joint. Motion so fast that a line lies above the common filter
    adds nothing; some slow motion is needed.
    """

    lines: tuple[tuple[float, ...], ...] = ()  # cycles a turn of each joint that stand out
    screens: int = 1  # number of lines that were looked at to find them
    # Of a line among noise that stands out so far as one must; as many as were looked at: the best,
    # always.
    chance: float = LIMIT.chance

    id = "torque_ripple"

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> TorqueRipple:
        lines, looked = zip(
            *(
                find_lines(session, leftover, joint, chance=self.chance)
                for joint in range(session.n)
            ),
            strict=True,
        )
        return replace(self, lines=lines, screens=max(1, round(float(np.mean(looked)))))

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        why = (
            "is never slow enough: the ripple lies above the filter's corner or the position's "
            "noise"
        )
        shows = _ripple_shows(session, joint, _gear(session, joint) or LIMIT.fewest)
        return None if shows else f"{session.joint_names[joint]} {why}"

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        gear = _gear(session, joint)
        turns = [order * gear for order in LIMIT.ripple_orders] if gear else []
        turns = [cycles for cycles in turns if _ripple_shows(session, joint, cycles)]
        low, high = travel(session, joint)
        apart = np.pi / max(high - low, 1e-6)
        lines = self.lines[joint] if self.lines else ()
        known = np.array(turns)
        turns += [line for line in lines if np.all(np.abs(line - known) > apart)]
        typical = typical_load(session, joint)
        shapes = [
            {"turns": cycles, "loaded": loaded, "load_Nm": typical}
            for cycles in turns
            for loaded in (0.0, 1.0)
        ]
        return tuple(
            Variant({"order": shape["turns"] / (gear or 1.0)}, shape=shape) for shape in shapes
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        """A line that was found lies between points of a sum; that of a known gear is where
        it is.
        """
        turns = variant.shape["turns"]
        gear = _gear(session, joint)
        if gear and any(np.isclose(turns, order * gear) for order in LIMIT.ripple_orders):
            return (variant,)
        low, high = travel(session, joint)
        span = max(high - low, 1e-6)
        near = [float(turns + share * 2.0 * np.pi / span) for share in FINE_LINES]
        return tuple(
            Variant({"order": cycles / (gear or 1.0)}, shape={**variant.shape, "turns": cycles})
            for cycles in near
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        turns, loaded, load = (variant.shape[name] for name in ("turns", "loaded", "load_Nm"))
        return [
            (run.link[:, [joint]] / load if loaded else 1.0) * wave(run.motion.q[:, joint], turns)
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
        load = variant.shape["loaded"] * variant.shape["load_Nm"]
        return {
            **wave_parameters(variant.inner["order"], coefficients, covariance),
            "at_load_Nm": exactly(load),
        }

    def action(self, where: str, estimates: Mapping[str, Interval]) -> str:
        amplitude = estimates["amplitude_Nm"].words(TORQUE)
        load = estimates["at_load_Nm"]
        under = f" under {load.reported(TORQUE)} of load" if load.value else ""
        return (
            f"compensate ± {amplitude} of tooth ripple at {where}{under}; have its gear looked at "
            "if that has risen"
        )

    def law_figures(
        self,
        reported: Mapping[str, float],
        coefficients: Sequence[float],
        shape: Mapping[str, float],
    ) -> dict[str, float]:
        """Parameters that its law needs: `loaded`, `load_Nm` and `turns`, cycles a turn of the
        joint.

        `loaded` is 1 where the teeth's torque is a share of the load, else 0.
        """
        return {
            name: shape.get(name, usual)
            for name, usual in (("loaded", 0.0), ("load_Nm", 1.0), ("turns", 0.0))
        }


def _gear(session: SessionContext, joint: int) -> float | None:
    """A joint's gear ratio, if it is known: one is what URDFs hold where their writers did not know
    it.
    """
    ratio = np.nan if session.gear_ratios is None else float(session.gear_ratios[joint])
    return ratio if ratio >= LIMIT.fewest else None


def _ripple_shows(session: SessionContext, joint: int, turns: float) -> bool:
    """Whether some cycles pass slowly enough for the common filter, and position tells the
    phase.
    """
    cycles = 0.0
    for run in session.runs:
        speed = np.abs(run.motion.dq[:, joint])
        corner = min(run.motion.lowpass.cutoff, 0.4 * run.motion.lowpass.rate)
        moves = speed > run.motion.rest_speed[joint]
        slow = moves & (speed * turns / (2 * np.pi) < corner)
        distance = float(speed[slow].sum()) * run.interval
        cycles += distance * turns / (2 * np.pi)
    noise = max(float(run.motion.std[0, joint]) for run in session.runs)
    return cycles >= LIMIT.least_cycles and turns * noise < LIMIT.largest_phase_noise


def find_lines(
    session: SessionContext,
    leftover: Sequence[Float[Array, "t n"]],
    joint: int,
    chance: float = LIMIT.chance,
) -> tuple[tuple[float, ...], int]:
    """Lines in a joint's angle that the tuned model leaves, the strongest first.

    Args:
        session: All runs.
        leftover: For each run what the model leaves of the torque, filtered and decimated [N m].
        joint: Index of the joint.
        chance: Chance of a line among noise that stands out so far.

    Returns:
        Cycles a turn of the joint of each line, and how many lines were looked at; no line and 1
        where the motion shows none.
    """
    angles = []
    speeds = []
    left = []
    for run, values in zip(session.runs, leftover, strict=True):
        counts = run.motion.settled[:, joint]
        angles.append(run.motion.q[run.motion.coarse][counts, joint])
        coarse = run.motion.dq[run.motion.coarse]
        speeds.append(np.abs(coarse[counts, joint]))
        left.append(values[counts, joint])
    angle, speed, residual = map(np.concatenate, (angles, speeds, left))
    covered = float(np.ptp(angle)) if len(angle) else 0.0
    if covered < LIMIT.least_travel:
        return (), 1
    motion = session.runs[0].motion
    corner = motion.lowpass.cutoff
    step = motion.interval * motion.lowpass.factor
    angle = angle - angle.min()
    turns, power, cycles = _spectrum(angle, speed, residual, corner)
    spread = max(float(run.motion.std[0, joint]) for run in session.runs)
    shows = (cycles * step >= LIMIT.least_cycles) & (turns * spread < LIMIT.largest_phase_noise)
    shows &= turns >= LIMIT.fewest
    if not shows.any():
        return (), 1
    looked = max(1, int(shows.sum()) // LIMIT.padding)
    # A comparison asks for the best lines whatever their chance: no power is too small for it.
    least = max(0.0, 2.0 * np.log(looked / chance))
    apart = 4.0 * np.pi / covered
    between = (turns[1] - turns[0]) * np.array(BETWEEN_POINTS)
    lines: list[float] = []
    while len(lines) < LIMIT.most_lines:
        tried = []
        for peak in _peaks(turns, power / _usual(power), shows & (power > least), apart):
            passes = speed * turns[peak] < 2.0 * np.pi * corner
            without = _without_line(angle, residual, turns[peak] + between, passes)
            _, power_left, _ = _spectrum(angle, speed, without, corner)
            above = float(power[peak] / _usual(power_left)[peak])
            tried.append(_Line(float(turns[peak]), above, without, power_left))
        best = max(tried, key=lambda line: line.above, default=None)
        if best is None or best.above <= least:
            break
        lines.append(best.turns)
        residual = best.without
        power = best.power_left
        shows &= np.abs(turns - best.turns) >= apart
    return tuple(lines), looked


@dataclass(frozen=True, eq=False)
class _Line:
    """A line that stands out of the residual."""

    turns: float  # cycles a turn of the joint
    above: float  # its power over what is usual around it
    without: Float[Array, " t"]  # the residual without it
    power_left: Float[Array, " k"]  # all lines' power in that


def _peaks(
    turns: Float[Array, " k"],
    above: Float[Array, " k"],
    is_open: Bool[Array, " k"],
    apart: float,
) -> list[int]:
    """Places of the lines that stand out most.

    Args:
        turns: Cycles a turn of each line.
        above: Its power over what is usual around it.
        is_open: Whether the motion shows it, with a power that tells a line.
        apart: By how many cycles a turn they lie apart.
    """
    open_lines = is_open.copy()
    peaks: list[int] = []
    while open_lines.any() and len(peaks) < LIMIT.most_tried:
        peak = int(np.argmax(np.where(open_lines, above, -np.inf)))
        peaks.append(peak)
        open_lines &= np.abs(turns - turns[peak]) >= apart
    return peaks


def _usual(power: Float[Array, " k"]) -> Float[Array, " k"]:
    """What lines around each have among noise, for a power of white noise at the least."""
    width = 2 * LIMIT.around * LIMIT.padding + 1
    median = median_filter(power, width, mode="nearest") / (2.0 * np.log(2.0))
    return np.maximum(median, 1.0)


def _without_line(
    angle: Float[Array, " t"],
    residual: Float[Array, " t"],
    near: Float[Array, " m"],
    passes: Bool[Array, " t"],
) -> Float[Array, " t"]:
    """What a line's wave leaves of the samples that pass it slowly enough; the others as they are.

    A strong line is seen in all lines around it, for the angles are passed unevenly: what is usual
    there is what is there without it.

    Args:
        angle, residual: Of each sample.
        near: Cycles a turn of waves about the line, of which the one that leaves least is it.
        passes: The samples that pass it slowly enough.
    """
    least = residual[passes]
    for turns in near.tolist():
        phase = turns * angle[passes]
        columns = np.stack([np.cos(phase), np.sin(phase)], axis=1)
        weights = np.linalg.lstsq(columns, residual[passes], rcond=None)[0]
        left = residual[passes] - columns @ weights
        if left @ left < least @ least:
            least = left
    without = residual.copy()
    without[passes] = least
    return without


def _spectrum(
    angle: Float[Array, " t"],
    speed: Float[Array, " t"],
    residual: Float[Array, " t"],
    corner: float,
) -> tuple[Float[Array, " k"], Float[Array, " k"], Float[Array, " k"]]:
    """Lines, their power against white noise, and speed summed over what passes them slowly, in
    cycles a second.
    """
    width = np.pi / LIMIT.most
    bins = int(angle.max() / width) + 1
    length = 1 << int(np.ceil(np.log2(LIMIT.padding * bins)))
    lines = np.arange(length // 2 + 1)
    turns = 2.0 * np.pi * lines / (length * width)
    sums = np.zeros(len(turns), dtype=complex)
    counts = np.zeros(len(turns))
    cycles = np.zeros(len(turns))
    # Samples are sorted by speed into parts of an octave; of each part the fastest blurs a line
    # first.
    octaves = 2.0 ** (np.arange(LIMIT.octaves * LIMIT.octave_parts + 1) / LIMIT.octave_parts)
    edges = 2.0 * np.pi * corner / (LIMIT.most / octaves)
    part = np.searchsorted(edges, speed)
    place = (angle / width).astype(int)
    for k, edge in enumerate(edges):
        of_part = part == k
        if not of_part.any():
            continue
        passes = turns < 2.0 * np.pi * corner / edge
        sums[passes] += np.fft.rfft(np.bincount(place[of_part], residual[of_part], bins), length)[
            passes
        ]
        counts[passes] += of_part.sum()
        cycles[passes] += speed[of_part].sum()
    square = counts * np.mean(residual**2)
    power = 2.0 * np.abs(sums) ** 2 / np.maximum(square, 1e-300)
    return turns, power, cycles * turns / (2.0 * np.pi)
