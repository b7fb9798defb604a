"""Ranges for domain randomisation.

As wide as the arm is uncertain and changes from day to day, and no wider. Each session is a day. A
parameter's range is the wider of two: its own 95 % interval, and where it will lie on another day
by its spread over the days so far. The randomised torque at a state lies in a box of those ranges;
the check is how often the measured torque of a day lies in the box made from the other days, noise
added as a simulator would.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtrit

from ident.arrays import Array, Float
from ident.errors import plural
from ident.monitor.estimates import Estimates, estimate_session, term_columns
from ident.monitor.parameters import RANGED_UNITS, SCALED, TERMS, WORDS, unit_of
from ident.monitor.spreads import moderated_spreads
from ident.motion.motion import Motion
from ident.records import JsonRecord
from ident.results import Result
from ident.robot.arm import ArmModel

SCHEMA = "ident.ranges/1"
LEVEL = 0.95
# Share of all draws below the upper end of a range of that level.
UPPER = 0.5 + 0.5 * LEVEL
# What is randomised by habit where nobody has measured: a share to either side of each parameter.
HABIT = 0.30
# Held-out days need so many others to estimate a spread from.
LEAST_DAYS = 3


@dataclass(frozen=True)
class ParameterRange:
    """The range of one parameter."""

    value: float  # its middle: the mean over the days
    low: float  # the range
    high: float
    source: str  # what makes it as wide as it is: `interval` or `days`


ByFigure = Mapping[tuple[str, str], ParameterRange]
"""By joint and parameter (`ident.monitor.parameters.UNITS`)."""


@dataclass(frozen=True, eq=False)
class Ranges(Result):
    """Ranges of an arm."""

    robot: str  # its name
    days: tuple[str, ...]  # names of the sessions
    ranges: ByFigure
    noise: Mapping[str, float]  # standard deviation of what the estimates leave at each joint [N m]
    # Share of held-out torque in the randomised box, by joint; empty where there are too few days.
    inside: Mapping[str, float]
    # how many times narrower the box is there than the habit's, noise aside; NaN likewise
    narrower: float

    def to_dict(self) -> JsonRecord:
        ranges = {}
        for (joint, name), limits in self.ranges.items():
            ranges[f"{joint}/{name}"] = {**vars(limits), "unit": RANGED_UNITS[name]}
        heldout = {
            "level": LEVEL,
            "inside": dict(self.inside),
            "narrower_than_habit": None if np.isnan(self.narrower) else self.narrower,
            "habit": HABIT,
        }
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.noise),
            "days": list(self.days),
            "ranges": ranges,
            "noise_Nm": dict(self.noise),
            "heldout": heldout,
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """The ranges in a table of plain lines, and the check."""
        lines = [f"{self.robot}: {plural(len(self.days), 'day')}"]
        for (joint, name), limits in self.ranges.items():
            by = "day to day" if limits.source == "days" else "its interval"
            ends = f"[{limits.low:.4g}, {limits.high:.4g}]"
            size = f"{limits.value:.4g} {ends}{unit_of(name)}"
            lines.append(f"{joint} {WORDS[name]}: {size}, by {by}")
        return "\n".join([*lines, self._check_in_words()])

    def _check_in_words(self) -> str:
        """How held-out days did."""
        if not self.inside:
            few = f"fewer than {LEAST_DAYS + 1} days"
            return f"{few}: how an arm changes from day to day is not checked"
        share = float(np.mean(list(self.inside.values())))
        return (
            f"held-out days: {100.0 * share:.1f} % of the torque inside the ranges and noise; "
            f"ranges {self.narrower:.1f} times narrower than ±{100.0 * HABIT:.0f} %"
        )


def find_ranges(
    days: Mapping[str, Sequence[Motion]],
    reference: ArmModel,
    further: Callable[[Sequence[Motion], ArmModel], Estimates] | None = None,
) -> Ranges:
    """Ranges of an arm from its days, and how they do on days left out.

    Args:
        days: Motions of each day by its name.
        reference: The arm that all figures refer to.
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
        inside, narrower = _check_days(days, by_day, reference)
    every = list(by_day.values())
    return Ranges(reference.name, tuple(days), pool_days(every), noise_of(every), inside, narrower)


def pool_days(days: Sequence[Estimates]) -> dict[tuple[str, str], ParameterRange]:
    """The range of each parameter that every day has an estimate of.

    The wider of the interval in a usual session, and where another day's estimate will lie. Of few
    days the spread of one joint's figure is hardly known; that of all joints' figures of its kind
    is, and is counted with it (`moderated_spreads`).

    Source: the prediction interval of a normal draw, Student's t.
    """
    of_all_days = set(days[0]).intersection(*days[1:])
    keys = [key for key in days[0] if key[1] in WORDS and key in of_all_days]
    values = {}
    for key in keys:
        values[key] = np.array([day[key].value for day in days])
    spreads = moderated_spreads(values)
    ranges = {}
    for key in keys:
        middle = float(values[key].mean())
        half_widths = [0.5 * (day[key].high - day[key].low) for day in days]
        interval = float(np.mean(half_widths))
        spread = 0.0
        if len(days) > 1:
            std, freedom = spreads[key]
            reach = float(stdtrit(freedom, UPPER))
            spread = reach * std * float(np.sqrt(1.0 + 1.0 / len(days)))
        half = max(interval, spread)
        low = middle - half
        if key[1] in SCALED and middle > 0.0:
            low = max(low, 0.0)  # nothing rubs backwards
        source = "days" if spread > interval else "interval"
        ranges[key] = ParameterRange(middle, low, middle + half, source)
    return ranges


def noise_of(days: Sequence[Estimates]) -> dict[str, float]:
    """What the estimates leave at each joint, in a usual session [N m]."""
    squares: dict[str, list[float]] = {}
    for day in days:
        for (joint, name), estimate in day.items():
            if name == "gap":
                squares.setdefault(joint, []).append(estimate.value**2)
    return {joint: float(np.sqrt(np.mean(of_days))) for joint, of_days in squares.items()}


def _check_days(
    days: Mapping[str, Sequence[Motion]], by_day: Mapping[str, Estimates], reference: ArmModel
) -> tuple[dict[str, float], float]:
    """Each day in the box of the others.

    Returns:
        Share of each joint's torque inside, and how many times the habit's box is wider.
    """
    shares = []
    widths = []
    for left_out, motions in days.items():
        others = [day for name, day in by_day.items() if name != left_out]
        boxes = _make_boxes(motions[0].joints, pool_days(others))
        share, width = _check_day(motions, reference, boxes, noise_of(others))
        shares.append(share)
        widths.append(width)
    joints = next(iter(days.values()))[0].joints
    inside = np.nanmean(shares, axis=0).tolist()
    return dict(zip(joints, inside, strict=True)), float(np.median(widths))


def _make_boxes(joints: Sequence[str], ranges: ByFigure) -> Float[Array, "n 3 k"]:
    """Middle and half width of each term's range, and half width of the habit's, of each joint."""
    boxes = np.zeros((len(joints), 3, len(TERMS)))
    # A gain without a range is one.
    boxes[:, :, TERMS.index("gain")] = (1.0, 0.0, HABIT)
    for (joint, name), limits in ranges.items():
        if joint in joints and name in TERMS:
            middle = 0.5 * (limits.low + limits.high)
            half = 0.5 * (limits.high - limits.low)
            usual = HABIT * abs(limits.value) if name in SCALED else 0.0
            boxes[joints.index(joint), :, TERMS.index(name)] = (middle, half, usual)
    return boxes


def _check_day(
    motions: Sequence[Motion],
    reference: ArmModel,
    boxes: Float[Array, "n 3 k"],
    noise: Mapping[str, float],
) -> tuple[Float[Array, " n"], float]:
    """Share of each joint's torque inside its box, and how many times the habit's box is wider.

    That is the median over joints. The box of independent ranges at a state: its middle is the
    torque of the middles, its half width the sum of the half widths times what each parameter
    multiplies.
    """
    joints = motions[0].joints
    inside, total, widths, habit = np.zeros((4, len(joints)))
    reach = float(ndtri(UPPER))
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid = motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq))
        for j, (centre, half, usual) in enumerate(boxes):
            rows = motion.settled[:, j]
            columns = term_columns(motion, rigid, j)[rows]
            distance = np.abs(motion.tau_filtered[rows, j] - columns @ centre)
            width = np.abs(columns) @ half
            of_noise = reach * noise.get(joints[j], 0.0)
            inside[j] += np.sum(distance <= width + of_noise)
            total[j] += len(columns)
            widths[j] += np.sum(width)
            habit[j] += np.sum(np.abs(columns) @ usual)
    shares = np.where(total > 0, inside / np.maximum(total, 1.0), np.nan)
    wider = np.where(widths > 0.0, habit / np.maximum(widths, 1e-300), np.nan)
    return shares, float(np.nanmedian(wider))
