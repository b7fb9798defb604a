"""Gears that give way: an elastic joint, and one with play.

The measured position is the motor's; the link lags by a deflection δ. With the motor's motion given, the link's own
equation of motion is one of a single unknown, linear in small δ:

    M δ'' + V δ' + P δ + τ_gear(δ, δ') = τ_rigid,

M, V, P the derivatives of the rigid torque by acceleration, velocity and position of the joint. It is integrated over
the recording, which holds near the resonance too, where a series in 1/K does not. What all joints feel of it is
−(M δ'' + V δ' + P δ), with the whole column of each derivative.

Source: Spong 1987, for the elastic joint; integration by Newmark's method (1959) with some numerical damping.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numba import njit

from ident.arrays import Array, Float
from ident.effects.base import Effect, Interval, RunContext, SessionContext, Variant
from ident.effects.knowledge import Expression, Range, Typical, exactly_as, not_at_all
from ident.effects.typical_sizes import (
    coefficient_interval,
    high_passed,
    rated_torque,
    root_mean_square,
    sampled_states,
)
from ident.motion.out_of_core import choose_runs

# Resonances of the link on its gear; above the last the deflection follows the load at once: one point serves all [Hz].
RESONANCES = (4.5, 6.5, 9.0, 12.5, 18.0, 30.0)
SOFTEST, STIFFEST = 1e2, 2e5  # [N m/rad]
# Damping ratios: of the search, and of the finer grid; beyond that, this many times more or less looks the same.
DAMPING_RATIO, FINE_DAMPING_RATIOS = 0.06, (0.025, 0.06, 0.14)
DAMPING_DOUBT = 4.0
# Full widths of play [rad]. The link is through a narrow gap before the filter sees it: what is left is proportional
# to the width. It falls through a wide one for so long that each width looks different.
NARROW_GAPS = (0.0005, 0.002)
WIDE_GAPS = tuple(float(gap) for gap in np.geomspace(0.0025, 0.06, 15))
# Of the wide ones those go on to the search that look most like what the tuned model leaves.
WIDE_KEPT = 2
# Play of a gear that is worn but still turns (new ones have some mrad), and wind-up at rated torque [rad].
LARGEST_PLAY, LARGEST_WIND_UP = 0.06, 0.1
# Stiffness of the gear in contact, in rated torques a radian, and its damping ratio: tooth contact hardly rebounds.
CONTACT_STIFFNESS = 150.0
CONTACT_DAMPING_RATIO, FINE_CONTACT_RATIOS = 0.3, (0.3, 0.6, 1.0)
WIDE_CONTACT_RATIO = 1.0
LONGEST_STEP = 0.002  # [s]
# Torque above this frequency shows elasticity; less of it than this share of the rated torque does not.
LOW_FREQUENCY = 2.0  # [Hz]
LEAST_HIGH_SHARE = 0.002
# Load to either side of zero that counts, as a share of the rated torque.
LEAST_LOAD_SHARE = 0.002
# Finer grid around the best stiffness or gap.
FINE_FACTORS = (0.5, 0.6, 0.7, 0.84, 1.0, 1.2, 1.4, 1.7, 2.0)
FINE_WIDE_FACTORS = (0.82, 0.88, 0.92, 0.96, 1.0, 1.04, 1.08, 1.13, 1.2)


class JointElasticity(Effect):
    """A torsion spring between motor and link: K δ + D δ' = τ_gear. The coefficient is the compliance 1/K.

    Each point of the grid is exact at its own stiffness and follows 1/K around it.
    """

    id = "joint_elasticity"
    rows = "all"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "the gear twists under load: torque differs near the arm's resonance; look at fast changes of load"
    shown_by = "chirp"
    parted_by: ClassVar[Mapping[str, str]] = {"link_inertial_error": "chirp"}
    typical = Typical("stiffness_Nm_rad", 0.05, inverse=True)
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all("a joint has no spring between motor and link; add the module's torque"),
        "mjcf": exactly_as("a second joint `<joint>_spring` with stiffness and damping behind the motor's"),
    }

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        high = root_mean_square([high_passed(run.link[:, joint], run.interval, LOW_FREQUENCY) for run in session.runs])
        if high < LEAST_HIGH_SHARE * rated_torque(session, joint):
            return (
                f"load of {session.joint_names[joint]} changes too slowly ({high:.2f} N m above {LOW_FREQUENCY:g} Hz)"
            )
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        inertia = _mean_inertia(session, joint)
        found = np.unique(np.clip(inertia * (2 * np.pi * np.array(RESONANCES)) ** 2, SOFTEST, STIFFEST))
        return tuple(_elastic(float(k), inertia, DAMPING_RATIO) for k in found)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        inertia = _mean_inertia(session, joint)
        return tuple(
            _elastic(factor * variant.shape["stiffness_Nm_rad"], inertia, ratio)
            for ratio in FINE_DAMPING_RATIOS
            for factor in FINE_FACTORS
        )

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        stiffness, damping = variant.shape["stiffness_Nm_rad"], variant.shape["damping_Nms_rad"]
        return [
            stiffness * _felt(run, joint, *_deflect(run, joint, stiffness, damping, 0.0))[:, :, None]
            for run in session.runs
        ]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        compliance = coefficient_interval(0, coefficients, covariance)
        value, low, high = (
            float(np.clip(1.0 / max(c, 1.0 / STIFFEST), SOFTEST, STIFFEST))
            for c in (compliance.value, compliance.high, compliance.low)
        )
        damping = variant.shape["damping_Nms_rad"]
        return {
            "stiffness_Nm_rad": Interval(value, low, high),
            "damping_Nms_rad": Interval(damping, damping / DAMPING_DOUBT, damping * DAMPING_DOUBT),
        }

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        """Soft gears wind up by some degrees at their rated torque; of those that hold zero compliance none is told."""
        least = rated_torque(session, joint) / LARGEST_WIND_UP
        most = STIFFEST if figures["stiffness_Nm_rad"].high < STIFFEST else 0.0
        return {"stiffness_Nm_rad": Range(least, most, "the joint would fold up, or is as good as rigid")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        stiffness = figures["stiffness_Nm_rad"].words("N m/rad")
        return f"model {where} as an elastic joint of {stiffness}, or plan its motions smoother"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([1.0 / SOFTEST])


@dataclass(frozen=True)
class Backlash(Effect):
    """Play of width b: no torque passes while the link crosses from one flank to the other.

    The columns are the difference of two integrations, with and without the gap, per width. That of a narrow gap is
    proportional to its width, which is then its coefficient; a wide one is a point of the grid (`screened`).

    Attributes:
        widths: Wide gaps of each joint that look most like what the tuned model leaves [rad].
        screens: Number of wide gaps that were looked at for each that is kept.
    """

    widths: tuple[tuple[float, ...], ...] = ()
    screens: int = 1

    id = "backlash"
    bursts = True
    rows = "all"
    nonnegative: ClassVar[tuple[int, ...]] = (0,)
    summary = "the gear has play: a knock where the load changes sign; look where gravity's torque crosses zero"
    shown_by = "reversals"
    defining = ("gap_rad",)
    typical = Typical("gap_rad", 0.017)
    formats: ClassVar[Mapping[str, Expression]] = {
        "urdf": not_at_all("a joint has no play; add the module's torque"),
        "mjcf": not_at_all("stops of a joint are softened by the step, not stiff as teeth; add the module's torque"),
    }

    def screened(self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]) -> Backlash:
        chosen = choose_runs(len(session.runs), session.every)
        some = [leftover[k] for k in chosen]
        found = tuple(
            () if self.untestable(session, joint) else _widths(session.survey, some, joint)
            for joint in range(session.n)
        )
        return replace(self, widths=found, screens=len(WIDE_GAPS) // WIDE_KEPT)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        least = LEAST_LOAD_SHARE * rated_torque(session, joint)
        low = min(float(run.link[:, joint].min()) for run in session.runs)
        high = max(float(run.link[:, joint].max()) for run in session.runs)
        if low > -least or high < least:
            return f"load of {session.joint_names[joint]} never changes sign ({low:.2f} to {high:.2f} N m)"
        return None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        narrow = _contact(session, joint, CONTACT_DAMPING_RATIO)
        wide = _contact(session, joint, WIDE_CONTACT_RATIO)
        widths = self.widths[joint] if self.widths else ()
        return (
            *(Variant(shape={"gap_rad": gap, **narrow}) for gap in NARROW_GAPS),
            *(Variant({"gap_rad": gap}, shape=wide) for gap in widths),
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        contacts = [_contact(session, joint, ratio) for ratio in FINE_CONTACT_RATIOS]
        if variant.inner:
            wide = [factor * variant.inner["gap_rad"] for factor in FINE_WIDE_FACTORS]
            return tuple(Variant({"gap_rad": gap}, shape=contact) for contact in contacts for gap in wide)
        narrow = [factor * variant.shape["gap_rad"] for factor in FINE_FACTORS]
        return tuple(Variant(shape={**contact, "gap_rad": gap}) for contact in contacts for gap in narrow)

    def columns(self, session: SessionContext, joint: int, variant: Variant) -> list[Float[Array, "T ..."]]:
        gap = variant.inner.get("gap_rad", variant.shape.get("gap_rad", 0.0))
        contact = variant.shape["stiffness_Nm_rad"], variant.shape["damping_Nms_rad"]
        return [_knock(run, joint, contact, (gap,))[0][:, :, None] / gap for run in session.runs]

    def parameters(
        self, session: SessionContext, joint: int, variant: Variant, coefficients: Array, covariance: Array
    ) -> dict[str, Interval]:
        return {"gap_rad": coefficient_interval(0, coefficients, covariance)}

    def physical(self, session: SessionContext, joint: int, figures: Mapping[str, Interval]) -> dict[str, Range]:
        return {"gap_rad": Range(0.0, LARGEST_PLAY, "gears with so much play are broken")}

    def action(self, where: str, figures: Mapping[str, Interval]) -> str:
        gap = figures["gap_rad"].words("mrad", 1e3)
        return f"have the gear of {where} looked at: it has {gap} of play; until then approach targets from one side"

    def prior_scale(self, session: SessionContext, joint: int, variant: Variant) -> Float[Array, " k"]:
        return np.array([LARGEST_PLAY])


def _contact(session: SessionContext, joint: int, ratio: float) -> dict[str, float]:
    """Stiffness and damping of the teeth."""
    stiffness = CONTACT_STIFFNESS * rated_torque(session, joint)
    damping = 2 * ratio * float(np.sqrt(stiffness * _mean_inertia(session, joint)))
    return {"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping}


def _knock(
    run: RunContext, joint: int, contact: tuple[float, float], gaps: Sequence[float]
) -> list[Float[Array, "T n"]]:
    """What all joints feel of play, for each width [N m]."""
    tight = _deflect(run, joint, *contact, 0.0)
    found = []
    for gap in gaps:
        loose = _deflect(run, joint, *contact, gap)
        found.append(_felt(run, joint, loose[0] - tight[0], loose[1] - tight[1]))
    return found


def _widths(session: SessionContext, leftover: Sequence[Float[Array, "t n"]], joint: int) -> tuple[float, ...]:
    """The wide gaps whose torque looks most like what is left at a joint, by differences from sample to sample."""
    stiffness = _contact(session, joint, WIDE_CONTACT_RATIO)
    contact = stiffness["stiffness_Nm_rad"], stiffness["damping_Nms_rad"]
    along, power = np.zeros(len(WIDE_GAPS)), np.zeros(len(WIDE_GAPS))
    for run, left in zip(session.runs, leftover, strict=True):
        counts = (left[1:, joint] != 0.0) & (left[:-1, joint] != 0.0)
        steps = np.diff(left[:, joint])[counts]
        for k, felt in enumerate(_knock(run, joint, contact, WIDE_GAPS)):
            change = np.diff(run.motion.filtered(felt[:, [joint]])[:, 0])[counts]
            along[k] += change @ steps
            power[k] += change @ change
    score = np.where(along > 0.0, along**2 / np.maximum(power, 1e-300), 0.0)
    best = np.argsort(-score, kind="stable")[:WIDE_KEPT]
    return tuple(sorted(WIDE_GAPS[k] for k in best if score[k] > 0.0))


def _elastic(stiffness: float, inertia: float, ratio: float) -> Variant:
    """A point of the grid: a spring with a share of its critical damping."""
    damping = 2 * ratio * float(np.sqrt(stiffness * inertia))
    return Variant(shape={"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping})


def _mean_inertia(session: SessionContext, joint: int) -> float:
    """Mean inertia of the link side about a joint [kg m²]."""
    mass_matrix = session.runs[0].arm.derivatives(*sampled_states(session))[2]
    return max(float(np.mean(mass_matrix[:, joint, joint])), 1e-6)


def _deflect(
    run: RunContext, joint: int, stiffness: float, damping: float, gap: float
) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    """Deflection of the joint and its rate [rad, rad/s]."""
    position, velocity, inertia = (np.ascontiguousarray(part[:, joint, joint]) for part in run.derivatives)
    load = np.ascontiguousarray(run.link[:, joint])
    steps = max(1, int(np.ceil(run.interval / LONGEST_STEP)))
    return _integrate(load, inertia, velocity, position, stiffness, damping, gap / 2, run.interval, steps)


def _felt(run: RunContext, joint: int, twist: Array, rate: Array) -> Float[Array, "T n"]:
    """What all joints feel of a deflection [N m]."""
    position, velocity, inertia = (part[:, :, joint] for part in run.derivatives)
    change = np.gradient(rate, run.interval)
    return -(inertia * change[:, None] + velocity * rate[:, None] + position * twist[:, None])


@njit(cache=True)
def _integrate(
    load: Array,
    inertia: Array,
    velocity: Array,
    position: Array,
    stiffness: float,
    damping: float,
    half: float,
    interval: float,
    steps: int,
) -> tuple[Array, Array]:
    """Newmark's method; the gear pushes only beyond ±half, and damps only there."""
    gamma, beta = 0.6, 0.3025
    h = interval / steps
    twist, rate = np.empty(len(load)), np.empty(len(load))
    x = load[0] / (stiffness + position[0]) + half * np.sign(load[0])
    v, a = (load[1] - load[0]) / (interval * stiffness), 0.0
    twist[0], rate[0] = x, v
    for k in range(1, len(load)):
        for step in range(1, steps + 1):
            w = step / steps
            force = load[k - 1] + w * (load[k] - load[k - 1])
            mass = inertia[k - 1] + w * (inertia[k] - inertia[k - 1])
            drag = velocity[k - 1] + w * (velocity[k] - velocity[k - 1])
            pull = position[k - 1] + w * (position[k] - position[k - 1])
            x_ahead = x + h * v + h * h * (0.5 - beta) * a
            v_ahead = v + h * (1.0 - gamma) * a
            side = 0.0 if abs(x_ahead) < half else np.sign(x_ahead)
            for _ in range(4):
                touch = 1.0 if (side != 0.0 or half == 0.0) else 0.0
                k_all, d_all = touch * stiffness + pull, touch * damping + drag
                a = (force + touch * stiffness * side * half - k_all * x_ahead - d_all * v_ahead) / (
                    mass + gamma * h * d_all + beta * h * h * k_all
                )
                x = x_ahead + beta * h * h * a
                found = 0.0 if abs(x) < half else np.sign(x)
                if found == side or half == 0.0:
                    break
                side = found
            v = v_ahead + gamma * h * a
        twist[k], rate[k] = x, v
    return twist, rate
