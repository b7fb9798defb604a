"""Ranges for domain randomisation: as wide as the arm is uncertain and changes from day to day, and no wider.

Each session is a day. A parameter's range is the wider of two: its own 95 % interval, and where it will lie on another
day by its spread over the days so far. The randomised torque at a state lies in a box of those ranges; the check is
how often the measured torque of a day lies in the box made from the other days, noise added as a simulator would.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtri, stdtrit

from ident.arrays import Array, Float
from ident.monitor.estimates import TERMS, UNITS, Estimates, estimate_session, term_columns, unit_of
from ident.motion.motion import Motion
from ident.results import Result
from ident.robot.arm import ArmModel

SCHEMA = "ident.ranges/1"
LEVEL = 0.95
# What is randomised by habit where nobody has measured: a share to either side of each parameter.
HABIT = 0.30
# Parameters of which a share makes sense; a torque offset has no scale of its own.
SCALED = ("gain", "rotor", "viscous", "coulomb")
# Held-out days need so many others to estimate a spread from.
LEAST_DAYS = 3


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
    narrower: float  # how many times narrower the box is there than the habit's, noise aside; NaN likewise

    def to_dict(self) -> dict[str, Any]:
        narrower = None if np.isnan(self.narrower) else self.narrower
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.noise),
            "days": list(self.days),
            "ranges": {
                f"{joint}/{name}": {**vars(one), "unit": UNITS[name]} for (joint, name), one in self.ranges.items()
            },
            "noise_Nm": dict(self.noise),
            "heldout": {"level": LEVEL, "inside": dict(self.inside), "narrower_than_habit": narrower, "habit": HABIT},
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """The ranges in a table of plain lines, and the check."""
        lines = [f"{self.robot}: {len(self.days)} day(s)"]
        for (joint, name), one in self.ranges.items():
            by = "day to day" if one.source == "days" else "its interval"
            lines.append(f"{joint} {name}: {one.value:.4g} [{one.low:.4g}, {one.high:.4g}]{unit_of(name)}, by {by}")
        if self.inside:
            share = float(np.mean(list(self.inside.values())))
            lines.append(
                f"held-out days: {share:.1%} of the torque inside the ranges and noise; "
                f"ranges {self.narrower:.1f} times narrower than ±{HABIT:.0%}"
            )
        else:
            lines.append(f"fewer than {LEAST_DAYS + 1} days: how an arm changes from day to day is not checked")
        return "\n".join(lines)


def find_ranges(days: Mapping[str, Sequence[Motion]], reference: ArmModel) -> Ranges:
    """Ranges of an arm from its days, and how they do on days left out."""
    found = {name: estimate_session(motions, reference) for name, motions in days.items()}
    inside: dict[str, float] = {}
    narrower = float("nan")
    if len(days) > LEAST_DAYS:
        checks = []
        for out, motions in days.items():
            rest = [own for name, own in found.items() if name != out]
            checks.append(_check(motions, reference, pool_days(rest), noise_of(rest)))
        joints = next(iter(days.values()))[0].joints
        inside = dict(zip(joints, map(float, np.nanmean([share for share, _ in checks], axis=0)), strict=True))
        narrower = float(np.median([width for _, width in checks]))
    every = list(found.values())
    return Ranges(reference.name, tuple(days), pool_days(every), noise_of(every), inside, narrower)


def pool_days(days: Sequence[Estimates]) -> dict[tuple[str, str], ParameterRange]:
    """The range of each parameter that every day has an estimate of.

    The wider of the interval in a usual session, and where another day's estimate will lie.

    Source: the prediction interval of a normal draw, Student's t with D − 1 degrees of freedom.
    """
    found = {}
    for key in (key for key in days[0] if key[1] in TERMS and all(key in day for day in days)):
        values = np.array([day[key].value for day in days])
        middle, count, spread = float(values.mean()), len(values), 0.0
        own = float(np.mean([0.5 * (day[key].high - day[key].low) for day in days]))
        if count > 1:
            reach = float(stdtrit(count - 1, 0.5 + 0.5 * LEVEL))
            spread = reach * float(values.std(ddof=1)) * float(np.sqrt(1.0 + 1.0 / count))
        half = max(own, spread)
        low = middle - half
        if key[1] in SCALED and middle > 0.0:
            low = max(low, 0.0)  # nothing rubs backwards
        found[key] = ParameterRange(middle, low, middle + half, "days" if spread > own else "interval")
    return found


def noise_of(days: Sequence[Estimates]) -> dict[str, float]:
    """What the estimates leave at each joint, in a usual session [N m]."""
    joints = dict.fromkeys(joint for day in days for joint, name in day if name == "gap")
    return {
        joint: float(np.sqrt(np.mean([day[joint, "gap"].value ** 2 for day in days if (joint, "gap") in day])))
        for joint in joints
    }


def _check(
    motions: Sequence[Motion],
    reference: ArmModel,
    ranges: Mapping[tuple[str, str], ParameterRange],
    noise: Mapping[str, float],
) -> tuple[Float[Array, " n"], float]:
    """Share of each joint's torque inside the box, and how many times the habit's box is wider, its median over joints.

    The box of independent ranges at a state: its middle is the torque of the middles, its half width the sum of the
    half widths times what each parameter multiplies.
    """
    joints, boxes = motions[0].joints, np.zeros((len(motions[0].joints), 3, len(TERMS)))
    # Middle and half width of each term's range, and half width of the habit's; a gain without a range is one.
    boxes[:, :, TERMS.index("gain")] = 1.0, 0.0, HABIT
    for (joint, name), one in ranges.items():
        if joint in joints and name in TERMS:
            usual = HABIT * abs(one.value) if name in SCALED else 0.0
            row = 0.5 * (one.low + one.high), 0.5 * (one.high - one.low), usual
            boxes[joints.index(joint), :, TERMS.index(name)] = row
    inside, total, own, habit = np.zeros((4, len(joints)))
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
            own[j] += np.sum(width)
            habit[j] += np.sum(np.abs(columns) @ usual)
    shares = np.where(total > 0, inside / np.maximum(total, 1.0), np.nan)
    return shares, float(np.nanmedian(np.where(own > 0.0, habit / np.maximum(own, 1e-300), np.nan)))
