"""Ranges for domain randomisation: as wide as the arm is uncertain and changes from day to day, and no wider.

Each session is a day. A figure's range is the wider of two: its own 95 % interval, and where it will lie on another
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
from ident.monitor.figures import TERMS, UNITS, SessionFigure, compute_figures, term_columns
from ident.motion.motion import Motion
from ident.results import Result
from ident.robot.arm import ArmModel

SCHEMA = "ident.ranges/1"
LEVEL = 0.95
# What is randomised by habit where nobody has measured: a share to either side of each figure.
HABIT = 0.30
# Figures of which a share makes sense; a torque offset has no scale of its own.
SCALED = ("gain", "rotor", "viscous", "coulomb")
# Held-out days need so many others to tell a spread from.
LEAST_DAYS = 3


@dataclass(frozen=True)
class FigureRange:
    """The range of one figure.

    Attributes:
        joint, figure: What, by `UNITS`.
        value: Its middle: the mean over the days.
        low, high: The range.
        source: What makes it as wide as it is: `interval` or `days`.
    """

    joint: str
    figure: str
    value: float
    low: float
    high: float
    source: str

    @property
    def narrower(self) -> float:
        """How many times narrower than the habit's; NaN for figures without a scale."""
        if self.figure not in SCALED:
            return float("nan")
        return float(2.0 * HABIT * abs(self.value) / max(self.high - self.low, 1e-300))

    def to_dict(self) -> dict[str, Any]:
        return {
            "value": self.value,
            "low": self.low,
            "high": self.high,
            "unit": UNITS[self.figure],
            "source": self.source,
        }


@dataclass(frozen=True, eq=False)
class Ranges(Result):
    """Ranges of an arm.

    Attributes:
        robot: Its name.
        days: Names of the sessions.
        ranges: One for each figure of each joint.
        noise: Standard deviation of what the figures leave at each joint [N m].
        inside: Share of held-out torque in the randomised box, by joint; empty where there are too few days.
        narrower: How many times narrower the box is there than the habit's, noise aside; NaN likewise.
    """

    robot: str
    days: tuple[str, ...]
    ranges: tuple[FigureRange, ...]
    noise: Mapping[str, float]
    inside: Mapping[str, float]
    narrower: float

    def to_dict(self) -> dict[str, Any]:
        narrower = None if np.isnan(self.narrower) else self.narrower
        return {
            "schema": SCHEMA,
            "robot": self.robot,
            "joints": list(self.noise),
            "days": list(self.days),
            "ranges": {f"{one.joint}/{one.figure}": one.to_dict() for one in self.ranges},
            "noise_Nm": dict(self.noise),
            "heldout": {"level": LEVEL, "inside": dict(self.inside), "narrower_than_habit": narrower, "habit": HABIT},
            "provenance": self.provenance.to_dict(),
        }

    def summary(self) -> str:
        """The ranges in a table of plain lines, and the check."""
        lines = [f"{self.robot}: {len(self.days)} day(s)"]
        for one in self.ranges:
            by = "day to day" if one.source == "days" else "its interval"
            unit = "" if UNITS[one.figure] == "1" else f" {UNITS[one.figure]}"
            lines.append(f"{one.joint} {one.figure}: {one.value:.4g} [{one.low:.4g}, {one.high:.4g}]{unit}, by {by}")
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
    """Ranges of an arm from its days, and how they do on days left out.

    Args:
        days: Runs of each session.
        reference: The arm with the motions' joints; its rigid torque is what `gain` multiplies.
    """
    figures = {name: compute_figures(motions, reference) for name, motions in days.items()}
    names = list(days)
    inside: dict[str, float] = {}
    narrower = float("nan")
    if len(names) > LEAST_DAYS:
        shares, widths = [], []
        for out in names:
            rest = pool_days([figures[name] for name in names if name != out])
            noise = noise_of([figures[name] for name in names if name != out])
            share, width = _check(days[out], reference, rest, noise)
            shares.append(share)
            widths.append(width)
        joints = days[names[0]][0].joints
        inside = dict(zip(joints, map(float, np.nanmean(shares, axis=0)), strict=True))
        narrower = float(np.median(np.array(widths)))
    return Ranges(
        reference.name,
        tuple(names),
        pool_days(list(figures.values())),
        noise_of(list(figures.values())),
        inside,
        narrower,
    )


def pool_days(days: Sequence[Sequence[SessionFigure]]) -> tuple[FigureRange, ...]:
    """The range of each figure that every day tells."""
    by_key: dict[tuple[str, str], list[SessionFigure]] = {}
    for day in days:
        for one in day:
            if one.figure in TERMS:
                by_key.setdefault((one.joint, one.figure), []).append(one)
    return tuple(_range(found) for found in by_key.values() if len(found) == len(days))


def _range(found: Sequence[SessionFigure]) -> FigureRange:
    """The wider of the figure's interval in a usual session, and where another day's will lie.

    Source: the prediction interval of a normal draw, Student's t with D − 1 degrees of freedom.
    """
    values = np.array([one.value for one in found])
    middle, count = float(values.mean()), len(values)
    own = float(np.mean([0.5 * (one.high - one.low) for one in found]))
    spread = 0.0
    if count > 1:
        reach = float(stdtrit(count - 1, 0.5 + 0.5 * LEVEL))
        spread = reach * float(values.std(ddof=1)) * float(np.sqrt(1.0 + 1.0 / count))
    half = max(own, spread)
    low = middle - half
    if found[0].figure in SCALED and middle > 0.0:
        low = max(low, 0.0)  # nothing rubs backwards
    return FigureRange(
        found[0].joint, found[0].figure, middle, low, middle + half, "days" if spread > own else "interval"
    )


def noise_of(days: Sequence[Sequence[SessionFigure]]) -> dict[str, float]:
    """What the figures leave at each joint, in a usual session [N m]."""
    left: dict[str, list[float]] = {}
    for day in days:
        for one in day:
            if one.figure == "gap":
                left.setdefault(one.joint, []).append(one.value)
    return {joint: float(np.sqrt(np.mean(np.square(values)))) for joint, values in left.items()}


def _check(
    motions: Sequence[Motion], reference: ArmModel, ranges: Sequence[FigureRange], noise: Mapping[str, float]
) -> tuple[Float[Array, " n"], float]:
    """Share of each joint's torque inside the box, and how many times the habit's box is wider, its median over joints.

    The box of independent ranges at a state: its middle is the torque of the middles, its half width the sum of the
    half widths times what each figure is multiplied by.
    """
    by_joint: dict[str, dict[str, FigureRange]] = {}
    for one in ranges:
        by_joint.setdefault(one.joint, {})[one.figure] = one
    joints = motions[0].joints
    inside, total = np.zeros(len(joints)), np.zeros(len(joints))
    own, habit = np.zeros(len(joints)), np.zeros(len(joints))
    reach = float(ndtri(0.5 + 0.5 * LEVEL))
    for motion in motions:
        arm = reference.with_payload(motion.payload)
        rigid = motion.filtered(arm.inverse_dynamics(motion.q, motion.dq, motion.ddq))
        for j, joint in enumerate(joints):
            known = by_joint.get(joint, {})
            rows = motion.settled[:, j]
            columns = dict(zip(TERMS, term_columns(motion, rigid, j).T, strict=True))
            middle, half, usual = _box(columns, known)
            far = np.abs(motion.tau_filtered[:, j] - middle) <= half + reach * noise.get(joint, 0.0)
            inside[j] += np.sum(far & rows)
            total[j] += np.sum(rows)
            own[j] += np.sum(half[rows])
            habit[j] += np.sum(usual[rows])
    shares = np.where(total > 0, inside / np.maximum(total, 1.0), np.nan)
    return shares, float(np.nanmedian(np.where(own > 0.0, habit / np.maximum(own, 1e-300), np.nan)))


def _box(
    columns: Mapping[str, Float[Array, " t"]], known: Mapping[str, FigureRange]
) -> tuple[Float[Array, " t"], Float[Array, " t"], Float[Array, " t"]]:
    """Middle and half width of the box, and half width of the habit's [N m]."""
    middle = np.zeros_like(columns["gain"])
    half, usual = np.zeros_like(middle), np.zeros_like(middle)
    for name, column in columns.items():
        one = known.get(name)
        if one is None:  # a gain that is not asked for is one
            middle += column if name == "gain" else 0.0
            usual += HABIT * np.abs(column) if name == "gain" else 0.0
            continue
        centre = 0.5 * (one.low + one.high)
        middle += centre * column
        half += 0.5 * (one.high - one.low) * np.abs(column)
        usual += HABIT * abs(one.value) * np.abs(column) if name in SCALED else 0.0
    return middle, half, usual
