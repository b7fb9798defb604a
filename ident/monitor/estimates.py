"""Parameters of an arm in one session, joint by joint, always by the same regression, so that days
can be compared.

    tau = gain · rigid(q, dq, ddq) + rotor · ddq + viscous · dq + coulomb · sign(dq) + offset

clear of reversals and through the common filter; the rigid torque is that of the reference arm (the
URDF, or a model fitted once). The gain is estimated where gravity moves the joint: elsewhere
nothing parts it from the rotor's inertia. What these leave is the gap. A reference that is wrong
shifts an estimate by the same amount every day, as long as the motions are the same; other motions
every day widen the day-to-day spread, against which every change is tested.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import digamma, ndtri, polygamma, stdtrit

from ident.arrays import Array, Float, Int
from ident.checks.filtered_run import USUAL_EFFORT
from ident.errors import plural
from ident.motion.motion import Motion
from ident.results import Result
from ident.robot.arm import ArmModel

# Parameter -> unit.
UNITS = {
    "gain": "1",
    "rotor": "kg m²",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "offset": "N m",
    "gap": "N m",
}
# Further ones, of links and of the whole arm, of which there are ranges alone.
BODY_UNITS = {
    "mass_kg": "kg",
    "centre_x_m": "m",
    "centre_y_m": "m",
    "centre_z_m": "m",
    "payload_kg": "kg",
    "payload_moment_x_kgm": "kg m",
    "payload_moment_y_kgm": "kg m",
    "payload_moment_z_kgm": "kg m",
    "delay_s": "s",
}
RANGED_UNITS = {**UNITS, **BODY_UNITS}
# What each is called.
WORDS = {
    "gain": "torque gain",
    "rotor": "rotor inertia",
    "viscous": "damping",
    "coulomb": "dry friction",
    "offset": "torque offset",
    "mass_kg": "mass",
    "centre_x_m": "centre x",
    "centre_y_m": "centre y",
    "centre_z_m": "centre z",
    "payload_kg": "payload",
    "payload_moment_x_kgm": "payload moment x",
    "payload_moment_y_kgm": "payload moment y",
    "payload_moment_z_kgm": "payload moment z",
    "delay_s": "delay of the torque",
}
TERMS = ("gain", "rotor", "viscous", "coulomb", "offset")
# Pieces whose errors are taken as independent: several times the correlation time of residuals (0.1
# to 0.3 s) [s].
PIECE_S = 1.5
# Fewer samples, or fewer pieces, give no estimate.
LEAST_ROWS = 100
LEAST_PIECES = 6
# Where so little of the moving samples is clear of reversals, all moving ones are used.
LEAST_SETTLED = 0.1
SCHEMA = "ident.ranges/1"
LEVEL = 0.95
# What is randomised by habit where nobody has measured: a share to either side of each parameter.
HABIT = 0.30
# Parameters that follow the torque's scale and of which a share makes sense; a torque offset has
# none of its own.
SCALED = ("gain", "rotor", "viscous", "coulomb", "mass_kg")
# Figures of a kind of which their spreads tell each other; a size below which no share makes sense.
FEWEST_ALIKE = 3
LEAST_SIZE = 1e-12
# Held-out days need so many others to estimate a spread from.
LEAST_DAYS = 3


def unit_of(name: str) -> str:
    """What stands behind a parameter's number: a blank and its unit, if it has one."""
    return "" if RANGED_UNITS[name] == "1" else f" {RANGED_UNITS[name]}"


@dataclass(frozen=True)
class ParameterEstimate:
    """An estimate with its 95 % interval and its standard deviation."""

    value: float
    low: float
    high: float
    std: float


Estimates = Mapping[tuple[str, str], ParameterEstimate]
"""By joint and parameter (`UNITS`)."""


def estimate_session(
    motions: Sequence[Motion], reference: ArmModel
) -> dict[tuple[str, str], ParameterEstimate]:
    """All parameters that a session's motions give an estimate of."""
    rigid = []
    gravity = []
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid.append(motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq)))
        gravity.append(arm.gravity(motion.q[motion.coarse]))
    change = np.concatenate(gravity).std(axis=0)
    heavy = (change > USUAL_EFFORT.heavy_share * change.max()) & (change > USUAL_EFFORT.heavy_Nm)
    return {
        (joint, name): estimate
        for j, joint in enumerate(motions[0].joints)
        for name, estimate in _of_joint(motions, rigid, j, bool(heavy[j])).items()
    }


def _of_joint(
    motions: Sequence[Motion], rigid: Sequence[Array], j: int, heavy: bool
) -> dict[str, ParameterEstimate]:
    """By least squares over the samples that count; errors by their pieces, as if those were
    independent.
    """
    settled = sum(int(motion.settled[:, j].sum()) for motion in motions)
    moving = sum(int(motion.moving[:, j].sum()) for motion in motions)
    tables = []
    torques = []
    pieces = []
    first = 0
    for motion, torque in zip(motions, rigid, strict=True):
        rows = (motion.moving if settled < LEAST_SETTLED * moving else motion.settled)[:, j]
        tables.append(term_columns(motion, torque, j)[rows])
        torques.append(motion.tau_filtered[rows, j])
        number = ((motion.time[motion.coarse] - motion.time[0]) // PIECE_S).astype(int)
        pieces.append(first + number[rows])
        first += int(number[-1]) + 1
    x = np.concatenate(tables)
    y = np.concatenate(torques)
    piece = np.concatenate(pieces)
    if not heavy:
        y = y - x[:, 0]
        x = x[:, 1:]
    names = TERMS if heavy else TERMS[1:]
    count = len(np.unique(piece))
    if len(y) < LEAST_ROWS or count < LEAST_PIECES:
        return {}
    size = np.linalg.norm(x, axis=0)
    free = max(1, count - len(names))
    scaled = x / np.where(size > 0.0, size, 1.0)
    beta = np.linalg.lstsq(scaled, y, rcond=1e-9)[0]
    left = y - scaled @ beta
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-9, hermitian=True)
    scores = np.zeros((piece.max() + 1, scaled.shape[1]))
    np.add.at(scores, piece, scaled * left[:, None])
    covariance = bread @ (scores.T @ scores) @ bread * count / free
    std = np.sqrt(np.diag(covariance))
    reach = float(stdtrit(free, 0.975))
    estimates = {}
    for name, value, error, norm in zip(names, beta, std, size, strict=True):
        if norm > 0.0:
            middle = float(value / norm)
            error_of_mean = float(error / norm)
            estimates[name] = ParameterEstimate(
                middle,
                middle - reach * error_of_mean,
                middle + reach * error_of_mean,
                error_of_mean,
            )
    return {**estimates, "gap": _gap(left, piece, reach)}


def term_columns(motion: Motion, rigid: Float[Array, "t n"], j: int) -> Float[Array, "t 5"]:
    """What each of `TERMS` multiplies at a joint, through the common filter."""
    filtered = motion.filtered(
        np.column_stack([motion.ddq[:, j], motion.dq[:, j], np.sign(motion.dq[:, j])])
    )
    return np.column_stack([rigid[:, j], filtered, np.ones(len(filtered))])


def _gap(left: Float[Array, " t"], piece: Int[Array, " t"], reach: float) -> ParameterEstimate:
    """Root mean square of what is left, with its error over pieces."""
    count = np.bincount(piece)
    mean = np.bincount(piece, left**2)[count > 0] / count[count > 0]
    weight = count[count > 0] / len(left)
    square = float(weight @ mean)
    error = float(np.sqrt(np.sum((weight * (mean - square)) ** 2)))
    value = float(np.sqrt(square))
    std = error / max(2.0 * value, 1e-300)
    return ParameterEstimate(value, max(0.0, value - reach * std), value + reach * std, std)


# Ranges for domain randomisation: as wide as the arm is uncertain and changes from day to day, and
# no wider. Each session is a day. A parameter's range is the wider of two: its own 95 % interval,
# and where it will lie on another day by its spread over the days so far. The randomised torque at
# a state lies in a box of those ranges; the check is how often the measured torque of a day lies in
# the box made from the other days, noise added as a simulator would.


@dataclass(frozen=True)
class ParameterRange:
    """The range of one parameter."""

    value: float  # its middle: the mean over the days
    low: float  # the range
    high: float
    source: str  # what makes it as wide as it is: `interval` or `days`


@dataclass(frozen=True, eq=False)
class Ranges(Result):
    """Ranges of an arm."""

    robot: str  # its name
    days: tuple[str, ...]  # names of the sessions
    ranges: Mapping[tuple[str, str], ParameterRange]  # by joint and parameter
    noise: Mapping[str, float]  # standard deviation of what the estimates leave at each joint [N m]
    # Share of held-out torque in the randomised box, by joint; empty where there are too few days.
    inside: Mapping[str, float]
    # how many times narrower the box is there than the habit's, noise aside; NaN likewise
    narrower: float

    def to_dict(self) -> dict[str, Any]:
        narrower = None if np.isnan(self.narrower) else self.narrower
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.noise),
            "days": list(self.days),
            "ranges": {
                f"{joint}/{name}": {**vars(parameter_range), "unit": RANGED_UNITS[name]}
                for (joint, name), parameter_range in self.ranges.items()
            },
            "noise_Nm": dict(self.noise),
            "heldout": {
                "level": LEVEL,
                "inside": dict(self.inside),
                "narrower_than_habit": narrower,
                "habit": HABIT,
            },
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """The ranges in a table of plain lines, and the check."""
        lines = [f"{self.robot}: {plural(len(self.days), 'day')}"]
        for (joint, name), parameter_range in self.ranges.items():
            by = "day to day" if parameter_range.source == "days" else "its interval"
            ends = f"[{parameter_range.low:.4g}, {parameter_range.high:.4g}]"
            size = f"{parameter_range.value:.4g} {ends}{unit_of(name)}"
            lines.append(f"{joint} {WORDS[name]}: {size}, by {by}")
        if self.inside:
            share = float(np.mean(list(self.inside.values())))
            lines.append(
                f"held-out days: {100.0 * share:.1f} % of the torque inside the ranges and noise; "
                f"ranges {self.narrower:.1f} times narrower than ±{100.0 * HABIT:.0f} %"
            )
        else:
            lines.append(
                f"fewer than {LEAST_DAYS + 1} days: how an arm changes from day to day is not "
                "checked"
            )
        return "\n".join(lines)


def find_ranges(
    days: Mapping[str, Sequence[Motion]],
    reference: ArmModel,
    further: Callable[[Sequence[Motion], ArmModel], Estimates] | None = None,
) -> Ranges:
    """Ranges of an arm from its days, and how they do on days left out.

    Args:
        days, reference: Motions of each day by its name, and the arm that all figures refer to.
        further: What else is estimated of each day, such as its bodies; the check on days left out
            is without it.
    """
    by_day: dict[str, Estimates] = {}
    for name, motions in days.items():
        more = {} if further is None else further(motions, reference)
        by_day[name] = {**estimate_session(motions, reference), **more}
    inside: dict[str, float] = {}
    narrower = float("nan")
    if len(days) > LEAST_DAYS:
        checks = []
        for out, motions in days.items():
            rest = [day for name, day in by_day.items() if name != out]
            checks.append(_check(motions, reference, pool_days(rest), noise_of(rest)))
        joints = next(iter(days.values()))[0].joints
        inside = dict(
            zip(joints, map(float, np.nanmean([share for share, _ in checks], axis=0)), strict=True)
        )
        narrower = float(np.median([width for _, width in checks]))
    every = list(by_day.values())
    return Ranges(reference.name, tuple(days), pool_days(every), noise_of(every), inside, narrower)


def pool_days(days: Sequence[Estimates]) -> dict[tuple[str, str], ParameterRange]:
    """The range of each parameter that every day has an estimate of.

    The wider of the interval in a usual session, and where another day's estimate will lie. Of few
    days the spread of one joint's figure is hardly known; that of all joints' figures of its kind
    is, and is counted with it (`moderated_spreads`).

    Source: the prediction interval of a normal draw, Student's t.
    """
    ranges = {}
    of_all_days = set(days[0]).intersection(*days[1:])
    keys = [key for key in days[0] if key[1] in WORDS and key in of_all_days]
    by_key = {}
    for key in keys:
        of_days = [day[key].value for day in days]
        by_key[key] = np.array(of_days)
    spreads = moderated_spreads(by_key)
    for key in keys:
        values = np.array([day[key].value for day in days])
        middle = float(values.mean())
        count = len(values)
        spread = 0.0
        half_interval = float(np.mean([0.5 * (day[key].high - day[key].low) for day in days]))
        if count > 1:
            std, freedom = spreads[key]
            reach = float(stdtrit(freedom, 0.5 + 0.5 * LEVEL))
            spread = reach * std * float(np.sqrt(1.0 + 1.0 / count))
        half = max(half_interval, spread)
        low = middle - half
        if key[1] in SCALED and middle > 0.0:
            low = max(low, 0.0)  # nothing rubs backwards
        ranges[key] = ParameterRange(
            middle, low, middle + half, "days" if spread > half_interval else "interval"
        )
    return ranges


def moderated_spreads(
    values: Mapping[tuple[str, str], Float[Array, " D"]],
) -> dict[tuple[str, str], tuple[float, float]]:
    """Standard deviation from day to day of each figure, with its degrees of freedom, by all
    figures of its kind.

    The variances of one kind at n joints, as shares of their sizes, are taken as draws of a scaled
    inverse χ² with ν₀ degrees of freedom about s₀²; a joint's own s², of d = D − 1, is then known
    as (ν₀ s₀² + d s²) / (ν₀ + d), with ν₀ + d degrees. ν₀ and s₀ follow from mean and variance of
    log s²:

        mean = log s₀² + ψ(d/2) − log(d/2) − ψ(ν₀/2) + log(ν₀/2),    variance = ψ'(d/2) + ψ'(ν₀/2).

    A kind at fewer than three joints, or with a spread of nothing, is left as it is.

    Source: Smyth 2004 (moderated t: hyperparameters of an inverse χ² by moments of log s²).
    """
    spreads: dict[tuple[str, str], tuple[float, float]] = {}
    for kind in {name for _, name in values}:
        rows = {key: of_joint for key, of_joint in values.items() if key[1] == kind}
        freedom = float(min(len(of_joint) for of_joint in rows.values()) - 1)
        deviations = {
            key: float(of_joint.std(ddof=1)) if len(of_joint) > 1 else 0.0
            for key, of_joint in rows.items()
        }
        sizes = {
            key: float(np.abs(of_joint).mean()) if kind in SCALED else 1.0
            for key, of_joint in rows.items()
        }
        shares = np.array([deviations[key] / max(sizes[key], LEAST_SIZE) for key in rows])
        prior = (0.0, 0.0)
        if freedom >= 1.0 and len(rows) >= FEWEST_ALIKE and (shares > 0.0).all():
            prior = _prior_of_variances(shares**2, freedom)
        for (key, std), share in zip(deviations.items(), shares, strict=True):
            square, more = prior
            if more == 0.0:
                spreads[key] = std, freedom
                continue
            weight = 1.0 if np.isinf(more) else more / (more + freedom)
            pooled = weight * square + (1.0 - weight) * share**2
            # No more degrees than all joints have together: s₀² is known no better.
            known = min(freedom + more, len(rows) * freedom)
            spreads[key] = float(np.sqrt(pooled)) * max(sizes[key], LEAST_SIZE), known
    return spreads


def _prior_of_variances(squares: Float[Array, " n"], freedom: float) -> tuple[float, float]:
    """s₀² and ν₀ of variances with so many degrees of freedom; ν₀ is infinite where they differ by
    chance alone.
    """
    logs = np.log(squares) - digamma(freedom / 2.0) + np.log(freedom / 2.0)
    rest = float(logs.var(ddof=1)) - float(polygamma(1, freedom / 2.0))
    if rest <= 0.0:
        return float(np.exp(logs.mean())), float("inf")
    # ψ' falls from infinity to zero: one root, between degrees that are as good as none and as good
    # as all.
    more = 2.0 * float(brentq(lambda half: float(polygamma(1, half)) - rest, 1e-3, 1e9))
    return float(np.exp(logs.mean() + digamma(more / 2.0) - np.log(more / 2.0))), more


def noise_of(days: Sequence[Estimates]) -> dict[str, float]:
    """What the estimates leave at each joint, in a usual session [N m]."""
    joints = dict.fromkeys(joint for day in days for joint, name in day if name == "gap")
    sizes = {}
    for joint in joints:
        squares = [day[joint, "gap"].value ** 2 for day in days if (joint, "gap") in day]
        sizes[joint] = float(np.sqrt(np.mean(squares)))
    return sizes


def _check(
    motions: Sequence[Motion],
    reference: ArmModel,
    ranges: Mapping[tuple[str, str], ParameterRange],
    noise: Mapping[str, float],
) -> tuple[Float[Array, " n"], float]:
    """Share of each joint's torque inside the box, and how many times the habit's box is wider, its
    median over joints.

    The box of independent ranges at a state: its middle is the torque of the middles, its half
    width the sum of the half widths times what each parameter multiplies.
    """
    joints = motions[0].joints
    boxes = np.zeros((len(motions[0].joints), 3, len(TERMS)))
    # Middle and half width of each term's range, and half width of the habit's; a gain without a
    # range is one.
    boxes[:, :, TERMS.index("gain")] = 1.0, 0.0, HABIT
    for (joint, name), parameter_range in ranges.items():
        if joint in joints and name in TERMS:
            usual = HABIT * abs(parameter_range.value) if name in SCALED else 0.0
            row = (
                0.5 * (parameter_range.low + parameter_range.high),
                0.5 * (parameter_range.high - parameter_range.low),
                usual,
            )
            boxes[joints.index(joint), :, TERMS.index(name)] = row
    inside, total, widths, habit = np.zeros((4, len(joints)))
    reach = float(ndtri(0.5 + 0.5 * LEVEL))
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid = motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq))
        for j, (centre, half, usual) in enumerate(boxes):
            rows = motion.settled[:, j]
            columns = term_columns(motion, rigid, j)[rows]
            off = np.abs(motion.tau_filtered[rows, j] - columns @ centre)
            width = np.abs(columns) @ half
            inside[j] += np.sum(off <= width + reach * noise.get(joints[j], 0.0))
            total[j] += len(columns)
            widths[j] += np.sum(width)
            habit[j] += np.sum(np.abs(columns) @ usual)
    shares = np.where(total > 0, inside / np.maximum(total, 1.0), np.nan)
    return shares, float(
        np.nanmedian(np.where(widths > 0.0, habit / np.maximum(widths, 1e-300), np.nan))
    )
