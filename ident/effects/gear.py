"""Gears that give way: what a joint's link does behind its motor, and what all joints feel of it.

The measured position is the motor's; the link lags by a deflection δ. With the motor's motion
given, the link's own equation of motion is one of a single unknown, linear in small δ:

    M δ'' + V δ' + P δ + τ_gear(δ, δ') = τ_rigid,

M, V, P the derivatives of the rigid torque by acceleration, velocity and position of the joint. It
is integrated over the recording, which holds near the resonance too, where a series in 1/K does
not. What all joints feel of it is −(M δ'' + V δ' + P δ), with the whole column of each derivative.

Narrow gaps of a gear with play go by their coefficient, wide ones by a grid of widths.

Source: Spong 1987, for the elastic joint; integration by Newmark's method (1959), of average
acceleration.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arrays import Array, Float
from ident.compiled import compiled
from ident.effects.base import Effect, Interval, Range, RunContext, SessionContext, Variant
from ident.effects.intervals import coefficient_interval
from ident.effects.session_context import (
    high_passed,
    joined,
    rated_torque,
    root_mean_square,
    sampled_states,
)
from ident.effects.settings import GEAR as LIMIT
from ident.laws.elastic import LONGEST_STEP, integrate_twist

_integrate = compiled(error_model="numpy", nogil=True)(integrate_twist)


def mean_inertia(session: SessionContext, joint: int) -> float:
    """Mean inertia of the link side about a joint, over some poses of the session [kg m²].

    At least 1e-6.
    """
    return max(float(session.runs[0].arm.mean_inertia(sampled_states(session)[0])[joint]), 1e-6)


def deflect(
    run: RunContext, joint: int, stiffness: float, damping: float, gap: float
) -> tuple[Float[Array, " T"], Float[Array, " T"]]:
    """Deflection of a joint's gear and its rate along a run [rad, rad/s].

    Zeros where the deflection is too large for its law.

    Args:
        run: The run.
        joint: Index of the joint.
        stiffness, damping: Of the gear [N m/rad, N m s/rad].
        gap: Full width of its play [rad].
    """
    slopes = (slope[:, joint, joint] for slope in reversed(run.derivatives))
    load = run.link[:, joint]
    deflection = np.zeros((2, len(run.link)))
    deflection[1, 0] = (load[1] - load[0]) / (run.interval * stiffness)
    steps = max(1, int(np.ceil(run.interval / LONGEST_STEP)))
    _integrate(
        np.array([load, *slopes]),
        np.array([stiffness, damping, gap / 2]),
        run.interval,
        steps,
        deflection,
    )
    twist, rate = (
        deflection
        if np.abs(deflection[0]).max() < LIMIT.largest_twist
        else np.zeros_like(deflection)
    )
    return twist, rate


def felt_torque(
    run: RunContext,
    joint: int,
    twist: Array,
    rate: Array,
    rows: slice = slice(None),
    unit: float = 1.0,
) -> Float[Array, "T k"]:
    """What joints feel of a deflection, divided by a unit of it [N m].

    Args:
        run: The run.
        joint: Index of the joint that is deflected.
        twist, rate: Its deflection and the rate of that [rad, rad/s].
        rows: The k joints that are asked for; all by default.
        unit: What is divided by.
    """
    position, velocity, inertia = (
        np.moveaxis(derivative, 0, -1)[rows, joint] for derivative in run.derivatives
    )
    change = np.gradient(rate, run.interval)
    return (-(inertia * change + velocity * rate + position * twist) / unit).T


class JointElasticity(Effect):
    """A torsion spring between motor and link: K δ + D δ' = τ_gear. The coefficient is the
    compliance 1/K.

    Each point of the grid is exact at its own stiffness and follows 1/K around it.
    """

    id = "joint_elasticity"

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        corner = LIMIT.low_frequency
        name = session.joint_names[joint]
        high = root_mean_square(
            [high_passed(run.link[:, joint], run.interval, corner) for run in session.runs]
        )
        slow = f"load of {name} changes too slowly ({high:.2f} N m above {corner:g} Hz)"
        return slow if high < LIMIT.least_high_share * rated_torque(session, joint) else None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        inertia = mean_inertia(session, joint)
        stiffnesses = np.unique(
            np.clip(
                inertia * (2 * np.pi * np.array(LIMIT.resonances)) ** 2, *_bounds(session, joint)
            )
        )
        return tuple(_elastic(float(k), inertia, LIMIT.damping_ratio) for k in stiffnesses)

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        inertia = mean_inertia(session, joint)
        return tuple(
            _elastic(factor * variant.shape["stiffness_Nm_rad"], inertia, ratio)
            for ratio in LIMIT.fine_damping_ratios
            for factor in LIMIT.fine_factors
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        stiffness = variant.shape["stiffness_Nm_rad"]
        damping = variant.shape["damping_Nms_rad"]
        gear = joint, stiffness, damping, 0.0
        return [
            stiffness * felt_torque(run, joint, *deflect(run, *gear))[:, :, None]
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
        compliance = coefficient_interval(0, coefficients, covariance)
        (softest, stiffest) = _bounds(session, joint)
        value, low, high = (
            float(np.clip(1.0 / max(c, 1.0 / stiffest), softest, stiffest))
            for c in (compliance.value, compliance.high, compliance.low)
        )
        damping = variant.shape["damping_Nms_rad"]
        return {
            "stiffness_Nm_rad": Interval(value, low, high),
            "damping_Nms_rad": Interval(
                damping, damping / LIMIT.damping_doubt, damping * LIMIT.damping_doubt
            ),
        }

    def physical(
        self, session: SessionContext, joint: int, estimates: Mapping[str, Interval]
    ) -> dict[str, Range]:
        """Bounds of its stiffness.

        A joint that winds up by radians would fold; one whose interval holds zero compliance is as
        good as rigid.
        """
        least, stiffest = _bounds(session, joint)
        most = stiffest if estimates["stiffness_Nm_rad"].high < stiffest else 0.0
        return {
            "stiffness_Nm_rad": Range(
                least, most, "the joint would fold up, or is as good as rigid"
            )
        }

    def prior_scale(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> Float[Array, " k"]:
        return np.array([1.0 / _bounds(session, joint)[0]])


def _bounds(session: SessionContext, joint: int) -> tuple[float, float]:
    """Stiffness of the softest gear that turns at all, and of one as good as rigid [N m/rad]."""
    rated = rated_torque(session, joint)
    return rated / LIMIT.largest_wind_up, rated / LIMIT.least_wind_up


def _elastic(stiffness: float, inertia: float, ratio: float) -> Variant:
    """A point of the grid: a spring with a share of its critical damping."""
    damping = 2 * ratio * float(np.sqrt(stiffness * inertia))
    return Variant(shape={"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping})


@dataclass(frozen=True)
class Backlash(Effect):
    """Play of width b: no torque passes while the link crosses from one flank to the other.

    The columns are the difference of two integrations, with and without the gap, per width. That of
    a narrow gap is proportional to its width, which is then its coefficient; a wide one is a point
    of the grid (`screened`).
    """

    # Wide gaps of each joint that look most like what the tuned model leaves [rad].
    widths: tuple[tuple[float, ...], ...] = ()
    screens: int = 1  # number of wide gaps that were looked at for each that is kept

    id = "backlash"

    def screened(
        self, session: SessionContext, leftover: Sequence[Float[Array, "t n"]]
    ) -> Backlash:
        widths = tuple(
            () if self.untestable(session, joint) else _widths(session, leftover, joint)
            for joint in range(session.n)
        )
        return replace(self, widths=widths, screens=len(LIMIT.wide_gaps) // LIMIT.wide_kept)

    def untestable(self, session: SessionContext, joint: int) -> str | None:
        least = LIMIT.least_load_share * rated_torque(session, joint)
        load = joined(session, "link", joint)
        low = load.min()
        high = load.max()
        one_sided = (
            f"load of {session.joint_names[joint]} never changes sign ({low:.2f} to {high:.2f} N m)"
        )
        return one_sided if low > -least or high < least else None

    def variants(self, session: SessionContext, joint: int) -> Sequence[Variant]:
        narrow = _contact(session, joint, LIMIT.contact_damping_ratio)
        wide = _contact(session, joint, LIMIT.wide_contact_ratio)
        widths = self.widths[joint] if self.widths else ()
        return (
            *(Variant(shape={"gap_rad": gap, **narrow}) for gap in LIMIT.narrow_gaps),
            *(Variant({"gap_rad": gap}, shape=wide) for gap in widths),
        )

    def refined(self, session: SessionContext, joint: int, variant: Variant) -> Sequence[Variant]:
        contacts = [_contact(session, joint, ratio) for ratio in LIMIT.fine_contact_ratios]
        if variant.inner:
            wide = [factor * variant.inner["gap_rad"] for factor in LIMIT.fine_wide_factors]
            return tuple(
                Variant({"gap_rad": gap}, shape=contact) for contact in contacts for gap in wide
            )
        narrow = [factor * variant.shape["gap_rad"] for factor in LIMIT.fine_factors]
        return tuple(
            Variant(shape={**contact, "gap_rad": gap}) for contact in contacts for gap in narrow
        )

    def columns(
        self, session: SessionContext, joint: int, variant: Variant
    ) -> list[Float[Array, "T ..."]]:
        gap = variant.inner.get("gap_rad", variant.shape.get("gap_rad", 0.0))
        contact = variant.shape["stiffness_Nm_rad"], variant.shape["damping_Nms_rad"]
        return [
            next(_knock(run, joint, contact, (gap,), unit=gap))[:, :, None] for run in session.runs
        ]


def _contact(session: SessionContext, joint: int, ratio: float) -> dict[str, float]:
    """Stiffness and damping of the teeth."""
    stiffness = LIMIT.contact_stiffness * rated_torque(session, joint)
    damping = 2 * ratio * float(np.sqrt(stiffness * mean_inertia(session, joint)))
    return {"stiffness_Nm_rad": stiffness, "damping_Nms_rad": damping}


def _knock(
    run: RunContext,
    joint: int,
    contact: tuple[float, float],
    gaps: Sequence[float],
    rows: slice = slice(None),
    unit: float = 1.0,
) -> Iterator[Float[Array, "T k"]]:
    """What all joints, or some of them, feel of play, for each width, in units of one [N m]."""
    same_gear = "without play", joint, contact
    if same_gear not in run.kept:
        run.kept[same_gear] = deflect(run, joint, *contact, 0.0)
    tight = run.kept[same_gear]
    for gap in gaps:
        loose = deflect(run, joint, *contact, gap)
        torque = loose[0] - tight[0]
        twist = loose[1] - tight[1]
        yield felt_torque(run, joint, torque, twist, rows, unit)


def _widths(
    session: SessionContext, leftover: Sequence[Float[Array, "t n"]], joint: int
) -> tuple[float, ...]:
    """The wide gaps whose torque looks most like what is left at a joint, by differences from
    sample to sample.
    """
    stiffness = _contact(session, joint, LIMIT.wide_contact_ratio)
    contact = stiffness["stiffness_Nm_rad"], stiffness["damping_Nms_rad"]
    along = np.zeros(len(LIMIT.wide_gaps))
    power = np.zeros(len(LIMIT.wide_gaps))
    for run, left in zip(session.runs, leftover, strict=True):
        settled = run.motion.settled[:, joint]
        counts = settled[1:] & settled[:-1]
        steps = np.diff(left[:, joint])[counts]
        felt = list(_knock(run, joint, contact, LIMIT.wide_gaps, rows=slice(joint, joint + 1)))
        change = np.diff(run.motion.lowpass.together(felt), axis=0)[counts]
        along += steps @ change
        power += np.sum(change**2, axis=0)
    score = np.where(along > 0.0, along**2 / np.maximum(power, 1e-300), 0.0)
    best = np.argsort(-score, kind="stable")[: LIMIT.wide_kept]
    return tuple(sorted(LIMIT.wide_gaps[k] for k in best if score[k] > 0.0))
